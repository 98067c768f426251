"""Are the compiled kernels those of the sources beside them? (Editable installs do not rebuild what has changed.)"""
import hashlib
import json
import sysconfig
from pathlib import Path

__all__ = ['digests', 'record_path', 'check']

PACKAGE = Path(__file__).parent


def record_path(package):
    """Where setup.py keeps what a build in place was made from; there is none in an installed wheel."""
    return package / f'.kernels{sysconfig.get_config_var("EXT_SUFFIX")}.json'


def digests(package):
    """Hash of every .pyx of a package with the .h and .pxd beside it and the .pxd at the top, by relative path."""
    found, common = {}, sorted(package.glob('*.pxd'))
    for path in sorted(package.rglob('*.pyx')):
        beside = sorted([*path.parent.glob('*.h'), *path.parent.glob('*.pxd')])
        texts = [other.read_bytes() for other in (path, *beside, *common)]
        found[path.relative_to(package).as_posix()] = hashlib.sha256(b'\0'.join(texts)).hexdigest()
    return found


def check(package=PACKAGE):
    """Raise ImportError where a kernel was changed after it was built; does nothing in an installed wheel."""
    try:
        built = json.loads(record_path(package).read_text())
    except FileNotFoundError:
        return
    changed = sorted(name for name, digest in digests(package).items() if built.get(name) != digest)
    if changed:
        raise ImportError(f'{", ".join(changed)} changed after the last build. Build again: scripts/build.sh in the '
                          f'workspace, or for this Python: pip install --no-deps -e {package.parent}')
