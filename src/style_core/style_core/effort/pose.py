"""Poses in coordinates that may be averaged: exponential maps for ball joints, travel and turning for the root."""
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from style_core.angles import continuous_triples, rotation_from_expmap
from style_core.errors import MotionError
from style_core.motion import Motion

__all__ = ['PoseSpace', 'pose_space', 'Poses']

_ROOT = tuple(f'root.{kind}{axis}' for kind in 'tr' for axis in 'xyz')


@dataclass(frozen=True, eq=False)
class Poses:
    """A motion in a `PoseSpace`.

    Attributes
    ----------
    joints : ndarray, shape (T, D)
        Exponential maps (rad) of ball joints in the columns of their Euler angles; other joints unchanged.
    root : ndarray, shape (T, 7), or None
        Sideways and forward travel a frame in the heading's own frame (m), height (m), turning a frame (rad), and
        tilt from the heading frame as an exponential map (rad). Free of where the motion started and where it faced.
    start : ndarray, shape (3,)
        Ground position x, z (m) and heading (rad) of the first frame.
    """

    joints: np.ndarray
    root: Optional[np.ndarray]
    start: np.ndarray

    def __len__(self):
        return len(self.joints)


@dataclass(frozen=True)
class PoseSpace:
    """Names of the joint channels and which of them form ball joints.

    Attributes
    ----------
    joint_names : tuple of str, length D
        Without the root.
    triples : tuple of (int, int, int)
        Columns of joints with the channels ``.rx``, ``.ry``, ``.rz``, rotated in this order about fixed axes.
    has_root : bool
    """

    joint_names: Tuple[str, ...]
    triples: Tuple[Tuple[int, int, int], ...]
    has_root: bool

    def encode(self, motion):
        """Return the `Poses` of a motion.

        Raises
        ------
        MotionError
            If joints are absent or values are missing.
        """
        positions = motion.joints(self.joint_names).positions
        if np.isnan(positions).any():
            raise MotionError(f'motion {motion.name!r} has missing values: fill them first (motion-style fill)')
        joints = positions.copy()
        for triple in self.triples:
            columns = list(triple)
            joints[:, columns] = _expmaps(_matrices(positions[:, columns]))
        if not self.has_root:
            return Poses(joints, None, np.zeros(3))
        root = motion.joints(_ROOT).positions
        if np.isnan(root).any():
            raise MotionError(f'motion {motion.name!r} has missing root values: fill them first (motion-style fill)')
        return Poses(joints, *_encode_root(root))

    def decode(self, poses, rate_hz, name='', reference=None):
        """Return the `Motion` of poses at a constant rate; angles are continuous.

        Parameters
        ----------
        poses : Poses
        rate_hz : float
        name : str, optional
        reference : ndarray, shape (D,), optional
            Joint angles that the first frame follows: of equivalent Euler triples the nearest are taken.
        """
        positions = poses.joints.copy()
        for triple in self.triples:
            columns = list(triple)
            near = None if reference is None else reference[columns]
            angles = continuous_triples(_euler(rotation_from_expmap(poses.joints[:, columns])), 1, near)
            positions[:, columns] = angles
        names, units = self.joint_names, ('rad',) * len(self.joint_names)
        if poses.root is not None:
            names = _ROOT + names
            units = ('m',) * 3 + ('rad',) * 3 + units
            positions = np.concatenate([_decode_root(poses), positions], axis=1)
        return Motion(names, positions, np.arange(len(positions)) / rate_hz, units=units, name=name)


def pose_space(joint_names):
    """Build the `PoseSpace` of a list of channel names (root channels, where all six are there, are set apart)."""
    names = tuple(joint_names)
    has_root = all(name in names for name in _ROOT)
    names = tuple(name for name in names if not name.startswith('root.'))
    if not names:
        raise MotionError('there is no joint channel apart from the root')
    column = {name: index for index, name in enumerate(names)}
    triples = []
    for name in names:
        joint, _, axis = name.rpartition('.')
        triple = tuple(column.get(f'{joint}.r{letter}') for letter in 'xyz')
        if axis == 'rx' and None not in triple:
            triples.append(triple)
    return PoseSpace(names, tuple(triples), has_root)


