"""Everything the prefix downloads: kept in one cache, checked by SHA-256, fetched once."""
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.error
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


def clean_environment():
    """The environment without what a sourced ROS workspace puts there: other Pythons must not see it."""
    return {k: v for k, v in os.environ.items() if k not in ('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH')}


def pip(python, *arguments):
    """Run pip of ``python``; raises SetupError with pip's own last words."""
    command = [str(python), '-m', 'pip', '--disable-pip-version-check', *map(str, arguments)]
    if subprocess.run(command, env=clean_environment()).returncode:
        raise SetupError(f'pip failed (see above): {" ".join(command)}')


def fetch_wheels(python, name, options=(), resuming=True):
    """Download what ``requirements/NAME.txt`` names into the cache and return the folder.

    A list of the files and their hashes is written when all are there; while it holds, the network is not used.
    """
    lock = REQUIREMENTS / f'{name}.txt'
    allowed = set(re.findall(r'--hash=sha256:([0-9a-f]{64})', lock.read_text()))
    folder = cache_folder() / f'{name}-{sha256(lock)[:12]}'
    folder.mkdir(exist_ok=True)
    complete = folder / 'complete'
    if complete.exists():
        have = {path.name: sha256(path) for path in folder.iterdir() if path != complete}
        if have == dict(line.split() for line in complete.read_text().splitlines()):
            return folder
        complete.unlink()
        for file, digest in have.items():  # damaged since: only these are fetched again
            if digest not in allowed:
                (folder / file).unlink()
    say(f'Downloading the packages of requirements/{name}.txt into {folder}')
    retry = ('--retries', '10', *(('--resume-retries', '20') if resuming else ()))
    for attempt in range(1, ATTEMPTS + 1):
        try:
            pip(python, 'download', '--progress-bar', 'on' if sys.stderr.isatty() else 'off', *retry, *options,
                '--require-hashes', '-r', lock, '-d', folder, *(() if sys.stderr.isatty() else ('--quiet',)))
            break
        except SetupError:
            if attempt == ATTEMPTS:
                raise
            say(f'The download stopped; attempt {attempt + 1} of {ATTEMPTS} in {5 * attempt} s.')
            time.sleep(5 * attempt)
    complete.write_text(''.join(f'{path.name} {sha256(path)}\n' for path in sorted(folder.iterdir())))
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
                part = path.with_suffix('.part')
                part.write_bytes(content)
                part.replace(path)
                return
            problem = f'{mirror}/{pool}: its SHA-256 is not {digest}'
        time.sleep(2 * attempt)
    raise SetupError(f'cannot download {path.name}: {problem}')
