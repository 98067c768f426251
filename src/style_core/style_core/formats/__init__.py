"""Readers and writers of motion files, one module a format, chosen by the file's suffix."""
import importlib
from pathlib import Path

from style_core.errors import MotionError

__all__ = ['FORMATS', 'read_motion', 'write_motion']

#: suffix -> module with ``read(path, **options) -> Motion``, ``write(motion, path, **options)`` and the names of
#: both functions' options in ``READ_OPTIONS`` and ``WRITE_OPTIONS``
FORMATS = {
    '.amc': 'style_core.formats.amc',
}


def read_motion(path, skeleton=None, **options):
    """Read a motion file of any known format.

    Parameters
    ----------
    path : path-like
    skeleton : Skeleton, optional
        For formats that do not describe their joints (AMC).
    rate_hz : float, optional
        The recording's rate, for formats that do not say (AMC: 120).

    Returns
    -------
    Motion

    Raises
    ------
    MotionError
        If the file is absent, damaged or of an unknown format.
    """
    path = Path(path)
    module = _module(path)
    given = {key: value for key, value in dict(options, skeleton=skeleton).items() if value is not None}
    unfit = sorted(set(given) - set(module.READ_OPTIONS) - {'skeleton'})
    if unfit:
        raise MotionError(f'{path}: {", ".join(unfit)} means nothing for a {path.suffix} file')
    return module.read(path, **{key: value for key, value in given.items() if key in module.READ_OPTIONS})


def write_motion(motion, path, skeleton=None, **options):
    """Write a motion file; the suffix says which format. An existing file is replaced only by a complete new one.

    Raises
    ------
    MotionError
        If the format cannot hold the motion; the message says why.
    """
    path = Path(path)
    module = _module(path)
    given = {key: value for key, value in dict(options, skeleton=skeleton).items() if value is not None}
    unfit = sorted(set(given) - set(module.WRITE_OPTIONS) - {'skeleton'})
    if unfit:
        raise MotionError(f'{path}: {", ".join(unfit)} means nothing for a {path.suffix} file')
    module.write(motion, path, **{key: value for key, value in given.items() if key in module.WRITE_OPTIONS})


def _module(path):
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise MotionError(f'{path}: no format has the suffix {suffix!r}; known are {", ".join(sorted(FORMATS))}')
    return importlib.import_module(FORMATS[suffix])
