#!/bin/bash
# Build the workspace with colcon (arguments are handed on to colcon build).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
source_ros
cd "$ROOT"

# a build made on another prefix does not fit this one
made_on="$(cat build/.made_on 2>/dev/null || true)"
[ -z "$made_on" ] || [ "$made_on" = "$AMENT_PREFIX_PATH" ] || rm -rf build install log
mkdir -p build
printf '%s' "$AMENT_PREFIX_PATH" > build/.made_on

colcon build --symlink-install --event-handlers console_cohesion- "$@"
