"""NumPy archives (``.npz``) of bounded size: nothing is unpacked that its parts do not account for."""
import ast
import zipfile
from contextlib import closing
from io import BytesIO

import numpy as np

from style_core.budgets import ARCHIVE_BYTES, ARCHIVE_MEMBERS, ARRAY_HEADER_BYTES, UNPACKED_BYTES
from style_core.regular_file import open_regular

__all__ = ['read_archive']

_MAGIC = b'\x93NUMPY'


def read_archive(path, wanted=None):
    """Arrays of an archive; never a pickle.

    Sizes are checked before anything is unpacked, and what is unpacked is read no further than that: the directory of
    a ZIP file and the head of an array may both lie.

    Parameters
    ----------
    path : path-like
    wanted : collection of str, optional
        Names of arrays to read; all where left out.

    Returns
    -------
    dict of str to ndarray

    Raises
    ------
    OSError
        Where there is no such file.
    ValueError
        Where it is no archive, is no regular file, or is larger than `style_core.budgets` allows, with the reason.
    """
    try:
        with closing(open_regular(path, ARCHIVE_BYTES)) as stream, zipfile.ZipFile(stream) as archive:
            parts = archive.infolist()
            if len(parts) > ARCHIVE_MEMBERS:
                raise ValueError(f'it has {len(parts)} arrays, {ARCHIVE_MEMBERS} at most are read')
            if any(part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for part in parts):
                raise ValueError('it is packed otherwise than NumPy packs')  # other unpackers have no bound
            size = sum(part.file_size for part in parts)
            if size > UNPACKED_BYTES:
                raise ValueError(f'it has {size} bytes unpacked, {UNPACKED_BYTES} at most are read')
            named = {part.filename.removesuffix('.npy'): part for part in parts}
            if len(named) != len(parts):
                raise ValueError('two arrays have the same name')
            return {name: _array(archive, part) for name, part in named.items() if wanted is None or name in wanted}
    except (OSError, ValueError):
        raise
    except Exception as error:  # a damaged archive makes NumPy, zipfile, zlib and the tokenizer fail in any way
        raise ValueError(f'damaged or truncated? {type(error).__name__}: {error}') from None


def _array(archive, part):
    with archive.open(part) as stream:
        data = stream.read(part.file_size + 1)
    if len(data) != part.file_size:
        raise ValueError(f'{part.filename} has {len(data)} bytes, not {part.file_size}')
    if data[:6] != _MAGIC or len(data) < 12:
        raise ValueError(f'{part.filename} is no array')
    first, size = (10, int.from_bytes(data[8:10], 'little')) if data[6] == 1 else \
        (12, int.from_bytes(data[8:12], 'little'))
    if size > ARRAY_HEADER_BYTES:
        raise ValueError(f'the head of {part.filename} has {size} bytes')
    head = ast.literal_eval(data[first:first + size].decode('latin-1' if data[6] < 3 else 'utf-8').strip())
    dtype = np.dtype(head['descr'])
    if dtype.hasobject:
        raise ValueError(f'{part.filename} holds objects')
    count = 1
    for length in head['shape']:
        count *= length
    if count < 0 or count * dtype.itemsize != len(data) - first - size:
        raise ValueError(f'{part.filename} is cut off')
    return np.lib.format.read_array(BytesIO(data), allow_pickle=False)
