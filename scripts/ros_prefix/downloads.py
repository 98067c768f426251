"""Everything the prefix downloads: kept in one cache, checked by SHA-256, fetched once."""
import ast
import contextlib
import fcntl
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[2] / 'requirements'
DEBIAN_MIRRORS = ('http://deb.debian.org/debian', 'http://archive.debian.org/debian')
ATTEMPTS = 5
DOWNLOADS = 400e6  # bytes of everything in the cache, with what pip keeps while it downloads
#: of pip's configuration, what says how packages are reached; others (user, target, ...) would put them elsewhere
NETWORK = ('index-url', 'extra-index-url', 'find-links', 'trusted-host', 'proxy', 'cert', 'client-cert', 'timeout',
           'default-timeout', 'keyring-provider')

say = functools.partial(print, flush=True)


class SetupError(Exception):
    """Something the user has to know or do; shown as one line."""


def cache_folder():
    """STYLE_CACHE, else a folder in the user's cache; shared by all checkouts."""
    folder = os.environ.get('STYLE_CACHE')
    if not folder:
        folder = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'style-motion'
    folder = Path(folder).resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / 'lock', 'a'):
            pass
    except OSError as error:
        raise SetupError(f'downloads cannot be kept in {folder} ({error.strerror}); name a folder that you may write: '
                         'STYLE_CACHE=/path/to/folder') from None
    return folder


def check_room(folder, needed):
    """Raise SetupError where the disk of a folder has less than ``needed`` bytes free."""
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise SetupError(f'the disk of {folder} has {free / 1e6:.0f} MB free, {needed / 1e6:.0f} MB are needed')


def sha256(path):
    """Hexadecimal SHA-256 of a file."""
    with open(path, 'rb') as stream:
        return hashlib.file_digest(stream, 'sha256').hexdigest()


