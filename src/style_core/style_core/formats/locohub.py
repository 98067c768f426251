"""Tables of LocoHub (``.csv``, ``.parquet``): strides or trials of many people and tasks in one file."""
import csv
import io
import re
import warnings

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.motion import Motion

__all__ = ['is_header', 'read', 'read_all']

READ_OPTIONS = ()
SKELETON = None
CHANNELS = 'hip_flexion_angle_ipsi, knee_flexion_angle_contra, pelvis_sagittal_angle [rad]'
HAS_UNITS = True

#: between strides or trials, of which a table does not say that one follows the other, s: more than any gap is bridged
GAP_S = 1.0
#: of a stride whose duration cannot be known, s
STRIDE_S = 1.0
#: share of the velocities that the course of the angles must explain for a duration that follows from both
_EXPLAINED = 0.9

_KEYS = ('subject', 'task', 'task_id')
_ANGLE = re.compile(r'(.+_angle(?:_ipsi|_contra)?)_rad$')


def is_header(header):
    """Whether these columns are those of a LocoHub table."""
    return {'subject', 'task', 'step'} <= set(header) and bool({'phase_ipsi', 'time_s'} & set(header))


def read(path):
    """The only recording of a table; MotionError, with their names, where it holds several (`read_all`)."""
    motions = read_all(path)
    if len(motions) > 1:
        named = ', '.join(motion.name for motion in motions[:3])
        raise MotionError(f'{path} holds {len(motions)} recordings ({named} ...): part it first, motion-style split')
    return motions[0]


def read_all(path, stride_s=None):
    """Read a table.

    Parameters
    ----------
    path : Path
        With the columns ``subject``, ``task``, ``task_id`` (may be absent), ``step``; ``phase_ipsi`` (0 to 100) or
        ``time_s``; and angles, ``hip_flexion_angle_ipsi_rad``. Moments and forces are left out.
    stride_s : float, optional
        Duration of a cycle of 100 % in tables by phase. Where left out it follows, stride by stride, from the columns
        of angular velocity: the T that fits ``d angle / d phase = T velocity`` best.

    Returns
    -------
    list of Motion
        One for each subject, task and task_id, named ``subject/task_id``. Channels have the columns' names without
        ``_rad``: the leg that defines the phase is ``ipsi``, the other ``contra``. Between strides (or trials) lies a
        gap of 1 s, as a table does not say which stride follows which.

    Raises
    ------
    MotionError
        If columns are absent or do not fit, or for Parquet without pyarrow.

    Warns
    -----
    UserWarning
        Where the duration of strides cannot be known and 1 s is taken, and of channels without any value.
    """
    columns = _parquet(path) if path.suffix.lower() == '.parquet' else _table(path)
    if not is_header(columns):
        raise MotionError(f'{path} is no table of LocoHub: it lacks subject, task, step and phase_ipsi (or time_s)')
    angles = {found.group(1): name for name in columns for found in [_ANGLE.match(name)] if found}
    if not angles:
        raise MotionError(f'{path} has no column of angles (hip_flexion_angle_ipsi_rad)')
    by_time = 'time_s' in columns
    course = _numbers(path, columns, 'time_s' if by_time else 'phase_ipsi')
    values = np.column_stack([_numbers(path, columns, name) for name in angles.values()])
    speeds = {place: _numbers(path, columns, name) for place, name in enumerate(
        name.replace('_angle', '_angular_velocity') + '_rad_s' for name in angles) if name in columns}
    groups = {}
    for row, key in enumerate(zip(*(columns[name] for name in _KEYS if name in columns))):
        groups.setdefault(tuple(str(part) for part in key), []).append(row)
    steps = np.array([str(step) for step in columns['step']])
    motions, unknown = [], 0
    for key, rows in groups.items():
        rows = np.array(rows)
        times, guessed = _times(path, key, course[rows], steps[rows], None if by_time else _Strides(
            values[rows], {place: speed[rows] for place, speed in speeds.items()}, stride_s))
        unknown += guessed
        kept = ~np.isnan(values[rows]).all(axis=0)
        if not kept.any():
            warnings.warn(f'{path}: {"/".join(key)} has no angle and is left out', stacklevel=4)
            continue
        motions.append(Motion([name for name, there in zip(angles, kept) if there], values[rows][:, kept], times,
                              name=_name(key)))
    if not motions:
        raise MotionError(f'{path} holds no angle')
    if unknown:
        warnings.warn(f'{path}: how long {unknown} strides last is not in the table (no angular velocities that fit): '
                      f'{STRIDE_S:g} s is taken; motion-style split --stride says it', stacklevel=4)
    return motions


