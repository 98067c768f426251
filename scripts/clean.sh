#!/bin/bash
# Remove what was built: clean.sh [--prefix]. With --prefix the ROS 2 prefix of this checkout as well.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
cd "$ROOT"
rm -rf build install log out .build.lock .pytest_cache .ruff_cache .hypothesis src/*/build src/*/dist src/*/*.egg-info
find src benchmarks test scripts -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true
find src/style_core \( -name '*.so' -o -name '*.c' -o -name '.kernels.*.json' \) -delete
if [ "${1:-}" = --prefix ]; then
    rm -rf .ros2 .venv-*
    say "Downloads are kept in ${STYLE_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/style-motion}; remove that folder by hand."
fi
