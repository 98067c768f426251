"""Reading text safely, and writing without ever losing the old file."""
import contextlib
import csv
import io
import os
import secrets
import stat
from pathlib import Path

import numpy as np

from style_core.budgets import RECORDING_BYTES
from style_core.errors import MotionError
from style_core.regular_file import read_regular

__all__ = ['read_text', 'read_table', 'number', 'constant_step_s', 'replacing', 'write_arrays']


def read_text(path):
    """Text of a file (UTF-8, UTF-16), with line ends of any kind; MotionError for one absent, binary or empty."""
    path = Path(path)
    try:
        data = read_regular(path, RECORDING_BYTES)
    except FileNotFoundError:
        raise MotionError(f'{path} does not exist') from None
    except (IsADirectoryError, PermissionError, ValueError) as error:
        raise MotionError(f'{path} cannot be read: {getattr(error, "strerror", None) or error}') from None
    wide = _wide(data)
    if wide:
        with contextlib.suppress(UnicodeDecodeError):
            text = data.decode(wide).lstrip('\ufeff')
            if '\0' not in text and text.strip():
                return text
    if b'\0' in data:
        raise MotionError(f'{path} is a binary file, not text')
    if not data.strip():
        raise MotionError(f'{path} is empty')
    # comments may be in any old encoding; names and numbers are ASCII
    return data.decode('utf-8-sig', errors='replace')


def _wide(data):
    """The encoding of text in 16 bits a character (UTF-16), or None."""
    if data[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return 'utf-16'
    some = data[:1000]
    if len(some) >= 8 and len(data) % 2 == 0:  # without a mark: nearly all characters are ASCII
        for encoding, zeros in (('utf-16-le', some[1::2]), ('utf-16-be', some[::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return encoding
    return None


def read_table(path, columns):
    """Yield (line number, row) of a CSV file with a header; MotionError where it is no such file or lacks a column."""
    table = csv.DictReader(io.StringIO(read_text(path), newline=''))
    try:
        missing = [name for name in columns if name not in (table.fieldnames or ())]
        if missing:
            raise MotionError(f'{path} lacks the column {", ".join(missing)}')
        for row in table:
            yield table.line_num, row
    except csv.Error as error:
        raise MotionError(f'{path}, line {table.line_num}: {error}') from None


def number(word):
    """Float of a word; ValueError also for what only Python takes for a number (``1_0``, digits of other scripts)."""
    if '_' in word or not word.isascii():
        raise ValueError(f'could not convert string to float: {word!r}')
    return float(word)


def constant_step_s(motion, path):
    """Time step of a motion for a format that has only one; MotionError if steps differ by more than 1 %."""
    step = motion.duration_s / (motion.n_frames - 1)
    uneven = float(np.abs(np.diff(motion.times) - step).max())
    if uneven > 0.01 * step:
        raise MotionError(f'{path}: {Path(path).suffix} files have one time step, but steps of this motion differ by '
                          f'{uneven * 1e3:.3g} ms; resample it first (--rate)')
    return step


@contextlib.contextmanager
def replacing(path, mode='w'):
    """Open a new file that takes the place of ``path`` once it is complete; on failure the old one stays.

    Text is UTF-8 whatever the locale. A new file has the permissions that the umask leaves, one that is replaced keeps
    its own; a symbolic link stays, and the file it points at is replaced.

    Raises
    ------
    MotionError
        If ``path`` is a folder, its folder does not exist, or nothing can be written there (a full disk).
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise MotionError(f'{path} is a folder')
    if not target.parent.is_dir():
        raise MotionError(f'the folder {path.parent} does not exist')
    if target.exists() and not target.is_file():
        raise MotionError(f'{path} is no file that could be replaced')
    temporary = None
    try:
        descriptor, temporary = _beside(target)
        text = {} if 'b' in mode else {'encoding': 'utf-8', 'newline': ''}
        with os.fdopen(descriptor, mode, **text) as stream:
            yield stream
        if target.exists():
            os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
        os.replace(temporary, target)
    except BaseException as error:
        if temporary is not None:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            raise MotionError(f'{path} cannot be written: {error.strerror or error}') from None
        raise


def _beside(target):
    """Open a new hidden file in the folder of ``target``: its descriptor and path; the system applies the umask."""
    while True:
        name = target.parent / f'.{target.name[:100]}.{secrets.token_hex(4)}.part'
        with contextlib.suppress(FileExistsError):
            return os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, 'O_CLOEXEC', 0), 0o666), name


def write_arrays(stream, **arrays):
    """Write a compressed .npz; made in memory first, as an archive that a full disk cuts off complains when it goes."""
    made = io.BytesIO()
    np.savez_compressed(made, **arrays)
    stream.write(made.getbuffer())
