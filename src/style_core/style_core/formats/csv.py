"""Tables (``.csv``): a header of joint names, the time in seconds first, one row a frame."""
import contextlib
import csv
import io

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text, replacing
from style_core.motion import Motion, usual_units

__all__ = ['read', 'write']

READ_OPTIONS = ()
WRITE_OPTIONS = ()

_TIME = ('time', 't', 'time_s', 'time [s]', 'seconds', 'timestamp')
_UNITS = {'[rad]': ('rad', 1.0), '[deg]': ('rad', np.pi / 180), '[m]': ('m', 1.0)}


def read(path):
    """Read a table.

    The first column is the time in seconds and named ``time`` (or ``t``, ``time_s``, ``seconds``, ``timestamp``);
    every other header is a joint name, with ``[rad]``, ``[deg]`` or ``[m]`` after it where the unit is not the usual
    one (rad; m for names that end in ``.tx``, ``.ty``, ``.tz``). Empty cells and ``nan`` are missing values. Columns
    are separated by comma, semicolon or tab; lines that start with ``#`` are comments.

    Raises
    ------
    MotionError
        Naming the line that does not fit.
    """
    lines = read_text(path).splitlines()
    numbered = [(line_number, line) for line_number, line in enumerate(lines, 1)
                if line.strip() and not line.lstrip().startswith('#')]
    if not numbered:
        raise MotionError(f'{path} holds no header and no frames')
    head_line, head = numbered[0]
    delimiter = max(',;\t', key=head.count)
    header = next(csv.reader(io.StringIO(head), delimiter=delimiter))
    header = [name.strip() for name in header]
    if header[0].lower() not in _TIME or len(header) < 2:
        raise MotionError(f'{path}: line {head_line}: the header must start with "time" (seconds) and go on with joint '
                          f'names, found {head[:60]!r}')
    if not all(header):
        raise MotionError(f'{path}: line {head_line}: column {header.index("") + 1} has no name')
    names = [_bare(name) for name in header[1:]]
    units = list(usual_units(names))
    scale = np.ones(len(names))
    for index, name in enumerate(header[1:]):
        suffix = name.rpartition(' ')[2]
        if suffix in _UNITS:
            units[index], scale[index] = _UNITS[suffix]
    values = np.empty((len(numbered) - 1, len(header)))
    for row, (line_number, line) in enumerate(numbered[1:]):
        cells = (line.replace('"', '') if '"' in line else line).split(delimiter)
        if len(cells) != len(header):
            raise MotionError(f'{path}: line {line_number} has {len(cells)} columns, the header {len(header)}')
        try:
            values[row] = _numbers(line, cells)
        except ValueError:
            wrong = next(cell for cell in cells if cell.strip() and not _is_number(cell))
            raise MotionError(f'{path}: line {line_number}: {wrong.strip()[:40]!r} is not a number') from None
    back = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if len(back):
        before, after = values[back[0]:back[0] + 2, 0]
        raise MotionError(f'{path}: line {numbered[back[0] + 2][0]}: time does not increase ({before:.9g} s, then '
                          f'{after:.9g} s)')
    return Motion(names, values[:, 1:] * scale, values[:, 0], units, name=path.stem)


def write(motion, path):
    """Write a table; it comes back bit for bit."""
    odd = [name for name in motion.joint_names if any(mark in name for mark in '"\n\r') or name != name.strip()
           or _bare(name) != name]
    if odd:
        raise MotionError(f'{path}: the joint name {odd[0]!r} cannot stand in the header of a table')
    usual = usual_units(motion.joint_names)
    header = [name if unit == expected else f'{name} [{unit}]'
              for name, unit, expected in zip(motion.joint_names, motion.units, usual)]
    with replacing(path) as stream:
        stream.write('time,' + ','.join(f'"{name}"' if ',' in name else name for name in header) + '\n')
        for time, row in zip(motion.times.tolist(), motion.positions.tolist()):
            stream.write(f'{time!r},' + ','.join('' if value != value else repr(value) for value in row) + '\n')


def _numbers(line, cells):
    if '_' not in line and line.isascii():  # so `number` would refuse nothing that float takes
        with contextlib.suppress(ValueError):
            return list(map(float, cells))
    return [number(cell) if cell.strip() else np.nan for cell in cells]


def _bare(header):
    name, _, suffix = header.rpartition(' ')
    return name.strip() if suffix in _UNITS else header


def _is_number(cell):
    try:
        number(cell)
    except ValueError:
        return False
    return True
