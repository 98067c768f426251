"""Machines that lack something, folders that cannot be written, damaged caches, and the licence question."""
import contextlib
import os
import pty
import shutil
import subprocess
import sys
import time
from pathlib import Path

from situations.stage import (
    CACHE,
    NOBODY,
    PREFIX,
    Skipped,
    accepted,
    checkout,
    commands_without,
    copied_cache,
    last_line,
    need_prefix,
    refused,
    run,
    scratch,
    situation,
)

SETUP = ['make', 'setup']
#: the part of the set-up that a situation is about, run by the Python that builds prefixes
PROGRAM = 'import sys; sys.path.insert(0, "scripts"); from ros_prefix import {modules}; {statements}'


def with_prefix_python(place, modules, statements, **options):
    """Run statements over the modules that build the prefix."""
    found = run(['bash', '-c', '. scripts/common.sh; need_python 3.12; echo "$PYTHON"'], cwd=place)
    return run([last_line(accepted(found)), '-c', PROGRAM.format(modules=modules, statements=statements)], cwd=place,
               **options)


def small_disk(megabytes):
    """A folder on a disk of its own, of that size."""
    folder = scratch() / 'disk'
    folder.mkdir()
    if os.getuid() != 0 or subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={megabytes}m', 'tmpfs', folder],
                                          stderr=subprocess.DEVNULL).returncode:
        raise Skipped('only root can mount a small disk')
    return folder


@contextlib.contextmanager
def read_only(folder):
    """Make a folder read only, for root too."""
    mount = ['mount', '--bind', '-o', 'ro', folder, folder]
    if os.getuid() != 0 or subprocess.run(mount, stderr=subprocess.DEVNULL).returncode:
        raise Skipped('only root can mount a folder read only')
    try:
        yield folder
    finally:
        subprocess.run(['umount', folder], check=True)


