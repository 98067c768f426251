"""Reading text safely, and writing without ever losing the old file."""
import contextlib
import csv
import io
import os
import tempfile
from pathlib import Path

import numpy as np

from style_core.budgets import RECORDING_BYTES
from style_core.errors import MotionError
from style_core.regular_file import read_regular

__all__ = ['read_text', 'read_table', 'number', 'constant_step_s', 'replacing']


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
    """Open a new file that takes the place of ``path`` once it is complete; on failure the old one stays."""
    path = Path(path)
    if path.is_dir():
        raise MotionError(f'{path} is a folder')
    if not path.parent.is_dir():
        raise MotionError(f'the folder {path.parent} does not exist')
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix='.' + path.name, suffix='.part')
    try:
        with os.fdopen(descriptor, mode) as stream:
            yield stream
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise
