"""Model files: one ``.npz`` with a JSON header, never pickle."""
import hashlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from style_core import __version__
from style_core.archive import read_archive
from style_core.errors import ModelError

__all__ = ['FORMAT_VERSION', 'save_model', 'load_model', 'read_header', 'training_files']

FORMAT_VERSION = 1
_HEADER = 'header_json'
_REQUIRED = ('kind', 'joint_names')


def training_files(paths):
    """Describe training files for a header.

    Parameters
    ----------
    paths : iterable of path-like
        The recordings a model was trained on.

    Returns
    -------
    list of dict
        ``{'name', 'sha256'}`` of each file; only the file's own name, as folders differ between machines.
    """
    return [{'name': Path(path).name, 'sha256': hashlib.sha256(Path(path).read_bytes()).hexdigest()}
            for path in paths]


def save_model(path, kind, header, arrays):
    """Write a model file; an existing file is replaced only once the new one is complete.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``.
    kind : str
        Model kind, e.g. ``'phase-style'``.
    header : dict
        JSON-serialisable; must hold ``joint_names`` (list of str). ``format_version``, ``kind`` and
        ``package_version`` are added.
    arrays : dict of str to ndarray
        Numeric arrays of any shape.

    Raises
    ------
    ModelError
        If the name does not end in ``.npz`` or an array is not numeric or not finite where it is floating.
    """
    path = Path(path)
    if path.suffix != '.npz':
        raise ModelError(f'model file {path.name!r} must end in .npz')
    full = dict(header, format_version=FORMAT_VERSION, kind=kind, package_version=__version__)
    missing = [key for key in _REQUIRED if key not in full]
    if missing:
        raise ModelError(f'model header lacks {", ".join(missing)}')
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind not in 'fiub':
            raise ModelError(f'array {name!r} of a {kind} model is not numeric')
    descriptor, temporary = tempfile.mkstemp(dir=path.parent or '.', prefix='.' + path.name, suffix='.part')
    try:
        with os.fdopen(descriptor, 'wb') as stream:
            np.savez_compressed(stream, **{_HEADER: np.array(json.dumps(full, sort_keys=True))}, **arrays)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def load_model(path, kind=None):
    """Read a model file.

    Parameters
    ----------
    path : path-like
    kind : str, optional
        Refuse any other kind.

    Returns
    -------
    header : dict
    arrays : dict of str to ndarray

    Raises
    ------
    ModelError
        If the file is missing, truncated, not a model file, of a newer format or of another kind.
    """
    path = Path(path)
    try:
        arrays = read_archive(path)
        if _HEADER not in arrays:
            raise ModelError(f'{path} is an .npz file but not a model file: it has no header')
        header = json.loads(str(arrays.pop(_HEADER)[()]))
    except FileNotFoundError:
        raise ModelError(f'model file {path} does not exist') from None
    except IsADirectoryError:
        raise ModelError(f'{path} is a folder, not a model file') from None
    except ModelError:
        raise
    except (OSError, ValueError, RecursionError, IndexError) as error:
        raise ModelError(f'{path} is not a readable model file: {error}') from None
    if not isinstance(header, dict) or any(key not in header for key in _REQUIRED + ('format_version',)):
        raise ModelError(f'{path} has an incomplete model header')
    if header['format_version'] != FORMAT_VERSION:
        raise ModelError(f'{path} has format version {header["format_version"]}, this program reads '
                         f'{FORMAT_VERSION}: train it again or use the matching version of style_core')
    if kind is not None and header['kind'] != kind:
        raise ModelError(f'{path} holds a model of kind {header["kind"]}, but kind {kind} is needed here')
    return header, arrays


def read_header(path):
    """Return the JSON header of a model file (see `load_model` for the errors)."""
    return load_model(path)[0]
