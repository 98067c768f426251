"""What situations are made with: copies of the checkout, folders of commands, other users, small disks."""
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PREFIX = Path(os.environ.get('STYLE_ROS_PREFIX') or ROOT / '.ros2/humble')
CACHE = Path(os.environ.get('STYLE_CACHE') or
             Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'style-motion')
NOBODY = 54321  # a user id that no machine knows
SITUATIONS = []


class Skipped(Exception):
    """This machine cannot play the situation."""


def situation(text):
    """Register a function as a situation; it returns what to print beside it."""
    def register(function):
        SITUATIONS.append((text, function))
        return function
    return register


def scratch():
    """A new folder that everybody may enter."""
    folder = Path(tempfile.mkdtemp(prefix='style-setup-'))
    folder.chmod(0o755)
    return folder


def checkout(folder=None, name='checkout'):
    """A clone of this checkout with its uncommitted changes; nothing is built in it."""
    place = (folder or scratch()) / name
    subprocess.run(['git', 'clone', '--quiet', ROOT, place], check=True)
    changed = subprocess.run(['git', 'diff', '--name-only', 'HEAD', '--diff-filter=d'], cwd=ROOT, text=True, check=True,
                             capture_output=True).stdout.split()
    for file in changed:
        place.joinpath(file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, place / file)
    return place


def commands_without(*missing):
    """A PATH of one folder that holds the machine's commands but those whose name starts with one of ``missing``."""
    folder = scratch() / 'bin'
    folder.mkdir()
    for path in os.environ['PATH'].split(':'):
        if 'ccache' in path or not os.path.isdir(path):
            continue
        for command in os.listdir(path):
            if not command.startswith(missing) and not folder.joinpath(command).exists():
                folder.joinpath(command).symlink_to(os.path.join(path, command))
    return str(folder)


def run(command, *, cwd, user=None, unset=(), timeout=1200, **variables):
    """Run a command without a terminal and return the finished process; its output is one text.

    ``user`` runs it as another user id, which needs root; ``unset`` names variables to leave out.
    """
    environment = {name: value for name, value in os.environ.items()
                   if name not in (*unset, 'PYTHONPATH', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH',
                                   'STYLE_ROS_PREFIX', 'STYLE_ACCEPT_LICENSE', 'CONDA_PREFIX', 'ROS_DISTRO')}
    environment.update({name: str(value) for name, value in variables.items()})
    if user is not None:
        if os.getuid() != 0 or not shutil.which('setpriv'):
            raise Skipped('only root can become another user')
        command = ['setpriv', f'--reuid={user}', f'--regid={user}', '--clear-groups', '--', *command]
    return subprocess.run([str(word) for word in command], cwd=cwd, env=environment, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout)


def last_line(done):
    """What a user sees last."""
    return (done.stdout.strip().splitlines() or [''])[-1]


def refused(done, *words):
    """Assert that a command failed with these words and no traceback, and return the line that holds the first."""
    assert done.returncode != 0, f'it did not fail:\n{done.stdout}'
    assert 'Traceback' not in done.stdout, done.stdout
    for word in words:
        assert word in done.stdout, f'{word!r} is not in:\n{done.stdout}'
    return next(line for line in done.stdout.splitlines() if words[0] in line)


def accepted(done):
    """Assert that a command succeeded."""
    assert done.returncode == 0, f'exit status {done.returncode}:\n{done.stdout[-3000:]}'
    return done


def need_prefix():
    """Skip where there is no ROS 2 to build a workspace on."""
    if not PREFIX.joinpath('setup.bash').exists():
        raise Skipped(f'no prefix at {PREFIX}')


def copied_cache():
    """The downloads of this user, linked: changing a list leaves the original alone."""
    if not CACHE.joinpath('wheels').is_dir():
        raise Skipped(f'no downloads in {CACHE}')
    place = scratch() / 'cache'
    place.mkdir()
    for part in CACHE.iterdir():
        if part.is_file():
            shutil.copy(part, place)
    for folder in ('wheels', 'debian'):
        place.joinpath(folder).mkdir()
        for file in CACHE.joinpath(folder).iterdir():
            try:
                os.link(file, place / folder / file.name)
            except OSError:  # another disk
                shutil.copy(file, place / folder)
    return place
