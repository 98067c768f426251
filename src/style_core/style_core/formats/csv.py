"""Tables (``.csv``): a header of joint names, the time in seconds first, one row a frame."""
import contextlib
import csv
import io
import re
import warnings

import numpy as np

from style_core.errors import MotionError
from style_core.formats import locohub, robot_table
from style_core.formats.files import number, read_text, replacing
from style_core.formats.stamps import times_of, unit_of_time
from style_core.motion import Motion, usual_units

__all__ = ['read', 'write']

READ_OPTIONS = ('unit', 'joints_of', 'rate_hz')
WRITE_OPTIONS = ()
SKELETON = None
CHANNELS = 'as the header, or the robot, names them'
HAS_UNITS = False

_COMMENT = '# rotation orders: '
#: a header may end in a unit: ``knee [deg]``, ``knee (deg)``, ``knee_deg``
_HEADER = re.compile(r'(.*\S)(?:\s*[\[(]\s*(\S+?)\s*[\])]|[_/](deg|degs|degree|degrees))$', re.IGNORECASE)
_UNITS = {**dict.fromkeys(('rad', 'rads', 'radian', 'radians'), ('rad', 1.0)),
          **dict.fromkeys(('deg', 'degs', 'degree', 'degrees', '\u00b0', '\u00ba'), ('rad', np.pi / 180)),
          'm': ('m', 1.0), 'cm': ('m', 0.01), 'mm': ('m', 0.001)}


def read(path, unit=None, joints_of=None, rate_hz=None):
    """Read a table.

    The first column is the time and named ``time`` (or ``t``, ``seconds``, ``timestamp``), in seconds or in the unit
    after its name (``time_ms``, ``time [ns]``); every other header is a joint name, with a unit after it where that is
    not the usual one (rad; m for names that end in ``.tx``, ``.ty``, ``.tz``): ``knee [deg]``, ``knee (deg)``,
    ``knee_deg``, ``slide [m]``. Empty cells and ``nan`` are missing values. Columns are separated by comma, semicolon
    or tab; between semicolons or tabs a number may have a decimal comma. Lines that start with ``#`` are comments.

    Parameters
    ----------
    path : path-like
    unit : {'rad', 'deg'}, optional
        Of columns of angles that name no unit.
    joints_of : path-like, optional
        The table has no header and holds the joints of this robot: see `style_core.formats.robot_table`.
    rate_hz : float, optional
        Of a table without header and times.

    A table of LocoHub (``subject, task, ..., phase_ipsi``) is read by `style_core.formats.locohub`.

    Raises
    ------
    MotionError
        Naming the line that does not fit.

    Warns
    -----
    UserWarning
        Of decimal commas, and of time stamps that are mended: see `style_core.formats.stamps`.
    """
    if unit not in (None, 'rad', 'deg'):
        raise MotionError(f"{path}: the unit must be 'rad' or 'deg', not {unit!r}")
    if joints_of is not None:
        return robot_table.read(path, joints_of, unit, rate_hz)
    if rate_hz is not None:
        raise MotionError(f'{path}: rate_hz means nothing for .csv files with times')
    lines = read_text(path).splitlines()
    numbered = [(line_number, line) for line_number, line in enumerate(lines, 1)
                if line.strip() and not line.lstrip().startswith('#')]
    if not numbered:
        raise MotionError(f'{path} holds no header and no frames')
    head_line, head = numbered[0]
    delimiter = max(',;\t', key=head.count)
    header = next(csv.reader(io.StringIO(head), delimiter=delimiter))
    header = [name.strip() for name in header]
    if locohub.is_header(header):
        return locohub.read(path)
    time_unit = unit_of_time(header[0])
    if time_unit is None or len(header) < 2:
        raise MotionError(f'{path}: line {head_line}: the header must start with "time" (seconds) and go on with joint '
                          f'names, found {head[:60]!r}')
    if not all(header):
        raise MotionError(f'{path}: line {head_line}: column {header.index("") + 1} has no name')
    names, units, scale = _columns(header[1:], unit)
    stamps, values = _values(path, numbered[1:], len(header), delimiter)
    times, epoch_ns, kept = times_of(path, stamps, time_unit, [line_number for line_number, _ in numbered[1:]])
    return Motion(names, values[kept] * scale, times, units, path.stem, epoch_ns, _orders(path, lines))


