"""What a cycle can repeat: joint angles as they are, the root's travel as velocities in the walker's own frame."""
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from style_core.angles import continuous_triples, reordered
from style_core.errors import MotionError
from style_core.joint_space import JointSpace, fit_space
from style_core.motion import Motion

__all__ = ['FeatureMap', 'feature_map']

_ROOT = tuple('root.' + axis for axis in ('tx', 'ty', 'tz', 'rx', 'ry', 'rz'))
_TX, _TY, _TZ, _RX, _RY, _RZ = range(6)


@dataclass(frozen=True)
class FeatureMap:
    """Channels of a motion to features and back.

    A walker's place and heading do not repeat from cycle to cycle; speed does. Where all six root channels are there
    (y up, rotations about fixed axes x, y, z, as Acclaim files have them), ``root.tx``, ``root.tz`` and ``root.ry``
    become sideways speed, forward speed (m/s) and turning rate (rad/s), and ``root.rx``, ``root.rz`` the tilt seen
    from the heading. Every other channel is a feature as its `JointSpace` has it (as it is in files from before).
    """

    joint_names: Tuple[str, ...]
    units: Tuple[str, ...]
    space: Optional[JointSpace] = None

    @property
    def travels(self):
        """Whether the root is among the channels."""
        return _ROOT[0] in self.joint_names

    @property
    def plain(self):
        """Which features are plain channel values: ndarray of bool, shape (F,)."""
        moved = {_ROOT[i] for i in (_TX, _TZ, _RX, _RY, _RZ)} if self.travels else ()
        return np.array([name not in moved for name in self.joint_names])

    @property
    def floors(self):
        """Smallest spread worth modelling: 0.5 deg, 5 mm, 2 cm/s, 2 deg/s; ndarray, shape (F,)."""
        floors = np.where(np.array(self.units) == 'rad', np.radians(0.5), 0.005)
        if self.travels:
            floors[self._root([_TX, _TZ])] = 0.02
            floors[self._root([_RY])] = np.radians(2.0)
        return floors

    def _root(self, which=range(6)):
        return [self.joint_names.index(_ROOT[i]) for i in which]

    def encode(self, motion):
        """Features of a motion that has these joints, shape (T, F); NaN where a value or its velocity is missing."""
        motion = motion.joints(self.joint_names)
        if motion.units != self.units:
            wrong = [name for name, a, b in zip(self.joint_names, motion.units, self.units) if a != b]
            raise MotionError(f'motion {motion.name!r}: the unit of {", ".join(wrong[:5])} differs from the model\'s')
        if self.space is not None:
            motion = self.space.encode_motion(motion)
        motion = reordered(motion, {**motion.orders, 'root': 'XYZ'})
        features = motion.positions.copy()
        if not self.travels:
            return features
        columns = self._root()
        root = features[:, columns]
        tilt_x, heading, tilt_z = _split(root[:, _RX], root[:, _RY], root[:, _RZ])
        there = np.isfinite(heading)
        heading[there] = np.unwrap(heading[there])
        course = Motion(('tx', 'tz', 'heading'), np.stack([root[:, _TX], root[:, _TZ], heading], axis=1), motion.times)
        speed = course.velocities()
        s, c = np.sin(heading), np.cos(heading)
        features[:, columns] = np.stack(
            [
                c * speed[:, 0] - s * speed[:, 1],
                root[:, _TY],
                s * speed[:, 0] + c * speed[:, 1],
                tilt_x,
                speed[:, 2],
                tilt_z,
            ],
            axis=1,
        )
        return features

    def decode(self, features, times, place=(0.0, 0.0), heading=0.0, name=''):
        """Motion with these features; the root starts at ``place`` (x, z; m) with ``heading`` (rad) and travels on.

        Parameters
        ----------
        features : ndarray, shape (T, F)
        times : ndarray, shape (T,)
        """
        positions = features.copy()
        if self.travels:
            columns = self._root()
            root = features[:, columns]
            turned = heading + cumulative_trapezoid(root[:, _RY], times, initial=0.0)
            s, c = np.sin(turned), np.cos(turned)
            x = place[0] + cumulative_trapezoid(c * root[:, _TX] + s * root[:, _TZ], times, initial=0.0)
            z = place[1] + cumulative_trapezoid(c * root[:, _TZ] - s * root[:, _TX], times, initial=0.0)
            rx, ry, rz = _join(root[:, _RX], turned, root[:, _RZ])
            positions[:, columns] = np.stack([x, root[:, _TY], z, rx, ry, rz], axis=1)
        motion = Motion(self.joint_names, positions, times, self.units, name)
        return motion if self.space is None else self.space.decode_motion(motion)


def feature_map(motion, others=()):
    """Feature map of a motion's channels; its joint space is that of this motion and the ``others``.

    Raises
    ------
    MotionError
        If only some of the root's six channels are there: its place cannot be made cyclic then.
    """
    present = [name for name in _ROOT if name in motion.joint_names]
    if present and len(present) < 6:
        raise MotionError(f'motion {motion.name!r} has {", ".join(present)} but not all of {", ".join(_ROOT)}; '
                          "leave the root out ('!root.*') or give all six channels")
    space = fit_space([motion, *others], leave=('root',) if present else ())
    return FeatureMap(motion.joint_names, motion.units, space)


def _split(rx, ry, rz):
    """Heading about the vertical y, and the tilts (about x and z) of what remains of Rz Ry Rx without it."""
    sx, cx, sy, cy, sz, cz = (g(a) for a in (rx, ry, rz) for g in (np.sin, np.cos))
    heading = np.arctan2(cz * sy * cx + sz * sx, cy * cx)           # of the body's z axis, seen from above
    s, c = np.sin(heading), np.cos(heading)
    # rows of R_y(-heading) Rz Ry Rx that hold its angles
    r21 = s * (cz * sy * sx - sz * cx) + c * cy * sx
    r22 = s * (cz * sy * cx + sz * sx) + c * cy * cx
    r10 = sz * cy
    r00 = c * cz * cy + s * sy
    return np.arctan2(r21, r22), heading, np.arctan2(r10, r00)


def _join(tilt_x, heading, tilt_z):
    """Angles (rx, ry, rz) of R_y(heading) times the tilt; the inverse of `_split`, ry and rz unwrapped."""
    sx, cx, sz, cz = np.sin(tilt_x), np.cos(tilt_x), np.sin(tilt_z), np.cos(tilt_z)
    sy = np.clip(-np.tan(tilt_z) * np.tan(tilt_x), -1.0, 1.0)       # the body's z axis has no sideways part
    cy = np.sqrt(1.0 - sy * sy)
    s, c = np.sin(heading), np.cos(heading)
    r00 = c * cz * cy - s * sy
    r10 = sz * cy
    r20 = -s * cz * cy - c * sy
    r21 = -s * (cz * sy * sx - sz * cx) + c * cy * sx
    r22 = -s * (cz * sy * cx + sz * sx) + c * cy * cx
    ry = np.arctan2(-r20, np.hypot(r00, r10))
    rx, rz = np.arctan2(r21, r22), np.arctan2(r10, r00)
    return continuous_triples(np.stack([rx, ry, rz], axis=1), 1).T
