"""Build a ROS 2 Humble prefix from PyPI, for machines that cannot have Humble from apt.

Run by scripts/setup.sh with CPython 3.12: ``python scripts/ros_prefix/build.py PREFIX``. A prefix that is whole and
made by these very scripts is left alone; anything else is built beside it and takes its place when it is whole.
"""
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from ros_prefix import licence, mend
from ros_prefix.downloads import (
    DOWNLOADS,
    REQUIREMENTS,
    SetupError,
    cache_folder,
    check_room,
    clean_environment,
    fetch_wheels,
    install,
    locked,
    say,
    sha256,
    write,
)

STAMP = 'style-prefix-stamp'
ROOM = 1.5e9  # bytes of a prefix, with what building it needs for a while


def stamp_of(prefix):
    """What a whole prefix was made from; differs when a script, a pin, the interpreter or the place changes."""
    sources = sorted([*mend.HERE.rglob('*.py'), *mend.HERE.rglob('*.txt'), *mend.HERE.joinpath('templates').iterdir(),
                      *(REQUIREMENTS / name for name in
                        ('pip.txt', 'ros_prefix.txt', 'ros_tree.txt', 'debian_headers.txt'))])
    return ''.join(f'{sha256(path)} {path.name}\n' for path in sources) + f'{sys.executable}\n{prefix}\n'


def build(prefix):
    """Build ``prefix`` beside its place, then put it there."""
    tree = prefix.with_name(prefix.name + '.part')
    for leftover in (tree, prefix.with_name(prefix.name + '.old')):  # of a set-up that was stopped
        shutil.rmtree(leftover, ignore_errors=True)
    tree.mkdir(parents=True)
    python = tree / 'venv/bin/python3'

    def step(text):
        say(f'[{time.monotonic() - started:4.0f} s] {text}')

    started = time.monotonic()
    step('virtual environment')
    subprocess.run([sys.executable, '-m', 'venv', tree / 'venv'], check=True, env=clean_environment())
    install(python, 'pip', resuming=False)  # the pip that came with Python may not know how to resume
    step('ROS 2 packages')
    wheels = fetch_wheels(python, 'ros_tree', options=('--no-deps', '--only-binary', ':all:'))
    tree_wheel, = wheels.glob('isaacsim_ros2-*.whl')
    mend.unpack(tree_wheel, tree)
    mend.use_system_openssl(tree)
    step('Python packages')
    install(python, 'ros_prefix')
    step('headers and CMake configuration')
    mend.lay_out(tree)
    mend.add_headers(tree, sorted(wheels.glob('ros_*.whl')))
    mend.generate_message_headers(tree, python)
    numpy_include = subprocess.run([python, '-c', 'import numpy; print(numpy.get_include())'], check=True, text=True,
                                   capture_output=True, env=clean_environment()).stdout.strip()
    mend.mend_cmake(tree, prefix, numpy_include.replace(str(tree), str(prefix)))
    mend.add_executables(tree, prefix)
    mend.add_ros2_verbs(tree)
    mend.add_setup_scripts(tree, prefix)
    mend.move_scripts(tree, prefix)
    old = prefix.with_name(prefix.name + '.old')
    if prefix.exists():
        prefix.rename(old)
    tree.rename(prefix)
    shutil.rmtree(old, ignore_errors=True)
    step('check')
    mend.check(prefix)
    write(prefix / STAMP, stamp_of(prefix).encode())
    step(f'ROS 2 Humble stands in {prefix}')


def main(prefix):
    """Exit status 0 when ``prefix`` is whole, 1 with one clear line when it cannot be."""
    prefix = Path(prefix).absolute()
    stamp = prefix / STAMP
    if stamp.exists() and stamp.read_text() == stamp_of(prefix):
        return 0
    if prefix.exists() and not stamp.exists() and any(prefix.iterdir()) and not (prefix / 'venv').exists():
        say(f'Set-up stopped: {prefix} exists and is not a prefix made by this script', file=sys.stderr)
        return 1
    system = (platform.system(), platform.machine(), *platform.libc_ver())
    if system[:3] != ('Linux', 'x86_64', 'glibc') or tuple(map(int, system[3].split('.'))) < (2, 35):
        say(f'Set-up stopped: the packages need Linux on x86_64 with glibc 2.35 or newer; this is {" ".join(system)}. '
            'Install ROS 2 Humble on Ubuntu 22.04 instead (docs/setup.md).', file=sys.stderr)
        return 1
    try:
        prefix.parent.mkdir(parents=True, exist_ok=True)
        with locked(prefix.with_name(prefix.name + '.lock')):  # a second set-up waits, then finds the prefix
            if stamp.exists() and stamp.read_text() == stamp_of(prefix):
                return 0
            licence.accept()
            say(f'Downloads are kept in {cache_folder()}')
            check_room(prefix.parent, ROOM)
            if not any(cache_folder().glob('*.complete')):
                check_room(cache_folder(), DOWNLOADS)
            build(prefix)
    except (SetupError, subprocess.CalledProcessError) as error:
        say(f'Set-up stopped: {error}', file=sys.stderr)
        return 1
    except OSError as error:  # read only, not ours, full: the message of the system and the path say which
        where = error.filename2 or error.filename or prefix
        say(f'Set-up stopped: {where}: {error.strerror}. The prefix is built in {prefix} (STYLE_ROS_PREFIX names '
            'another folder), downloads are kept in the cache (STYLE_CACHE)', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        say('Set-up stopped; the next one goes on with what is downloaded.', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    os.umask(0o022)
    sys.exit(main(*sys.argv[1:]))
