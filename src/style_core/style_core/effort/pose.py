"""Poses in coordinates that may be averaged: exponential maps for ball joints, travel and turning for the root."""
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from style_core.angles import continuous_triples, matrices_of, rotation_from_expmap, triples_from
from style_core.errors import MotionError
from style_core.joint_space import JointSpace, fit_space
from style_core.motion import USUAL_ORDER, Motion, triples_of

__all__ = ['PoseSpace', 'pose_space', 'pose_space_of', 'Poses']

@dataclass(frozen=True, eq=False)
class Poses:
    """A motion in a `PoseSpace`.

    Attributes
    ----------
    joints : ndarray, shape (T, D)
        Coordinates of the joints (`JointSpace`).
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


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """Joints in their `JointSpace`, and the root that is set apart.

    Attributes
    ----------
    joints : JointSpace
        Of the D joint channels, without the root.
    units : tuple of str, length D
    root : str
        Joint whose six channels say where the body is; empty without one.
    root_order : str
        Order in which it turns.
    """

    joints: JointSpace
    units: Tuple[str, ...]
    root: str = ''
    root_order: str = USUAL_ORDER

    @property
    def joint_names(self):
        """Names of the D joint channels."""
        return self.joints.joint_names

    @property
    def has_root(self):
        """Whether there is a root."""
        return bool(self.root)

    def encode(self, motion):
        """Return the `Poses` of a motion.

        Parameters
        ----------
        motion : Motion
            Its joints may turn in other orders than those of the space.

        Raises
        ------
        MotionError
            If joints are absent or values are missing.
        """
        posed = motion.joints(self.joint_names)
        if np.isnan(posed.positions).any():
            raise MotionError(f'motion {motion.name!r} has missing values: fill them first (motion-style fill)')
        joints = self.joints.encode_motion(posed).positions
        if np.isnan(joints).any():
            wrong = self.joint_names[int(np.isnan(joints).any(axis=0).argmax())]
            raise MotionError(f'motion {motion.name!r}: {wrong} passes two whole turns, which is no pose')
        if not self.root:
            return Poses(joints, None, np.zeros(3))
        root = motion.joints(_channels(self.root)).positions
        if np.isnan(root).any():
            raise MotionError(f'motion {motion.name!r} has missing root values: fill them first (motion-style fill)')
        return Poses(joints, *_encode_root(root, motion.order_of(self.root)))

    def decode(self, poses, rate_hz, name='', reference=None):
        """Return the `Motion` of poses at a constant rate; angles are continuous.

        Parameters
        ----------
        poses : Poses
        rate_hz : float
        name : str, optional
        reference : ndarray, shape (D,), optional
            Joint angles that the first frame follows: of equivalent angles the nearest are taken.
        """
        positions = self.joints.decode(poses.joints, reference)
        if reference is not None and len(positions):
            turns = 2 * np.pi * np.round((reference - positions[0]) / (2 * np.pi))
            positions = positions + np.where(self.joints.folds, turns, 0.0)
        names, units, orders = self.joint_names, self.units, dict(self.joints.orders)
        if poses.root is not None:
            names = _channels(self.root) + names
            units = ('m',) * 3 + ('rad',) * 3 + units
            positions = np.concatenate([_decode_root(poses, self.root_order), positions], axis=1)
            orders[self.root] = self.root_order
        return Motion(names, positions, np.arange(len(positions)) / rate_hz, units=units, name=name, orders=orders)


def pose_space(motions):
    """Build the `PoseSpace` of recordings with the same channels.

    A root (``root``, else the first joint with positions and angles along all three axes) is set apart.

    Parameters
    ----------
    motions : sequence of Motion
    """
    first = motions[0]
    root, names = _parted(first.joint_names)
    joints = fit_space([motion.joints(names) for motion in motions])
    units = dict(zip(first.joint_names, first.units))
    return PoseSpace(joints, tuple(units[name] for name in names), root, first.order_of(root))


def pose_space_of(joint_names, has_root):
    """The `PoseSpace` of a library from before: joints turn as Acclaim's do, and home is where all angles are zero."""
    names = tuple(joint_names)
    balls = tuple(triples_of(names))
    home = np.tile(np.eye(3), (len(balls), 1, 1))
    joints = JointSpace(names, balls, {}, home, home, np.zeros(len(names)), np.zeros(len(names), dtype=bool))
    return PoseSpace(joints, ('rad',) * len(names), 'root' if has_root else '')


def _channels(root):
    return tuple(f'{root}.{kind}{axis}' for kind in 'tr' for axis in 'xyz')


def _parted(names):
    """The root, and the names of all other channels."""
    candidates = ['root', *dict.fromkeys(name.rpartition('.')[0] for name in names)]
    root = next((one for one in candidates if one and all(name in names for name in _channels(one))), '')
    others = tuple(name for name in names if not name.startswith((f'{root or "root"}.', 'root.')))
    if not others:
        raise MotionError('there is no joint channel apart from the root')
    return root, others


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


def _encode_root(root, order):
    """Root channels (T, 6) to heading-free ones; y is up, as in Acclaim and BVH files."""
    matrices = matrices_of(root[:, 3:], order)
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


def _decode_root(poses, order):
    side, forward, height, turning, *tilt = poses.root.T
    # the step into the first frame is not part of the motion
    heading = poses.start[2] + np.concatenate([[0.0], np.cumsum(turning[1:])])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x = poses.start[0] + np.concatenate([[0.0], np.cumsum(np.cos(middle) * side[1:] + np.sin(middle) * forward[1:])])
    z = poses.start[1] + np.concatenate([[0.0], np.cumsum(np.cos(middle) * forward[1:] - np.sin(middle) * side[1:])])
    angles = triples_from(_turned(heading) @ rotation_from_expmap(np.stack(tilt, -1)), order)
    return np.column_stack([x, height, z, continuous_triples(angles, 'XYZ'.index(order[1]))])


def _turned(heading):
    """Rotations about y."""
    zero, one = np.zeros_like(heading), np.ones_like(heading)
    s, c = np.sin(heading), np.cos(heading)
    return np.stack([np.stack([c, zero, s], -1), np.stack([zero, one, zero], -1), np.stack([-s, zero, c], -1)], -2)
