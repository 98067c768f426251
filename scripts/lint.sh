#!/bin/bash
# Ruff over the whole repository (configuration: .ruff.toml). Arguments are handed on: scripts/lint.sh --fix
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
if ! command -v ruff >/dev/null || [ -e "$PREFIX/setup.bash" ]; then
    [ -e "$ROOT/install/setup.bash" ] || "$ROOT/scripts/setup.sh"
    source_ros
fi
cd "$ROOT"
ruff check "$@" .
