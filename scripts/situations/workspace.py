"""Workspaces that are stale, half built, moved, or built twice at once."""
import os
import signal
import subprocess
import time

from situations.stage import PREFIX, accepted, checkout, need_prefix, refused, run, scratch, situation

BUILD = ['scripts/build.sh']
#: builds in seconds, so that what is judged is whether something is built and not how long it takes
SMALL = [*BUILD, '--packages-select', 'style_core', 'style_node']


def build(place, command=BUILD):
    """Build a workspace on the prefix of this checkout."""
    return accepted(run(command, cwd=place, STYLE_ROS_PREFIX=PREFIX))


def in_workspace(place, command):
    """Output of a command in a shell that has sourced the workspace."""
    return run(['bash', '-c', f'source install/setup.bash && {command}'], cwd=place)


def append(path, text):
    """Append to a file and give it a time stamp long ago, as rsync and tar do."""
    path.write_text(path.read_text() + text)
    os.utime(path, (1e9, 1e9))


@situation('two builds of one fresh checkout at once')
def two_builds_at_once():
    need_prefix()
    place = checkout()
    first = subprocess.Popen(BUILD, cwd=place, env={**os.environ, 'STYLE_ROS_PREFIX': str(PREFIX)},
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not place.joinpath('.build.lock').exists() and first.poll() is None:
        time.sleep(0.05)
    second = build(place)
    assert first.wait() == 0
    assert 'waiting for it' in second.stdout
    assert 'Starting >>>' not in second.stdout, 'the second build built again what the first had built'
    assert in_workspace(place, 'motion-style --version').returncode == 0
    return 'the second waits, then finds everything built'


@situation('a source edited while a build runs')
def edit_during_a_build():
    need_prefix()
    place = checkout()
    running = subprocess.Popen(BUILD, cwd=place, env={**os.environ, 'STYLE_ROS_PREFIX': str(PREFIX)},
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not place.joinpath('build/style_core').exists() and running.poll() is None:
        time.sleep(0.05)
    append(place / 'src/style_msgs/msg/StyleVector.msg', 'float64 edited\n')
    assert running.wait() == 0
    build(place)
    shown = in_workspace(place, 'ros2 interface show style_msgs/msg/StyleVector').stdout
    assert 'edited' in shown, shown
    assert 'Starting >>>' not in build(place).stdout
    return 'the next build builds it, the one after that does nothing'


@situation('a kernel that changed and has an old time stamp (rsync, tar)')
def older_time_stamp():
    need_prefix()
    place = checkout()
    build(place, SMALL)
    append(place / 'src/style_core/style_core/wire/crc16.pyx', '\ndef edited():\n    return 7\n')
    program = 'python3 -c "from style_core.wire import crc16; print(crc16.edited())"'
    said = refused(in_workspace(place, program), 'crc16.pyx changed after the last build')
    build(place, SMALL)
    assert in_workspace(place, program).stdout.strip() == '7'
    return f'"{said.split(": ")[1][:44]} ...", and then it is built'


@situation('a checkout that was moved, on a shared prefix')
def moved_checkout():
    need_prefix()
    place = checkout()
    build(place, SMALL)
    moved = place.rename(scratch() / 'elsewhere')
    build(moved, SMALL)
    found = in_workspace(moved, 'ros2 pkg prefix style_node; python3 -c "import style_node as it; print(it.__file__)"')
    assert found.returncode == 0 and str(place) not in found.stdout and str(moved) in found.stdout, found.stdout
    return 'it is built anew at its new place'


@situation('a build killed with kill -9')
def killed_build():
    need_prefix()
    place = checkout()
    running = subprocess.Popen(BUILD, cwd=place, env={**os.environ, 'STYLE_ROS_PREFIX': str(PREFIX)},
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    while not place.joinpath('build/style_core').exists() and running.poll() is None:
        time.sleep(0.05)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    build(place)
    assert in_workspace(place, 'motion-style --version && ros2 pkg prefix style_msgs').returncode == 0
    return 'the next build goes on'
