"""The CMU 8-action prediction benchmark: its skeleton, its positions, its Euler-angle error.

The benchmark's files hold 117 values a row: root translation (3) and exponential maps of 38 joints (38 x 3). Its
forward kinematics is peculiar and kept as it is, so that figures compare with published ones: row vectors are turned
(``offset @ rotation``), and the root's translation and rotation are left out.
"""
import numpy as np

from style_core.angles import rotation_from_expmap
from style_core.errors import MotionError

__all__ = ['PARENTS', 'OFFSETS_MM', 'N_JOINTS', 'DUPLICATES', 'STILL', 'cmu8_forward', 'euler_angles', 'euler_error']

N_JOINTS = 38

#: parent of each joint; -1 is the root. Joints 1, 7 and 13 start at the root: two legs and the trunk.
PARENTS = np.array([-1, 0, 1, 2, 3, 4, 5, 0, 7, 8, 9, 10, 11, 0, 13, 14, 15, 16, 17, 18, 15, 20, 21, 22, 23, 24, 25,
                    23, 27, 15, 29, 30, 31, 32, 33, 34, 32, 36])

#: bone from the parent to each joint, mm (the benchmark's unit: its skeleton's lengths times 70)
OFFSETS_MM = np.zeros((N_JOINTS, 3))
for _joint, _bone in {
        2: (1.65674, -1.80282, 0.62477), 3: (2.5972, -7.13576, 0), 4: (2.49236, -6.8477, 0),
        5: (0.19704, -0.54136, 2.14581), 6: (0, 0, 1.11249),
        8: (-1.6107, -1.80282, 0.62476), 9: (-2.59502, -7.12977, 0), 10: (-2.4678, -6.78024, 0),
        11: (-0.23024, -0.63258, 2.13368), 12: (0, 0, 1.11569),
        14: (0.01961, 2.0545, -0.14112), 15: (0.01021, 2.06436, -0.05921), 17: (0.00713, 1.56711, 0.14968),
        18: (0.03429, 1.56041, -0.10006), 19: (0.01305, 1.6256, -0.05265),
        21: (3.54205, 0.90436, -0.17364), 22: (4.86513, 0, 0), 23: (3.35554, 0, 0), 25: (0.66117, 0, 0),
        26: (0.53306, 0, 0), 28: (0.5412, 0, 0.5412),
        30: (-3.49802, 0.75994, -0.32616), 31: (-5.02649, 0, 0), 32: (-3.36431, 0, 0), 34: (-0.73041, 0, 0),
        35: (-0.58887, 0, 0), 37: (-0.59786, 0, 0.59786)}.items():
    OFFSETS_MM[_joint] = 70 * np.array(_bone)

#: joints with no bone of their own, and the joint each of them always coincides with
DUPLICATES = {16: 15, 20: 15, 29: 15, 24: 23, 27: 23, 33: 32, 36: 32}

#: joints that never move in the files: the root and the hip joints next to it, once the root's motion is left out
STILL = (0, 1, 2, 7, 8, 13)


def cmu8_forward(expmaps):
    """Joint positions as the benchmark's MPJPE takes them.

    Parameters
    ----------
    expmaps : ndarray, shape (T, 117)
        Rows of a benchmark file.

    Returns
    -------
    ndarray, shape (T, 38, 3)
        Millimetres, relative to the root.

    Raises
    ------
    MotionError
        If the shape is wrong.
    """
    rotations = rotation_from_expmap(_rows(expmaps)[:, 3:].reshape(-1, N_JOINTS, 3))
    positions = np.tile(OFFSETS_MM, (len(rotations), 1, 1))
    for joint in range(1, N_JOINTS):
        parent = PARENTS[joint]
        if parent > 0:
            positions[:, joint] = OFFSETS_MM[joint] @ rotations[:, parent] + positions[:, parent]
            rotations[:, joint] = rotations[:, joint] @ rotations[:, parent]
    return positions


def euler_angles(expmaps):
    """Euler angles as the benchmark's angle error takes them.

    With R the rotation matrix: b = -asin R02, a = atan2(R12, R22), c = atan2(R01, R00); at b = +-pi/2, where only the
    sum or difference of the others is determined, c is zero.

    Parameters
    ----------
    expmaps : ndarray, shape (T, 117)

    Returns
    -------
    ndarray, shape (T, 117)
        Root translation unchanged, then (a, b, c) of each joint, rad.
    """
    rows = _rows(expmaps)
    rotations = rotation_from_expmap(rows[:, 3:].reshape(-1, N_JOINTS, 3))
    r02 = rotations[..., 0, 2]
    b = -np.arcsin(np.clip(r02, -1, 1))
    locked = np.abs(r02) >= 1
    sign = np.sign(r02)
    a = np.where(locked, -sign * np.arctan2(rotations[..., 0, 1], r02),
                 np.arctan2(rotations[..., 1, 2], rotations[..., 2, 2]))
    c = np.where(locked, 0.0, np.arctan2(rotations[..., 0, 1], rotations[..., 0, 0]))
    return np.concatenate([rows[:, :3], np.stack([a, b, c], axis=-1).reshape(len(rows), -1)], axis=1)


def euler_error(predicted, actual):
    """Angle error of the benchmark.

    Parameters
    ----------
    predicted, actual : ndarray, shape (T, 117)
        Exponential maps of one window's T frames.

    Returns
    -------
    ndarray, shape (T,)
        Euclidean distance of the Euler angles of a frame over the angles that vary in ``actual`` (standard deviation
        above 1e-4 within the window), without the root's translation and rotation, rad.
    """
    actual = euler_angles(actual)
    varying = actual.std(axis=0) > 1e-4
    varying[:6] = False
    return np.linalg.norm((euler_angles(predicted) - actual)[:, varying], axis=1)


def _rows(expmaps):
    rows = np.asarray(expmaps, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3 + 3 * N_JOINTS:
        raise MotionError(f'benchmark rows must have shape (T, {3 + 3 * N_JOINTS}), got {rows.shape}')
    return rows