@contextlib.contextmanager
def locked(path):
    """One set-up at a time; a second one waits."""
    with open(path, 'w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say('Another set-up is running; waiting for it')
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def write(path, content):
    """Write a file whole or not at all."""
    part = path.with_name(path.name + '.part')
    part.write_bytes(content)
    part.replace(path)


def clean_environment():
    """The environment without what a sourced ROS workspace puts there: other Pythons must not see it."""
    leaking = ('PYTHONPATH', 'PYTHONHOME', 'PYTHONUSERBASE', 'LD_LIBRARY_PATH', 'VIRTUAL_ENV')
    return {name: value for name, value in os.environ.items() if name not in leaking}


@functools.cache
def network_settings(python):
    """What the user's pip files and PIP_ variables say on reaching packages, as variables."""
    done = subprocess.run([python, '-m', 'pip', 'config', 'list'], capture_output=True, text=True,
                          env=clean_environment())
    if done.returncode:
        raise SetupError(f'pip cannot read its configuration: {(done.stderr.strip().splitlines() or ["?"])[-1]}')
    found = {}
    for line in sorted(done.stdout.splitlines(), key=lambda line: line.startswith(':env:')):  # variables come last
        name, _, value = line.partition('=')
        option = name.rpartition('.')[2]
        if option in NETWORK:
            found['PIP_' + option.upper().replace('-', '_')] = ast.literal_eval(value)
    return found


@contextlib.contextmanager
def pip_environment(python):
    """The environment pip runs in: the user's way to the packages and nothing else of the user's pip.

    Temporary files stand in the cache: /tmp is often small.
    """
    with tempfile.TemporaryDirectory(dir=cache_folder(), prefix='tmp-') as scratch:
        yield {**{name: value for name, value in clean_environment().items() if not name.startswith('PIP_')},
               **network_settings(str(python)), 'PIP_CONFIG_FILE': os.devnull, 'TMPDIR': scratch}


def pip(python, *arguments):
    """Run pip of ``python``; raises SetupError with pip's own last words."""
    command = [str(python), '-m', 'pip', '--disable-pip-version-check', *map(str, arguments)]
    with pip_environment(python) as environment:
        failed = subprocess.run(command, env=environment).returncode
    if failed:
        raise SetupError(f'pip failed (see above): {" ".join(command)}')


def pinned(lock):
    """What a file of requirements/ pins: dict of package name to the set of SHA-256 it may have."""
    text = lock.read_text().replace('\\\n', ' ')
    lines = [line for line in text.splitlines() if line and not line.lstrip().startswith('#')]
    return {line.split('==')[0].strip(): set(re.findall(r'--hash=sha256:([0-9a-f]{64})', line)) for line in lines}


def whole(complete, folder, pins):
    """Does the list ``complete`` name a file for every pin, and is each there with the content it had?"""
    try:
        files = dict(line.split() for line in complete.read_text().splitlines())
    except (OSError, ValueError):  # none, or damaged
        return False
    return (all(hashes & set(files.values()) for hashes in pins.values())
            and all((folder / file).is_file() and sha256(folder / file) == digest for file, digest in files.items()))


def stock(folder, pins):
    """The files of a folder that are among the pinned ones: dict of name to SHA-256."""
    allowed = set().union(*pins.values())
    digests = {path.name: sha256(path) for path in sorted(folder.iterdir()) if path.is_file()}
    return {name: digest for name, digest in digests.items() if digest in allowed}


def download(python, name, folder, options, resuming):
    """Download what ``requirements/NAME.txt`` names; files that are there already, whole, are not fetched again.

    pip keeps what has come in a folder of its own, so a stopped download goes on where it was.
    """
    arrived = cache_folder() / 'arrived'
    quiet = ('--progress-bar', 'on') if sys.stderr.isatty() else ('--quiet', '--progress-bar', 'off')
    retry = ('--retries', '5', *(('--resume-retries', '20') if resuming else ()))
    check_room(folder, DOWNLOADS)
    say(f'Downloading the packages of requirements/{name}.txt')
    for attempt in range(1, ATTEMPTS + 1):
        try:
            pip(python, 'download', '--cache-dir', arrived, *quiet, *retry, *options, '--require-hashes',
                '-r', REQUIREMENTS / f'{name}.txt', '-d', folder)
            break
        except SetupError:
            check_room(folder, DOWNLOADS / 4)  # a full disk is no matter of the network
            if attempt == ATTEMPTS:
                raise SetupError(
                    f'the packages of requirements/{name}.txt cannot be downloaded (see above). Is this machine on '
                    'line? What has come is kept; the next set-up goes on from there') from None
            say(f'The download stopped; attempt {attempt + 1} of {ATTEMPTS} in {5 * attempt} s.')
            time.sleep(5 * attempt)
    shutil.rmtree(arrived, ignore_errors=True)


def fetch_wheels(python, name, options=(), resuming=True):
    """Download what ``requirements/NAME.txt`` names into the cache and return the folder.

    A list of the files and their hashes is written when all are there; while it holds they are not looked for again.
    """
    lock = REQUIREMENTS / f'{name}.txt'
    pins = pinned(lock)
    folder = cache_folder() / 'wheels'
    folder.mkdir(exist_ok=True)
    complete = folder.with_name(f'{name}-{sha256(lock)[:12]}.complete')
    if whole(complete, folder, pins):
        return folder
    with locked(cache_folder() / 'lock'):
        if not all(hashes & set(stock(folder, pins).values()) for hashes in pins.values()):
            download(python, name, folder, options, resuming)
        write(complete, ''.join(f'{file} {digest}\n' for file, digest in stock(folder, pins).items()).encode())
        if not whole(complete, folder, pins):
            raise SetupError(f'{folder} does not hold the packages of requirements/{name}.txt after their download')
    return folder


def install(python, name, resuming=True):
    """Install the packages of ``requirements/NAME.txt`` from the cache."""
    wheels = fetch_wheels(python, name, options=('--no-build-isolation',), resuming=resuming)
    pip(python, 'install', '--quiet', '--no-index', '--find-links', wheels, '--no-build-isolation',
        '--no-warn-script-location', '--require-hashes', '-r', REQUIREMENTS / f'{name}.txt')


def fetch_debian_headers():
    """Download the header packages of Debian 12 into the cache; returns their paths."""
    folder = cache_folder() / 'debian'
    folder.mkdir(exist_ok=True)
    paths = []
    for line in (REQUIREMENTS / 'debian_headers.txt').read_text().splitlines():
        if line.startswith('#'):
            continue
        pool, digest = line.split()
        path = folder / Path(pool).name
        if not (path.exists() and sha256(path) == digest):
            fetch_debian(pool, digest, path)
        paths.append(path)
    return paths


def fetch_debian(pool, digest, path):
    """One package: with apt where this machine's apt offers it, else from a Debian mirror."""
    package, version, _ = path.stem.split('_')
    say(f'Downloading {path.name}')
    if shutil.which('apt-get'):
        subprocess.run(['apt-get', '-qq', '-o', 'Acquire::Retries=5', '-o', 'APT::Sandbox::User=root',
                        'download', f'{package}={version}'], cwd=path.parent,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if path.exists() and sha256(path) == digest:
            return
    problem = None
    for attempt in range(ATTEMPTS):
        for mirror in DEBIAN_MIRRORS:
            try:
                with urllib.request.urlopen(f'{mirror}/{pool}', timeout=60) as reply:
                    content = reply.read()
            except OSError as error:
                problem = f'{mirror}/{pool}: {error}'
                continue
            if hashlib.sha256(content).hexdigest() == digest:
                write(path, content)
                return
            problem = f'{mirror}/{pool}: its SHA-256 is not {digest}'
        time.sleep(2 * attempt)
    raise SetupError(f'cannot download {path.name}: {problem}')
