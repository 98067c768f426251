#!/bin/bash
# Rewrite requirements/*.txt (exact versions and SHA-256 of every download) from requirements/*.in. Needs uv.
set -euo pipefail
cd "$(dirname "$0")/../requirements"
lock() {  # lock NAME PYTHON [OPTION...]
    uv pip compile --quiet --generate-hashes --allow-unsafe --custom-compile-command 'make lock' \
        --python-platform x86_64-manylinux_2_35 --python-version "$2" "${@:3}" "$1.in" --output-file "$1.txt"
}
lock pip 3.10
lock ros_prefix 3.12
lock ros_tree 3.12 --no-deps
lock bench 3.12 --no-deps
lock floor_python310 3.10
without=()
for package in numpy scipy matplotlib contourpy cycler fonttools kiwisolver packaging pillow pyparsing \
        python-dateutil six; do
    without+=(--no-emit-package "$package")
done
lock humble_apt 3.10 --constraint humble_apt_given.in "${without[@]}"