def _columns(header, unit):
    """Names, units and factors of the joints' columns."""
    parted = [_parted(name) for name in header]
    names = [name for name, _ in parted]
    units, scale = list(usual_units(names)), np.ones(len(names))
    for index, (_, own) in enumerate(parted):
        if own is not None:
            units[index], scale[index] = own
        elif unit == 'deg' and units[index] == 'rad':
            scale[index] = np.pi / 180
    return names, units, scale


def _parted(header):
    """Name and unit (what it becomes, factor) of a header; None where it names none."""
    found = _HEADER.match(header)
    if found:
        own = _UNITS.get((found.group(2) or found.group(3)).lower())
        if own:
            return found.group(1).strip(), own
    return header, None


def _values(path, rows, width, delimiter):
    """Stamps as they are written, and values, shape (T, D)."""
    stamps, values, commas = [], np.empty((len(rows), width - 1)), 0
    for row, (line_number, line) in enumerate(rows):
        cells = (line.replace('"', '') if '"' in line else line).split(delimiter)
        if len(cells) != width:
            hint = '; decimal commas need semicolons between the columns' if len(cells) == 2 * width else ''
            raise MotionError(f'{path}: line {line_number} has {len(cells)} columns, the header {width}{hint}')
        if delimiter != ',' and ',' in line:
            commas += 1
            cells = [cell.replace(',', '.') if _DECIMAL_COMMA.match(cell) else cell for cell in cells]
            line = ''.join(cells)
        try:
            values[row] = _numbers(line, cells)[1:]
        except ValueError:
            wrong = next(cell for cell in cells if cell.strip() and not _is_number(cell))
            raise MotionError(f'{path}: line {line_number}: {wrong.strip()[:40]!r} is not a number') from None
        stamps.append(cells[0].strip())
    if commas:
        warnings.warn(f'{path}: commas in numbers are taken as decimal commas', stacklevel=4)
    return stamps, values


_DECIMAL_COMMA = re.compile(r'\s*[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?\s*$')


def _orders(path, lines):
    """Rotation orders of the comment that `write` puts."""
    orders = {}
    for line in lines:
        if line.startswith(_COMMENT):
            for entry in line[len(_COMMENT):].split(';'):
                joint, _, order = entry.strip().rpartition('=')
                if not joint:
                    raise MotionError(f'{path}: the comment of rotation orders is damaged: {entry.strip()[:40]!r}')
                orders[joint] = order
    return orders


def write(motion, path):
    """Write a table; it comes back bit for bit. Rotation orders other than the usual one stand in a comment."""
    odd = [name for name in motion.joint_names if any(mark in name for mark in '"\n\r') or name != name.strip()
           or (_parted(name)[1] is not None and name.endswith((']', ')')))]
    if odd:
        raise MotionError(f'{path}: the joint name {odd[0]!r} cannot stand in the header of a table')
    usual = usual_units(motion.joint_names)
    header = [name if unit == expected and _parted(name)[1] is None else f'{name} [{unit}]'
              for name, unit, expected in zip(motion.joint_names, motion.units, usual)]
    with replacing(path) as stream:
        if motion.orders:
            stream.write(_COMMENT + '; '.join(f'{joint}={order}' for joint, order in motion.orders.items()) + '\n')
        stream.write('time,' + ','.join(f'"{name}"' if ',' in name else name for name in header) + '\n')
        for time, row in zip(motion.times.tolist(), motion.positions.tolist()):
            stream.write(f'{time!r},' + ','.join('' if value != value else repr(value) for value in row) + '\n')


def _numbers(line, cells):
    if '_' not in line and line.isascii():  # so `number` would refuse nothing that float takes
        with contextlib.suppress(ValueError):
            return list(map(float, cells))
    return [number(cell) if cell.strip() else np.nan for cell in cells]


def _is_number(cell):
    try:
        number(cell)
    except ValueError:
        return False
    return True
