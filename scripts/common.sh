# Shared by the scripts of this folder; sourced, not run.
set -euo pipefail
ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
PREFIX="${STYLE_ROS_PREFIX:-$ROOT/.ros2/humble}"

say() { printf '%s\n' "$*"; }
die() { printf '%s\n' "$*" >&2; exit 1; }

# An installed Humble: the one that STYLE_HUMBLE names, that of an active conda or pixi environment, or apt's
HUMBLE="${STYLE_HUMBLE:-/opt/ros/humble}"
if [ -z "${STYLE_HUMBLE:-}" ] && [ "${ROS_DISTRO:-}" = humble ] && [ -e "${CONDA_PREFIX:-}/share/rclpy/package.xml" ]; then
    HUMBLE="$CONDA_PREFIX"
fi

# caches and logs go to the home folder where nothing else is said
if [ -z "${HOME:-}" ]; then
    HOME="$(getent passwd "$(id -u)" 2>/dev/null | cut -d: -f6)" || true
    [ -n "$HOME" ] || die "HOME is not set and this user has no home folder: export HOME=/a/folder/you/may/write"
    export HOME
fi

# check_place: refuse at once what would fail after minutes; rosidl, colcon and CMake pass paths through shells and ASCII
check_place() {
    local path LC_ALL=C
    for path in "$ROOT" "$PREFIX" "${STYLE_CACHE:-}"; do
        case "$path" in
            *[!A-Za-z0-9/._+,@=~-]*)
                die "'$path' holds a character that the build tools of ROS 2 do not bear (fine are letters and digits of \
ASCII and / . _ + , @ = ~ -): move the checkout, or name another folder with STYLE_ROS_PREFIX or STYLE_CACHE." ;;
        esac
    done
}

# run_as_root COMMAND...: as root, or through sudo where it asks no password
run_as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; elif sudo -n true 2>/dev/null; then sudo "$@"; else return 1; fi
}

# apt_install PACKAGE...: install what is missing; where that cannot be done, name exactly what to install
apt_install() {
    local missing=() package
    for package in "$@"; do
        # without dpkg only what the caller has found missing is asked for
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} -gt 0 ] || return 0
    if command -v apt-get >/dev/null; then
        say "Installing with apt: ${missing[*]}"
        run_as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq update || true
        run_as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${missing[@]}" \
            >/dev/null && return 0
    fi
    die "Missing, and not installable from here: ${missing[*]}
Install them ($(by_hand "${missing[@]}")) and run this again."
}

# by_hand PACKAGE...: the command a person would type; other distributions call the compilers a little differently
by_hand() {
    local names="$*"
    if command -v dnf >/dev/null; then
        printf 'sudo dnf install %s' "$(sed 's/g++/gcc-c++/; s/libc6-dev/glibc-devel/' <<< "$names")"
    elif command -v zypper >/dev/null; then
        printf 'sudo zypper install %s' "$(sed 's/g++/gcc-c++/; s/libc6-dev/glibc-devel/' <<< "$names")"
    elif command -v pacman >/dev/null; then
        printf 'sudo pacman -S %s' "$(sed 's/g++/gcc/; s/libc6-dev/glibc/' <<< "$names")"
    else
        printf 'Debian, Ubuntu: sudo apt install %s; elsewhere the packages that hold the same' "$names"
    fi
}

# python_fits PYTHON VERSION [static-is-fine]: is it that CPython, with venv, headers and a shared libpython?
python_fits() {
    env -u PYTHONPATH "$1" - "${@:2}" 2>/dev/null <<'PYTHON'
import importlib.util, os, sys, sysconfig
# built from source, a Python lacks what its machine had no headers for
if any(importlib.util.find_spec(name) is None for name in ('ensurepip', 'venv', '_ssl', '_ctypes', '_sqlite3', 'zlib')):
    sys.exit(6)
fits = sys.implementation.name == 'cpython' and '%d.%d' % sys.version_info[:2] == sys.argv[1]
library = os.path.join(sysconfig.get_config_var('LIBDIR') or '', sysconfig.get_config_var('LDLIBRARY') or '')
header = os.path.join(sysconfig.get_path('include'), 'Python.h')
if fits and not os.path.exists(header):
    sys.exit(4)
if fits and '.so' not in os.path.basename(library):
    sys.exit(0 if len(sys.argv) > 2 else 3)
sys.exit(0 if fits and os.path.exists(library) else 5)
PYTHON
}

# find_python VERSION [static-is-fine]: PYTHON is a CPython of that version on PATH, under pyenv, or among uv's; 1 if
# there is none. UNFIT then says why those that were seen do not do.
find_python() {
    local version="$1" candidate status pyenv
    pyenv="$(printf '%s' "$PATH" | tr ':' '\n' | sed -n 's:/bin/*$::; s:/shims/*$::; /[.]\{0,1\}pyenv$/p' | head -1)"
    UNFIT=''
    for candidate in "${STYLE_PYTHON:-}" "$(command -v "python$version" || true)" \
            "${PYENV_ROOT:-$pyenv}"/versions/"$version".*/bin/python \
            "$HOME"/.pyenv/versions/"$version".*/bin/python \
            "$HOME"/.local/share/uv/python/cpython-"$version"*/bin/python "/usr/local/bin/python$version"; do
        [ -n "$candidate" ] && [ -x "$candidate" ] || continue
        status=0
        python_fits "$candidate" "$@" || status=$?
        case $status in
            # of a virtual environment the Python it was made with: in a shell where the workspace is sourced, the first on
            # PATH is the prefix's own
            0) PYTHON="$(env -u PYTHONPATH "$candidate" -c \
                   'import os, sys; print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))')"
               return 0 ;;
            3) UNFIT+=" $candidate has only a static libpython;" ;;
            4) UNFIT+=" $candidate has no Python.h;" ;;
            6) UNFIT+=" $candidate lacks one of ensurepip, venv, ssl, ctypes, sqlite3, zlib;" ;;
        esac
    done
    return 1
}

# need_python VERSION [static-is-fine]: PYTHON is set, after installing it with apt where that is possible
need_python() {
    find_python "$@" && return 0
    if command -v apt-get >/dev/null && [ -n "$(apt-cache search --names-only "^python$1-dev\$" 2>/dev/null)" ]; then
        apt_install "python$1" "python$1-venv" "python$1-dev"
        find_python "$@" && return 0
    fi
    local kind=' with a shared libpython'
    [ $# = 1 ] || kind=''
    die "CPython $1$kind is missing.${UNFIT:+ Seen:$UNFIT}
Install it in one of these ways and run this again:
  sudo apt install python$1 python$1-venv python$1-dev      (where the distribution has it)
  uv python install $1
  PYTHON_CONFIGURE_OPTS=--enable-shared pyenv install $1
or name one: STYLE_PYTHON=/path/to/python$1"
}

# source_ros: the Humble of this machine, or the prefix built for this checkout
source_ros() {
    set +u
    if [ -e "$HUMBLE/setup.bash" ]; then
        . "$HUMBLE/setup.bash"
    else
        [ -e "$PREFIX/setup.bash" ] || die "There is no ROS 2 here yet: run make setup"
        . "$PREFIX/setup.bash"
    fi
    set -u
}

# source_workspace: the built workspace, as a user's shell has it
source_workspace() {
    set +u
    . "$ROOT/install/setup.bash"
    set -u
}
