"""Skeleton trees from ASF, BVH and URDF files, and forward kinematics over all frames at once."""
import importlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Mapping, Tuple

import numpy as np

from style_core.angles import rotation_about
from style_core.errors import MotionError

__all__ = ['Channel', 'Body', 'Skeleton', 'read_skeleton', 'euler_matrix']

_READERS = {'.asf': 'style_core.formats.asf', '.bvh': 'style_core.formats.bvh', '.urdf': 'style_core.formats.urdf'}


@dataclass(frozen=True)
class Channel:
    """One degree of freedom of a body.

    Attributes
    ----------
    name : str
        Channel of the motion that moves it.
    kind : {'r', 't'}
        Rotation about, or translation along, ``axis``.
    axis : tuple of three float
        Unit vector in the body's frame.
    low, high : float
        Limits, rad or m; infinite where there are none.
    scale, offset : float
        The body moves by ``scale * value + offset`` (URDF mimic joints).
    rest : float
        Value at rest. The body moves by what the value differs from it: a BVH position channel replaces this component
        of the body's ``offset``.
    """

    name: str
    kind: str
    axis: Tuple[float, float, float]
    low: float = -np.inf
    high: float = np.inf
    scale: float = 1.0
    offset: float = 0.0
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class Body:
    """A link of the tree.

    Its pose is ``parent pose * translation(offset) * before * channels * after * translation(tip)``: a BVH or URDF body
    sits at its joint (``tip`` zero), an ASF bone at its far end (``offset`` zero).
    """

    name: str
    parent: int
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    before: np.ndarray = field(default_factory=lambda: np.eye(3))
    channels: Tuple[Channel, ...] = ()
    after: np.ndarray = field(default_factory=lambda: np.eye(3))
    tip: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of bodies.

    Attributes
    ----------
    name : str
    bodies : tuple of Body
        Every parent before its children.
    channel_names : tuple of str
        In the order of the file.
    length_m : float
        One length unit of the file in metres.
    up : {'y', 'z'}
        Which axis points up.
    orders : mapping of str to str
        Order of rotation of each joint with three angles, as `style_core.angles.continuous` takes it.
    """

    name: str
    bodies: Tuple[Body, ...]
    channel_names: Tuple[str, ...]
    length_m: float = 1.0
    up: str = 'y'
    orders: Mapping[str, str] = field(default_factory=dict)

    @property
    def body_names(self):
        """Names of the B bodies, in the order of `forward`."""
        return tuple(body.name for body in self.bodies)

    @property
    def parents(self):
        """Index of each body's parent, -1 for a root; shape (B,)."""
        return np.array([body.parent for body in self.bodies])

    @property
    def dofs(self):
        """Joint -> its degrees of freedom (``('rx', 'rz')``), for channels named ``joint.rx``."""
        dofs = {}
        for name in self.channel_names:
            joint, _, dof = name.rpartition('.')
            dofs[joint] = dofs.get(joint, ()) + (dof,)
        return dofs

    def limits(self, joint_names):
        """Limits of channels.

        Returns
        -------
        low, high : ndarray, shape (D,)
            Rad or m; infinite where the file gives none.
        """
        self.check_channels(joint_names)
        low, high = dict.fromkeys(self.channel_names, -np.inf), dict.fromkeys(self.channel_names, np.inf)
        for channel in (channel for body in self.bodies for channel in body.channels):
            low[channel.name] = max(low[channel.name], channel.low)
            high[channel.name] = min(high[channel.name], channel.high)
        return np.array([low[name] for name in joint_names]), np.array([high[name] for name in joint_names])

    def forward(self, motion):
        """Positions of all bodies.

        Parameters
        ----------
        motion : Motion
            Channels of this skeleton; one that is absent stays at zero, so a recording without its root stands at
            the origin.

        Returns
        -------
        ndarray, shape (T, B, 3)
            Metres; NaN where a missing angle leaves the position open.

        Raises
        ------
        MotionError
            If the motion has a channel that the skeleton lacks.
        """
        return self.poses(motion)[0]

    def poses(self, motion):
        """Positions, shape (T, B, 3), and rotation matrices, shape (T, B, 3, 3); see `forward`."""
        self.check_channels(motion.joint_names)
        return self._poses(dict(zip(motion.joint_names, motion.positions.T)), motion.n_frames)

    def _poses(self, values_of, count):
        """Positions and rotations of ``count`` frames; ``values_of`` channels, shape (count,); others are at rest."""
        positions = np.empty((count, len(self.bodies), 3))
        rotations = np.empty((count, len(self.bodies), 3, 3))
        for index, body in enumerate(self.bodies):
            # a body that does not move yet has one frame only, which broadcasts
            if body.parent < 0:
                turn, place = body.before[None], body.offset[None]
            else:
                turn = rotations[:, body.parent]
                place = positions[:, body.parent] + turn @ body.offset
                turn = turn @ body.before
            for channel in body.channels:
                if channel.name in values_of:
                    values = (values_of[channel.name] - channel.rest) * channel.scale + channel.offset
                elif channel.offset:
                    values = np.array([channel.offset])
                else:
                    continue
                if channel.kind == 't':
                    place = place + (turn @ np.array(channel.axis)) * values[:, None]
                else:
                    turn = turn @ rotation_about(channel.axis, values)
            turn = turn @ body.after
            positions[:, index] = place + turn @ body.tip
            rotations[:, index] = turn
        return positions, rotations

    def rest(self):
        """Positions, shape (B, 3), and rotations, shape (B, 3, 3), with all channels at rest."""
        positions, rotations = self._poses({}, 1)
        return positions[0], rotations[0]

    def rest_axes(self):
        """Channel -> (kind, direction, shape (3,)) in the world, with all channels at rest."""
        _, rotations = self.rest()
        axes = {}
        for index, body in enumerate(self.bodies):
            # at rest all channels of a body share the frame before them
            frame = rotations[index] @ body.after.T
            for channel in body.channels:
                axes.setdefault(channel.name, (channel.kind, frame @ np.array(channel.axis) * np.sign(channel.scale)))
        return axes

    def check_channels(self, joint_names):
        """Raise MotionError if the skeleton lacks one of the channels."""
        unknown = [name for name in joint_names if name not in set(self.channel_names)]
        if unknown:
            raise MotionError(f'skeleton {self.name!r} has no channel {", ".join(unknown[:5])}; it has '
                              f'{", ".join(self.channel_names[:8])}{" ..." if len(self.channel_names) > 8 else ""}')