def _matrices(angles):
    """Rz(c) Ry(b) Rx(a) for (T, 3) Euler angles."""
    (sa, sb, sc), (ca, cb, cc) = np.sin(angles.T), np.cos(angles.T)
    return np.stack([
        np.stack([cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa], -1),
        np.stack([sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa], -1),
        np.stack([-sb, cb * sa, cb * ca], -1)], -2)


def _euler(matrices):
    """Angles of Rz(c) Ry(b) Rx(a); at the gimbal lock c is taken as zero."""
    m = matrices
    b = np.arctan2(-m[..., 2, 0], np.hypot(m[..., 0, 0], m[..., 1, 0]))
    locked = np.hypot(m[..., 0, 0], m[..., 1, 0]) < 1e-9
    a = np.where(locked, np.arctan2(-m[..., 1, 2], m[..., 1, 1]), np.arctan2(m[..., 2, 1], m[..., 2, 2]))
    c = np.where(locked, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([a, b, c], -1)


def _expmaps(matrices):
    """Continuous exponential maps of (T, 3, 3) rotations."""
    from scipy.spatial.transform import Rotation
    maps = Rotation.from_matrix(matrices).as_rotvec()
    for t in range(1, len(maps)):  # the rotation by angle - 2 pi about the same axis is the same rotation
        angle = np.linalg.norm(maps[t])
        if angle > 1e-9:
            axis = maps[t] / angle
            turns = np.round((maps[t - 1] @ axis - angle) / (2 * np.pi))
            maps[t] += turns * 2 * np.pi * axis
    return maps


def _encode_root(root):
    """Root channels (T, 6) to heading-free ones; y is up, as in Acclaim files."""
    matrices = _matrices(root[:, 3:])
    heading = np.unwrap(np.arctan2(matrices[:, 0, 2], matrices[:, 2, 2]))
    tilt = _expmaps(np.swapaxes(_turned(heading), -1, -2) @ matrices)
    travel = np.diff(root[:, [0, 2]], axis=0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    side = np.cos(middle) * travel[:, 0] - np.sin(middle) * travel[:, 1]
    forward = np.sin(middle) * travel[:, 0] + np.cos(middle) * travel[:, 1]
    steps = np.stack([side, forward, np.diff(heading)], -1)
    steps = np.concatenate([steps[:1] if len(steps) else np.zeros((1, 3)), steps])
    encoded = np.column_stack([steps[:, 0], steps[:, 1], root[:, 1], steps[:, 2], tilt])
    return encoded, np.array([root[0, 0], root[0, 2], heading[0]])


def _decode_root(poses):
    side, forward, height, turning, *tilt = poses.root.T
    # the step into the first frame is not part of the motion
    heading = poses.start[2] + np.concatenate([[0.0], np.cumsum(turning[1:])])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x = poses.start[0] + np.concatenate([[0.0], np.cumsum(np.cos(middle) * side[1:] + np.sin(middle) * forward[1:])])
    z = poses.start[1] + np.concatenate([[0.0], np.cumsum(np.cos(middle) * forward[1:] - np.sin(middle) * side[1:])])
    angles = _euler(_turned(heading) @ rotation_from_expmap(np.stack(tilt, -1)))
    return np.column_stack([x, height, z, continuous_triples(angles, 1)])


def _turned(heading):
    """Rotations about y."""
    zero, one = np.zeros_like(heading), np.ones_like(heading)
    s, c = np.sin(heading), np.cos(heading)
    return np.stack([np.stack([c, zero, s], -1), np.stack([zero, one, zero], -1), np.stack([-s, zero, c], -1)], -2)
