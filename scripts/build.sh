#!/bin/bash
# Build the workspace with colcon (arguments are handed on to colcon build).
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
source_ros
cd "$ROOT"

# a build made on another ROS 2 does not fit this one
ros="$HUMBLE"
[ -e "$HUMBLE/setup.bash" ] || ros="$PREFIX"
made_on="$(cat build/.made_on 2>/dev/null || true)"
[ -z "$made_on" ] || [ "$made_on" = "$ros" ] || rm -rf build install log
mkdir -p build
printf '%s' "$ros" > build/.made_on

# nothing to do while no source file is newer than the last whole build
if [ $# = 0 ] && [ -e build/.complete ] && [ -e install/setup.bash ] &&
        [ -z "$(find src launch config -type f -newer build/.complete -not -name '*.pyc' -print -quit)" ]; then
    exit 0
fi
colcon build --symlink-install --event-handlers console_cohesion- "$@"
[ $# != 0 ] || touch build/.complete