def _name(key):
    subject, task, variant = (*key, '')[:3]
    return f'{subject}/{variant if variant.startswith(task) else "_".join(filter(None, (task, variant)))}'


class _Strides:
    """What says how long a stride lasts: angles, shape (T, D), velocities of some of them, and a duration or None."""

    def __init__(self, angles, speeds, stride_s):
        self.angles, self.speeds, self.stride_s = angles, speeds, stride_s

    def duration(self, part, phase):
        """Of the rows of one stride, s; None where it cannot be known."""
        if self.stride_s is not None:
            return self.stride_s
        if len(phase) < 3 or not self.speeds:
            return None
        places = list(self.speeds)
        slope = np.gradient(self.angles[part][:, places], phase / 100, axis=0).ravel()
        speed = np.column_stack([self.speeds[place][part] for place in places]).ravel()
        good = np.isfinite(slope) & np.isfinite(speed)
        slope, speed = slope[good], speed[good]
        size = speed @ speed
        if not size > 0:
            return None
        duration = slope @ speed / size
        rest = slope - duration * speed
        return float(duration) if duration > 0 and rest @ rest <= (1 - _EXPLAINED) * (slope @ slope) else None


def _times(path, key, course, steps, strides):
    """Times in s, and how many strides have a duration that is not known."""
    if not np.isfinite(course).all():
        raise MotionError(f'{path}: {"/".join(key)}: a phase or time is missing')
    # by phase a new step, or a phase that goes back, begins a stride; by time a time that goes back begins a trial
    begins = np.diff(course) <= 0
    if strides is not None:
        begins |= steps[1:] != steps[:-1]
    times, start, unknown = np.empty(len(course)), 0.0, 0
    for part in np.split(np.arange(len(course)), np.flatnonzero(begins) + 1):
        run = course[part] - course[part[0]]
        if strides is not None:
            duration = strides.duration(part, course[part])
            unknown += duration is None
            run = run / 100 * (STRIDE_S if duration is None else duration)
        times[part] = start + run
        start = times[part[-1]] + GAP_S
    return times, unknown


def _numbers(path, columns, name):
    values = columns[name]
    if isinstance(values, np.ndarray):
        return values
    try:
        result = np.array([number(cell) if cell.strip() else np.nan for cell in values])
    except ValueError as error:
        raise MotionError(f'{path}: column {name}: {error}') from None
    return result


def _table(path):
    """Column -> cells of a CSV file."""
    rows = csv.reader(io.StringIO(read_text(path), newline=''))
    try:
        header = [name.strip() for name in next(rows)]
        cells = []
        for row in rows:
            if row and len(row) != len(header):
                raise MotionError(f'{path}: line {rows.line_num} has {len(row)} columns, the header {len(header)}')
            if row:
                cells.append(row)
    except (csv.Error, StopIteration) as error:
        raise MotionError(f'{path}, line {rows.line_num}: {error}') from None
    if len(set(header)) != len(header):
        raise MotionError(f'{path}: columns have the same name')
    if not cells:
        raise MotionError(f'{path} holds no rows')
    return dict(zip(header, zip(*cells)))


def _parquet(path):
    """Column -> values of a Parquet file."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise MotionError(f'{path}: Parquet files need pyarrow (pip install pyarrow); or save it as .csv') from None
    try:
        with parquet.ParquetFile(path) as file:
            words = [name for name in file.schema_arrow.names if name in (*_KEYS, 'step')]
            numbers = [name for name in file.schema_arrow.names if _ANGLE.match(name) or name.endswith('_rad_s')
                       or name in ('phase_ipsi', 'time_s')]
            table = file.read(columns=words + numbers)
        columns = {name: table.column(name).to_pylist() for name in words}
        columns.update((name, table.column(name).to_numpy().astype(np.float64)) for name in numbers)
    except FileNotFoundError:
        raise MotionError(f'{path} does not exist') from None
    except (ArrowException, KeyError, OSError, ValueError, TypeError) as error:
        raise MotionError(f'{path} is no readable Parquet file: {error}') from None
    if not table.num_rows:
        raise MotionError(f'{path} holds no rows')
    return columns
