#!/bin/bash
# Build the workspace with colcon (arguments are handed on to colcon build). Nothing is done while the sources are those
# of the last whole build; that is judged by their content, never by time stamps.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
check_place
source_ros
cd "$ROOT"
ros="$HUMBLE"
[ -e "$HUMBLE/setup.bash" ] || ros="$PREFIX"
place="$ros in $ROOT"  # a build made on another ROS 2, or elsewhere, does not fit: install/ holds absolute paths

# what a whole build is made from; written before building, so an edit during a build makes the next one build again
state() {
    printf '%s\n' "$place"
    cat "$ros/style-prefix-stamp" "$ros/share/rclpy/package.xml" 2>/dev/null | sha256sum
    find src launch config \( -name __pycache__ -o -name .pytest_cache -o -name '*.egg-info' -o -path 'src/*/build' \
        -o -path 'src/*/dist' \) -prune -o -type f -not -name '*.so' -not -name '*.c' -not -name '.kernels.*' -print0 |
        LC_ALL=C sort -z | xargs -0 sha256sum
}
built() { [ "$(cat build/.state 2>/dev/null)" = "$state" ] && [ -e install/setup.bash ]; }

state="$(state | sha256sum)"
if [ $# = 0 ] && built; then
    exit 0
fi
{ : >> .build.lock; } 2>/dev/null || die "$ROOT cannot be written, and the workspace is built in it: \
copy the checkout to a folder of your own, or have its owner run make setup"
exec 9>> .build.lock  # two builds of one checkout wait for each other
if ! flock --nonblock 9; then
    say "Another build of this checkout is running; waiting for it"
    flock 9
    state="$(state | sha256sum)"
    if [ $# = 0 ] && built; then
        exit 0
    fi
fi

[ "$(cat build/.place 2>/dev/null || true)" = "$place" ] || rm -rf build install log
for package in install/*/share/*/package.xml; do  # packages that are no more would go on shadowing others
    name="$(basename "$(dirname "$package")")"
    [ ! -e "$package" ] || [ -n "$(find src/ -maxdepth 2 -path "*/$name/package.xml" -print -quit)" ] ||
        rm -rf "install/$name" "build/$name"
done
mkdir -p build
printf '%s' "$place" > build/.place
[ $# != 0 ] || rm -f build/.state
colcon build --symlink-install --event-handlers console_cohesion- "$@" 9>&-
[ $# != 0 ] || printf '%s' "$state" > build/.state
