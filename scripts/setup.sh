#!/bin/bash
# Set everything up: system tools, ROS 2 Humble, Python packages, and the built workspace. Quick where nothing is to do.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

compilers() {
    local wanted=() command
    command -v gcc >/dev/null || wanted+=(gcc)
    command -v g++ >/dev/null || wanted+=(g++)
    command -v make >/dev/null || command -v ninja >/dev/null || wanted+=(make)
    command -v cmake >/dev/null || wanted+=(cmake)
    [ ${#wanted[@]} = 0 ] || apt_install "${wanted[@]}"
    for command in "${wanted[@]}"; do
        command -v "$command" >/dev/null || die "$command is installed but not on PATH ($PATH)"
    done
}

check_place
if [ -e "$HUMBLE/setup.bash" ]; then
    "$ROOT/scripts/complete_humble.sh"
else
    compilers
    if [ -n "${STYLE_ROS_PREFIX:-}" ] && [ -e "$PREFIX/style-prefix-stamp" ]; then
        say "Using the prefix at $PREFIX (STYLE_ROS_PREFIX) as it is"
    else
        need_python 3.12
        env -u PYTHONPATH "$PYTHON" "$ROOT/scripts/ros_prefix/build.py" "$PREFIX"
    fi
fi
"$ROOT/scripts/build.sh"
