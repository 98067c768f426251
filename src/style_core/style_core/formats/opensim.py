"""OpenSim storage files (``.mot``, ``.sto``): coordinates of a model over time."""
import re
import warnings

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.formats.stamps import times_of
from style_core.motion import Motion

__all__ = ['read']

READ_OPTIONS = ('unit',)
SKELETON = None
CHANNELS = "the model's coordinates: hip_flexion_r [rad], pelvis_tx [m]"
HAS_UNITS = True

#: what a file may hold that is no position: by its title, and by its columns
_OTHER_TITLE = re.compile(r'\b(speeds|velocities|accelerations|forces|moments|loads|activations)\b', re.IGNORECASE)
_OTHER_COLUMN = re.compile(r'.*(_force_?v?[xyz]|_v[xyz]|_p[xyz]|_torque_?[xyz]|_moment|_[mF][xyz])$')
#: columns of a states file that are no coordinate
_STATE = re.compile(r'/(speed|activation|fiber_length|fiber_velocity|normalized_tendon_force)$')
_LENGTH = re.compile(r'.*_t[xyz]$')
_YES, _NO = ('yes', 'y', 'true', '1'), ('no', 'n', 'false', '0')


def read(path, unit=None):
    """Read joint angles of OpenSim.

    Angles are in degrees or radians as ``inDegrees`` of the header says; translations (``pelvis_tx``) are in metres
    either way. Of a states file (``/jointset/hip_r/hip_flexion_r/value``) the coordinates are read under their own
    names; speeds and muscles are left out.

    Parameters
    ----------
    path : path-like
    unit : {'rad', 'deg'}, optional
        Of the angles of a file whose header lacks ``inDegrees``.

    Raises
    ------
    MotionError
        Naming the line that does not fit, or what the file holds instead of angles.

    Warns
    -----
    UserWarning
        Where the header announces another number of rows, and of columns that are left out.
    """
    if unit not in (None, 'rad', 'deg'):
        raise MotionError(f"{path}: the unit must be 'rad' or 'deg', not {unit!r}")
    lines = read_text(path).splitlines()
    end = next((at for at, line in enumerate(lines) if line.strip().lower() == 'endheader'), None)
    if end is None:
        raise MotionError(f'{path} has no endheader, so it is no OpenSim file')
    head = _head(path, lines[:end])
    rows = [(at, line.split()) for at, line in enumerate(lines[end + 1:], end + 2) if line.strip()]
    if len(rows) < 2:
        raise MotionError(f'{path} holds no columns and frames after endheader')
    (label_line, labels), rows = rows[0], rows[1:]
    if labels[0].lower() != 'time' or len(labels) < 2:
        raise MotionError(f'{path}: line {label_line}: the columns must be time and coordinates, found '
                          f'{" ".join(labels)[:60]!r}')
    stamps, values = _values(path, rows, len(labels))
    columns, names = _coordinates(path, labels[1:])
    units = tuple('m' if _LENGTH.match(name) else 'rad' for name in names)
    if 'rad' in units and _degrees(path, head, unit):
        values[:, [column for column, kind in zip(columns, units) if kind == 'rad']] *= np.pi / 180
    announced = head.get('nrows', head.get('datarows'))
    if announced is not None and announced != str(len(rows)):
        warnings.warn(f'{path}: {announced} rows are announced, {len(rows)} are there and read', stacklevel=3)
    times, epoch_ns, kept = times_of(path, stamps, 1.0, [at for at, _ in rows])
    return Motion(names, values[kept][:, columns], times, units, path.stem, epoch_ns)


def _head(path, lines):
    """Entries of the header by their names in lower case."""
    title = next((line.strip() for line in lines if line.strip()), '')
    if _OTHER_TITLE.search(title):
        raise MotionError(f'{path} holds {title[:40]!r}, not joint angles: export the coordinates (inverse kinematics, '
                          f'Kinematics_q)')
    head = {}
    for line in lines:
        found = re.match(r'\s*(\w+)\s*(?:=|\s)\s*(\S+)\s*$', line)
        if found:
            head[found.group(1).lower()] = found.group(2)
    if head.get('datatype', 'double').lower() != 'double':
        raise MotionError(f'{path} holds {head["datatype"][:40]} values, not joint angles: run inverse kinematics of '
                          f'OpenSim on it first')
    return head


def _degrees(path, head, unit):
    said = head.get('indegrees', '').lower()
    if said in _YES or said in _NO:
        return said in _YES
    if unit is None:
        raise MotionError(f'{path}: the header does not say inDegrees=yes or no: say --unit deg or --unit rad')
    return unit == 'deg'


def _values(path, rows, width):
    stamps, values = [], np.empty((len(rows), width - 1))
    for row, (at, words) in enumerate(rows):
        if len(words) != width:
            raise MotionError(f'{path}: line {at} has {len(words)} columns, the header {width}')
        try:
            values[row] = [number(word) for word in words[1:]]
        except ValueError:
            wrong = next(word for word in words[1:] if not _is_number(word))
            raise MotionError(f'{path}: line {at}: {wrong[:40]!r} is not a number') from None
        stamps.append(words[0])
    return stamps, values


def _is_number(word):
    try:
        number(word)
    except ValueError:
        return False
    return True


def _coordinates(path, labels):
    """Columns that are coordinates, and their names."""
    other = [label for label in labels if _OTHER_COLUMN.match(label)]
    if other:
        raise MotionError(f'{path}: {other[0][:40]} is no coordinate of a joint: forces and markers are not read, '
                          f'run inverse kinematics and give its .mot file')
    known = set(labels)
    columns, names = [], []
    for column, label in enumerate(labels):
        if _STATE.search(label) or (label.endswith('_u') and label[:-2] in known):
            continue
        columns.append(column)
        names.append(label.split('/')[-2] if label.startswith('/') and label.endswith('/value') else label)
    if not names:
        raise MotionError(f'{path} has no column with the position of a coordinate')
    if len(names) < len(labels):
        warnings.warn(f'{path}: {len(labels) - len(names)} columns of speeds and muscles are left out', stacklevel=4)
    return columns, names
