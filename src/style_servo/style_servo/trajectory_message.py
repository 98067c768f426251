"""Read trajectory messages as the middleware delivers them, without building message objects."""
import numpy as np

from style_core.errors import MotionError
from style_core.live.cdr import ENCAPSULATION, StampedNamesReader
from style_servo.bridge import Points

__all__ = ['TrajectoryReader']

_FIELDS = 'positions', 'velocities', 'accelerations', 'effort'


class TrajectoryReader(StampedNamesReader):
    """Serialised ``trajectory_msgs/JointTrajectory`` (CDR of either byte order) to a stamp and arrays.

    Points of one trajectory have equal lengths, so all but the first lie at even distances and are read at one go:
    some 30 us for 20 points of 20 joints, against some 450 us by way of rclpy's objects.

    Parameters
    ----------
    max_points : int
        Of one trajectory.
    """

    def __init__(self, max_points=2000):
        super().__init__()
        self._max_points = max_points

    def damaged(self, what):
        """The error to raise."""
        return _refusal(f'damaged: {what}')

    def read(self, data):
        """Read a message.

        Parameters
        ----------
        data : bytes

        Returns
        -------
        stamp : int
            Ns.
        points : Points

        Raises
        ------
        MotionError
            If the bytes are no joint trajectory, there are no points or too many, or lengths differ between points.
        """
        order, stamp, names, at = self.begin(data)
        count, at = self.number(data, order, at)
        if not count:
            raise _refusal('it has no points')
        if count > self._max_points:
            raise _refusal(f'it has {count} points (at most {self._max_points})')
        lengths, ends = self._layout(data, order, at)
        n = len(names)
        if lengths[0] != n or not n or any(length not in (0, n) for length in lengths[1:3]):
            raise _refusal(f'{n} joints, but a first point with {lengths[0]} positions, {lengths[1]} velocities and '
                           f'{lengths[2]} accelerations')
        times = np.empty(count)
        arrays = [np.empty((count, length)) if length else None for length in lengths[:3]]
        self._copy(data, order, at, 1, lengths, ends, times[:1], [a if a is None else a[:1] for a in arrays])
        if count > 1:
            _, ends = self._layout(data, order, at := ends[-1])
            self._copy(data, order, at, count - 1, lengths, ends, times[1:],
                       [a if a is None else a[1:] for a in arrays])
        return stamp, Points(names, times, *arrays)

    def _layout(self, data, order, at):
        """Lengths of the four lists of the point at ``at``; where each ends, and where the point ends."""
        lengths, ends = [], []
        for _ in _FIELDS:
            length, at = self.number(data, order, at)
            if length:
                at += (ENCAPSULATION - at) % 8 + 8 * length
            if at > len(data):
                raise self.damaged('points are cut off')
            lengths.append(length)
            ends.append(at)
        ends.append(at + -at % 4 + 8)
        return lengths, ends

    def _copy(self, data, order, at, count, lengths, ends, times, arrays):
        """Copy ``count`` points from ``at`` on, laid out as the first of them: lengths and ends of its fields."""
        size = ends[-1] - at
        if at + count * size > len(data):
            raise self.damaged('points are cut off')
        rows = np.frombuffer(data, np.uint8, count * size, at).reshape(count, size)

        def column(offset, width, kind):
            return np.ascontiguousarray(rows[:, offset:offset + width]).view(order + kind)
        begin = 0
        for field, length, end in zip(_FIELDS, lengths, ends):
            where = begin + -(at + begin) % 4
            if np.any(column(where, 4, 'u4') != length):
                raise _refusal(f'points with different numbers of {field}')
            begin = end - at
        for array, length, end in zip(arrays, lengths, ends):
            if array is not None:
                array[:] = column(end - at - 8 * length, 8 * length, 'f8')
        whole, rest = size - 8, size - 4
        times[:] = column(whole, 4, 'i4')[:, 0] + 1e-9 * column(rest, 4, 'u4')[:, 0]


def _refusal(text):
    error = MotionError(text)
    error.kind = 'shape'
    return error
