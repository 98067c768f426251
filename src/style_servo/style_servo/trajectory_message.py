"""Trajectory messages to arrays and back. Works on anything shaped like trajectory_msgs/JointTrajectory."""
import numpy as np

from style_core.errors import MotionError
from style_servo.bridge import Points

__all__ = ['points_of']


def points_of(message, max_points=2000):
    """The points of a JointTrajectory as arrays.

    Raises
    ------
    MotionError
        If there are no points or too many, or lengths differ between points.
    """
    points = message.points
    if not points:
        raise _refusal('it has no points')
    if len(points) > max_points:
        raise _refusal(f'it has {len(points)} points (at most {max_points})')
    n = len(message.joint_names)
    times = np.array([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points])
    arrays = []
    for field in ('positions', 'velocities', 'accelerations'):
        rows = [getattr(point, field) for point in points]
        lengths = {len(row) for row in rows}
        if lengths == {0} and field != 'positions':
            arrays.append(None)
        elif lengths != {n} or not n:
            raise _refusal(f'{n} joints, but points with {sorted(lengths)} {field}')
        else:
            arrays.append(np.array(rows, dtype=np.float64))
    return Points(tuple(message.joint_names), times, *arrays)


def _refusal(text):
    error = MotionError(text)
    error.kind = 'shape'
    return error
