"""Everything the prefix downloads: kept in one cache, checked by SHA-256, fetched once."""
import contextlib
import fcntl
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[2] / 'requirements'
DEBIAN_MIRRORS = ('http://deb.debian.org/debian', 'http://archive.debian.org/debian')
ATTEMPTS = 5

say = functools.partial(print, flush=True)


class SetupError(Exception):
    """Something the user has to know or do; shown as one line."""


def cache_folder():
    """STYLE_CACHE, else a folder in the user's cache; shared by all checkouts."""
    folder = os.environ.get('STYLE_CACHE')
    if not folder:
        folder = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'style-motion'
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def sha256(path):
    """Hexadecimal SHA-256 of a file."""
    with open(path, 'rb') as stream:
        return hashlib.file_digest(stream, 'sha256').hexdigest()


@contextlib.contextmanager
def locked(path):
    """One set-up at a time; a second one waits."""
    with open(path, 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def write(path, content):
    """Write a file whole or not at all."""
    part = path.with_name(path.name + '.part')
    part.write_bytes(content)
    part.replace(path)


def clean_environment():
    """The environment without what a sourced ROS workspace puts there: other Pythons must not see it."""
    leaking = ('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH', 'VIRTUAL_ENV',
               'PIP_NO_CACHE_DIR', 'PIP_TARGET', 'PIP_USER')
    return {name: value for name, value in os.environ.items() if name not in leaking}


def pip(python, *arguments):
    """Run pip of ``python``; raises SetupError with pip's own last words."""
    command = [str(python), '-m', 'pip', '--disable-pip-version-check', *map(str, arguments)]
    if subprocess.run(command, env=clean_environment()).returncode:
        raise SetupError(f'pip failed (see above): {" ".join(command)}')


def fetch_wheels(python, name, options=(), resuming=True):
    """Download what ``requirements/NAME.txt`` names into the cache and return the folder.

    A list of the files and their hashes is written when all are there; while it holds, the network is not used.
    Until then pip keeps what has come in a folder of its own, so a stopped download goes on where it was.
    """
    lock = REQUIREMENTS / f'{name}.txt'
    folder = cache_folder() / 'wheels'
    folder.mkdir(exist_ok=True)
    complete = folder.with_name(f'{name}-{sha256(lock)[:12]}.complete')
    if complete.exists():
        files = dict(line.split() for line in complete.read_text().splitlines())
        if all(folder.joinpath(file).exists() and sha256(folder / file) == files[file] for file in files):
            return folder
    arrived = cache_folder() / 'arrived'
    quiet = ('--progress-bar', 'on') if sys.stderr.isatty() else ('--quiet', '--progress-bar', 'off')
    retry = ('--retries', '5', *(('--resume-retries', '20') if resuming else ()))
    with locked(cache_folder() / 'lock'):
        say(f'Downloading the packages of requirements/{name}.txt')
        for attempt in range(1, ATTEMPTS + 1):
            try:  # files that are there already, whole, are not fetched again
                pip(python, 'download', '--cache-dir', arrived, *quiet, *retry, *options, '--require-hashes',
                    '-r', lock, '-d', folder)
                break
            except SetupError:
                if attempt == ATTEMPTS:
                    raise SetupError(
                        f'the packages of requirements/{name}.txt cannot be downloaded (see above). Is this machine on '
                        'line? What has come is kept; the next set-up goes on from there') from None
                say(f'The download stopped; attempt {attempt + 1} of {ATTEMPTS} in {5 * attempt} s.')
                time.sleep(5 * attempt)
        allowed = set(re.findall(r'--hash=sha256:([0-9a-f]{64})', lock.read_text()))
        files = {path.name: sha256(path) for path in sorted(folder.iterdir())}
        write(complete, ''.join(f'{file} {digest}\n' for file, digest in files.items() if digest in allowed).encode())
        shutil.rmtree(arrived, ignore_errors=True)
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
