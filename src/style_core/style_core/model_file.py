"""Model files: one ``.npz`` with a JSON header, never pickle."""
import hashlib
import json
from pathlib import Path

import numpy as np

from style_core import __version__
from style_core.archive import read_archive
from style_core.errors import ModelError, MotionError
from style_core.formats.files import replacing, write_arrays
from style_core.model_schema import check_model

__all__ = ['FORMAT_VERSION', 'save_model', 'load_model', 'read_header', 'write_archive', 'training_files',
           'was_trained_on']

FORMAT_VERSION = 1
_HEADER = 'header_json'
_CHECKSUM = 'sha256'
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
    return [{'name': Path(path).name, 'sha256': _digest(path)} for path in paths]


def _digest(path):
    """SHA-256 of a file, or of all files of a folder (a bag) in the order of their names."""
    path = Path(path)
    files = sorted(one for one in path.rglob('*') if one.is_file()) if path.is_dir() else [path]
    return hashlib.sha256(b''.join(one.read_bytes() for one in files)).hexdigest()


def was_trained_on(header, path):
    """Whether a recording is, byte for byte, one that a model was trained on (by the hashes in its header)."""
    known = {entry.get('sha256') for key in ('training', 'training_files') for entry in header.get(key) or ()
             if isinstance(entry, dict)}
    return bool(known) and _digest(path) in known


def save_model(path, kind, header, arrays):
    """Write a model file; an existing file is replaced only once the new one is complete.

    What `load_model` would refuse is not written.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``.
    kind : str
        Model kind, e.g. ``'phase-style'``.
    header : dict
        JSON-serialisable; must hold ``joint_names`` (list of str). ``format_version``, ``kind``,
        ``package_version`` and a checksum are added.
    arrays : dict of str to ndarray
        Numeric arrays of any shape.

    Raises
    ------
    ModelError
        If the name does not end in ``.npz``, the contents are no sound model of the kind, or the file cannot be
        written. The old file stays.
    """
    path = Path(path)
    if path.suffix != '.npz':
        raise ModelError(f'model file {path.name!r} must end in .npz')
    full = dict(header, format_version=FORMAT_VERSION, kind=kind, package_version=__version__)
    if 'joint_names' not in full:
        raise ModelError('model header lacks joint_names')
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    try:
        full = json.loads(json.dumps(full, allow_nan=False))
    except ValueError:
        raise ModelError(f'{path} is not written: a number in the header of this {kind} model is not finite') from None
    try:
        check_model(kind, full, arrays)
    except ModelError as error:
        raise ModelError(f'{path} is not written, the model learned is of no use: {error}') from None
    write_archive(path, full, arrays)


def write_archive(path, header, arrays):
    """Write header and arrays with their checksum, whatever they hold (see `save_model` for models)."""
    header = {key: value for key, value in header.items() if key != _CHECKSUM}
    header[_CHECKSUM] = _checksum(header, arrays)
    try:
        with replacing(path, 'wb') as stream:
            write_arrays(stream, **{_HEADER: np.array(json.dumps(header, sort_keys=True))}, **arrays)
    except MotionError as error:
        raise ModelError(str(error)) from None


def _checksum(header, arrays):
    """SHA-256 over the header without the checksum itself, and over name, type, shape and bytes of every array."""
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f'\0{name}\0{array.dtype.str}\0{array.shape}\0'.encode())
        digest.update(array.data if array.size else b'')
    return digest.hexdigest()


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
        If the file is missing, truncated or changed, not a model file, of a newer format or of another kind, or its
        contents are no sound model. Files from before there were checksums are taken by their contents alone.
    """
    path = Path(path)
    try:
        arrays = read_archive(path)
        if _HEADER not in arrays:
            raise ModelError(f'{path} is an .npz file but not a model file: it has no header')
        header = json.loads(str(arrays.pop(_HEADER)[()]), parse_constant=_no_number)
    except FileNotFoundError:
        raise ModelError(f'model file {path} does not exist') from None
    except IsADirectoryError:
        raise ModelError(f'{path} is a folder, not a model file') from None
    except ModelError:
        raise
    except (OSError, ValueError, RecursionError, IndexError) as error:
        raise ModelError(f'{path} is not a readable model file (damaged or truncated?): {error}') from None
    if not isinstance(header, dict) or any(key not in header for key in (*_REQUIRED, 'format_version')) \
            or not isinstance(header['kind'], str):
        raise ModelError(f'{path} has an incomplete model header')
    if header['format_version'] != FORMAT_VERSION:
        raise ModelError(f'{path} has format version {header["format_version"]}, this program reads '
                         f'{FORMAT_VERSION}: train it again or use the matching version of style_core')
    if kind is not None and header['kind'] != kind:
        raise ModelError(f'{path} holds a model of kind {header["kind"]}, but kind {kind} is needed here')
    stored = header.pop(_CHECKSUM, None)
    if stored is not None and stored != _checksum(header, arrays):
        raise ModelError(f'{path} is damaged: its contents do not fit the checksum they were written with')
    try:
        check_model(header['kind'], header, arrays)
    except ModelError as error:
        raise ModelError(f'{path} is an {error}') from None
    return header, arrays


def _no_number(word):
    raise ValueError(f'{word} in the header')


def read_header(path):
    """Return the JSON header of a model file (see `load_model` for the errors)."""
    return load_model(path)[0]