def read_skeleton(path, length_m=None):
    """Read a skeleton from an ``.asf``, ``.bvh`` or ``.urdf`` file.

    Parameters
    ----------
    path : path-like
    length_m : float, optional
        Length unit of a BVH file, which does not say (0.01 where left out).

    Returns
    -------
    Skeleton

    Raises
    ------
    MotionError
        If the file is absent, damaged or of another format.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        from style_core.formats import refuse
        refuse(path)
        raise MotionError(f'{path}: skeletons are read from {", ".join(_READERS)} files, not {suffix!r}')
    reader = importlib.import_module(_READERS[suffix]).read_skeleton
    if length_m is None:
        return reader(path)
    if suffix != '.bvh':
        raise MotionError(f'{path}: a length unit can be given for BVH files only, {suffix} files say it themselves')
    return reader(path, length_m)


def euler_matrix(angles, order):
    """Rotation matrix of turns about fixed axes, the first letter of ``order`` first.

    Parameters
    ----------
    angles : sequence of float
        Rad, one for each letter.
    order : str
        E.g. ``'XYZ'``: the product is Rz Ry Rx.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    matrix = np.eye(3)
    for angle, letter in zip(angles, order.upper()):
        matrix = rotation_about(np.eye(3)['XYZ'.index(letter)], np.array([angle]))[0] @ matrix
    return matrix