def at_a_terminal(command, cwd, typed, until, **variables):
    """Output of a command that has a terminal, into which ``typed`` is typed when it has said ``until``."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(cwd)
        environment = {name: value for name, value in os.environ.items()
                       if not name.startswith(('STYLE_', 'PYTHONPATH'))}
        os.execvpe(command[0], command, {**environment, **variables})
    output, sent, end = '', False, time.monotonic() + 120
    while time.monotonic() < end:
        try:
            output += os.read(terminal, 4096).decode(errors='replace')
        except OSError:  # it has ended
            break
        if until in output and not sent:
            os.write(terminal, typed.encode())
            sent = True
        if sent and 'Downloads are kept in' in output:  # it goes on: enough is seen
            break
    os.close(terminal)
    os.waitpid(pid, 0)
    return output


@situation('no dpkg, ar or apt (Fedora, Arch, openSUSE): headers are unpacked')
def no_dpkg():
    if not CACHE.joinpath('debian').is_dir():
        raise Skipped(f'no packages in {CACHE}')
    place, ours, theirs = checkout(), scratch() / 'ours', scratch() / 'theirs'
    statements = (f'import pathlib; packages = sorted(pathlib.Path("{CACHE}/debian").glob("*.deb")); '
                  f'[debian.unpack(path, pathlib.Path("{ours}")) for path in packages]')
    accepted(with_prefix_python(place, 'debian', statements,
                                PATH=commands_without('dpkg', 'apt', 'ar', 'xz', 'tar')))
    if shutil.which('dpkg-deb'):
        for package in sorted(CACHE.joinpath('debian').glob('*.deb')):
            subprocess.run(['dpkg-deb', '-x', package, theirs], check=True)
        subprocess.run(['diff', '-r', '--no-dereference', ours, theirs], check=True)
    return f'{sum(path.is_file() for path in ours.rglob("*"))} files, the same as dpkg-deb unpacks'


@situation('no compiler and no apt')
def no_compiler():
    return refused(run(SETUP, cwd=checkout(), PATH=commands_without('dpkg', 'apt', 'gcc', 'g++', 'cc', 'c++')),
                   'Missing, and not installable from here: gcc g++')


@situation('no CPython 3.12')
def no_python_312():
    home = scratch()
    done = run(SETUP, cwd=checkout(), PATH=commands_without('python', 'pyenv', 'apt', 'uv'), HOME=home,
               unset=('PYENV_ROOT', 'STYLE_PYTHON'))
    return refused(done, 'CPython 3.12 with a shared libpython is missing')


@situation('no CPython 3.10 for the floor tests')
def no_python_310():
    home = scratch()
    done = run(['scripts/test_floor.sh'], cwd=checkout(), HOME=home,
               PATH=commands_without('python', 'pyenv', 'apt', 'uv'), unset=('PYENV_ROOT', 'STYLE_PYTHON'))
    return refused(done, 'CPython 3.10 is missing')


@situation('a path with non-ASCII letters')
def non_ascii_path():
    return _refused_path('Bücher')


@situation('a path with a space')
def space_in_path():
    return _refused_path('my robots')


def _refused_path(name):
    started = time.monotonic()
    refused(run(SETUP, cwd=checkout(name=name)), 'do not bear', 'move the checkout')
    assert time.monotonic() - started < 30
    return 'refused at once, with the letters that are fine'


@situation('a read-only checkout in which nothing is built')
def read_only_checkout():
    need_prefix()
    with read_only(checkout()) as place:
        return refused(run(['scripts/build.sh'], cwd=place, STYLE_ROS_PREFIX=PREFIX), 'cannot be written')


@situation('a read-only checkout, and no prefix yet')
def read_only_without_prefix():
    with read_only(checkout()) as place:
        return refused(run(SETUP, cwd=place), 'Set-up stopped:')


@situation('a checkout of somebody else')
def checkout_of_somebody():
    need_prefix()
    return refused(run(['scripts/build.sh'], cwd=checkout(), user=NOBODY, HOME='/', STYLE_ROS_PREFIX=PREFIX),
                   'cannot be written' if os.access(PREFIX, os.R_OK) else 'There is no ROS 2')


@situation('a read-only home')
def read_only_home():
    with read_only(scratch()) as home:
        return refused(run(SETUP, cwd=checkout(), HOME=home, unset=('STYLE_CACHE', 'XDG_CACHE_HOME')),
                       'downloads cannot be kept in')


@situation('no HOME, and a user whom the machine does not know')
def no_home():
    return refused(run(SETUP, cwd=checkout(), user=NOBODY, unset=('HOME',)), 'HOME is not set')


@situation('no HOME, a user whom the machine knows')
def home_from_passwd():
    done = accepted(run(['bash', '-c', '. scripts/common.sh; echo "$HOME"'], cwd=checkout(), unset=('HOME',)))
    return f'HOME is {last_line(done)}'


@situation('`user = true` and `target` in pip.conf')
def pip_user():
    return _with_pip_conf('[global]\nuser = true\n[install]\ntarget = /nowhere\n')


@situation('a damaged pip.conf')
def pip_damaged():
    home, place = scratch(), checkout()
    home.joinpath('.pip').mkdir()
    home.joinpath('.pip/pip.conf').write_text('no section here\n')
    return refused(run(SETUP, cwd=place, HOME=home, STYLE_CACHE=copied_cache()), 'pip cannot read its configuration')


def _with_pip_conf(text):
    home, place = scratch(), checkout()
    home.joinpath('.pip').mkdir()
    home.joinpath('.pip/pip.conf').write_text(text)
    environment = scratch() / 'venv'
    statements = (f'import subprocess; subprocess.run([sys.executable, "-m", "venv", "{environment}"], check=True); '
                  f'downloads.install("{environment}/bin/python", "pip", resuming=False)')
    accepted(with_prefix_python(place, 'downloads', statements, HOME=home, STYLE_CACHE=copied_cache()))
    done = run([environment / 'bin/pip', '--version'], cwd=place)
    assert str(environment) in done.stdout
    return 'packages go where they belong: ' + last_line(done).split(' from ')[0]


@situation('a full disk for downloads')
def full_cache_disk():
    disk = small_disk(20)
    try:
        return refused(run(SETUP, cwd=checkout(), STYLE_CACHE=disk), 'MB free')
    finally:
        subprocess.run(['umount', disk])


@situation('a disk too small for the prefix')
def full_prefix_disk():
    disk = small_disk(200)
    try:
        return refused(run(SETUP, cwd=checkout(), STYLE_ROS_PREFIX=disk / 'humble', STYLE_CACHE=copied_cache()),
                       'MB free')
    finally:
        subprocess.run(['umount', disk])


@situation('a damaged, an empty and a missing list in the cache, without network')
def damaged_lists():
    place, cache = checkout(), copied_cache()
    statements = 'print(downloads.fetch_wheels(sys.executable, "ros_tree"))'
    for damage in (b'\xff\x00 \n', b'', None, b'one_word\n', b'gone.whl 00\n'):
        for path in cache.glob('ros_tree-*.complete'):
            path.unlink()
            if damage is not None:
                path.write_bytes(damage)
        done = with_prefix_python(place, 'downloads', statements, STYLE_CACHE=cache, PIP_INDEX_URL='http://127.0.0.1:9/')
        assert last_line(accepted(done)) == str(cache / 'wheels')
    return 'made anew from the files that are there; nothing is fetched'


@situation('a damaged file in the cache')
def damaged_wheel():
    place, cache = checkout(), copied_cache()
    wheel = next(cache.glob('wheels/pip-*.whl'))
    content = wheel.read_bytes()
    wheel.unlink()  # it is linked to the original
    wheel.write_bytes(content[:1000])
    accepted(with_prefix_python(place, 'downloads',
                                'downloads.fetch_wheels(sys.executable, "pip", resuming=False)', STYLE_CACHE=cache))
    assert wheel.read_bytes() == content
    return 'fetched again'


@situation('the licence question at a terminal: n')
def licence_refused():
    output = at_a_terminal(SETUP, checkout(), 'n\n', 'Enter goes on', STYLE_CACHE=str(scratch() / 'cache'))
    assert 'NVIDIA Omniverse License Agreement' in output
    assert 'nothing was downloaded' in output, output
    return 'the set-up stops, nothing was downloaded'


@situation('the licence question at a terminal: Enter, and again')
def licence_accepted():
    place, cache = checkout(), scratch() / 'cache'
    first = at_a_terminal(SETUP, place, '\n', 'Enter goes on', STYLE_CACHE=str(cache))
    assert 'Downloads are kept in' in first, first
    second = at_a_terminal(SETUP, place, '', 'virtual environment', STYLE_CACHE=str(cache))
    assert 'Enter goes on' not in second
    return 'goes on; asked once'


@situation('the licence without a terminal, and answered by STYLE_ACCEPT_LICENSE')
def licence_unattended():
    place = checkout()
    statements = 'licence.accept(); print("on")'
    unattended = accepted(with_prefix_python(place, 'licence', statements, STYLE_CACHE=scratch() / 'a'))
    assert 'NVIDIA Omniverse License Agreement' in unattended.stdout and last_line(unattended) == 'on'
    assert last_line(with_prefix_python(place, 'licence', statements, STYLE_CACHE=scratch() / 'b',
                                        STYLE_ACCEPT_LICENSE='1')) == 'on'
    refused(run(SETUP, cwd=place, STYLE_CACHE=scratch() / 'c', STYLE_ACCEPT_LICENSE='0'),
            'the licence was not accepted')
    return 'said and not asked; 1 goes on, 0 stops'


@situation('set-up from nothing but the downloads, without dpkg and apt')
def whole_setup_without_dpkg():
    if '--whole' not in sys.argv:
        raise Skipped('takes minutes: scripts/test_setup.sh --whole')
    place = checkout()
    accepted(run(SETUP, cwd=place, PATH=commands_without('dpkg', 'apt', 'ar'), STYLE_CACHE=copied_cache(),
                 timeout=3600))
    done = accepted(run(['bash', '-c', 'source install/setup.bash && motion-style --version'], cwd=Path(place)))
    return last_line(done)
