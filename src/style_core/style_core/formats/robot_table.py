"""Tables of a robot's joints without a header, as retargeting programs write them."""
import numpy as np

from style_core.angles import rotation_from_quaternion, triples_from
from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.motion import Motion

__all__ = ['read']

#: from 1 that the length of a quaternion may differ by as it was printed
_UNIT_TOLERANCE = 0.01
_ROOT = tuple(f'root.{kind}{axis}' for kind in 'tr' for axis in 'xyz')


def read(path, joints_of, unit=None, rate_hz=None):
    """Read a table without header.

    Parameters
    ----------
    path : path-like
        One row a frame: the time in seconds where there is one, the place of the root (x, y, z, m) and its rotation (a
        quaternion x, y, z, w) where they are there, then the robot's joints. How many columns there are says which:
        J, J + 1 (with time), J + 7 (with root) or J + 8 (both). Separated by commas, semicolons, tabs or spaces.
    joints_of : path-like
        URDF file of the robot. Its J joints that move by themselves, in the file's order, are the columns.
    unit : {'rad', 'deg'}, optional
        Of the joints that turn; rad where left out.
    rate_hz : float, optional
        Of a table without time.

    Returns
    -------
    Motion
        Channels ``root.tx`` ... ``root.rz`` (turns about x, y and z) and the joints.

    Raises
    ------
    MotionError
        Naming the line that does not fit.
    """
    from style_core.skeleton import read_skeleton
    robot = read_skeleton(joints_of)
    kinds = {channel.name: channel.kind for body in robot.bodies for channel in body.channels}
    joints = robot.channel_names
    values = _values(path)
    extra = values.shape[1] - len(joints)
    if extra not in (0, 1, 7, 8):
        raise MotionError(f'{path} has {values.shape[1]} columns, but {joints_of} has {len(joints)} joints: expected '
                          f'as many, 1 more (time), 7 more (root and quaternion) or 8 more (both)')
    times = _times(path, values[:, 0] if extra in (1, 8) else None, rate_hz, len(values))
    angles = values[:, extra:]
    units = ['rad' if kinds[name] == 'r' else 'm' for name in joints]
    if unit == 'deg':
        angles = np.where([kind == 'rad' for kind in units], np.radians(angles), angles)
    if extra < 7:
        return Motion(joints, angles, times, units, path.stem)
    root = np.hstack([values[:, extra - 7:extra - 4], _turns(path, values[:, extra - 4:extra])])
    return Motion(_ROOT + joints, np.hstack([root, angles]), times, ['m'] * 3 + ['rad'] * 3 + units, path.stem)


def _values(path):
    rows = []
    for line_number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith('#'):
            continue
        cells = line.replace(',', ' ').replace(';', ' ').split()
        try:
            rows.append([number(cell) for cell in cells])
        except ValueError:
            raise MotionError(f'{path}: line {line_number} is not made of numbers ({line[:40]!r}): a table with a '
                              f'header is read without --joints-of') from None
        if len(rows[-1]) != len(rows[0]):
            raise MotionError(f'{path}: line {line_number} has {len(rows[-1])} columns, the first row {len(rows[0])}')
    if not rows:
        raise MotionError(f'{path} holds no frames')
    return np.array(rows, dtype=np.float64)


def _times(path, times, rate_hz, count):
    if times is not None:
        if rate_hz is not None:
            raise MotionError(f'{path} has a column of times: rate_hz means nothing for it')
        return times
    if rate_hz is None:
        raise MotionError(f'{path} has no column of times: say its rate (--recorded-rate)')
    return np.arange(count) / rate_hz


def _turns(path, quaternions):
    """Angles about x, y and z, rad, of quaternions x, y, z, w."""
    length = np.linalg.norm(quaternions, axis=1)
    off = ~(np.abs(length - 1) < _UNIT_TOLERANCE)
    if off.any():
        raise MotionError(f'{path}: frame {int(np.argmax(off))}: the quaternion of the root (x, y, z, w) has the '
                          f'length {length[np.argmax(off)]:.3g}, not 1')
    return triples_from(rotation_from_quaternion(quaternions / length[:, None]))
