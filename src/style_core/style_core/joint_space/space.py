"""`JointSpace`: what joints are learned in, and back, exactly."""
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from typing import Mapping, Tuple

import numpy as np

from style_core.angles import matrices_of, reordered, triples_from
from style_core.errors import ModelError, MotionError
from style_core.joint_space import kernels
from style_core.model_file import load_model
from style_core.motion import USUAL_ORDER, triples_of

__all__ = ['JointSpace', 'fit_space', 'read_space', 'space_of']

#: an angle is folded to the turn of its centre only if all that was seen of it lies within this of the centre, rad
_FOLDED = np.radians(170.0)
#: angles beyond this are no pose of a joint and are not folded, rad
_MOST = 4 * np.pi
#: cosine of the middle angle at home from which on each coordinate belongs to one angle well enough
_APART = 0.8
#: entries of a model file's header and arrays
_ENTRY = 'joint_space'
_ARRAYS = ('homes', 'frames', 'centres', 'folds')


@dataclass(frozen=True, eq=False)
class JointSpace:
    """Angles of joints to coordinates and back.

    A ball joint (three angles ``.rx``, ``.ry``, ``.rz``) with rotation R has the rotation vector of R seen from the
    joint's home rotation H, its mean over the training recordings: ``R = H exp(F q)``. The frame F is the rotation
    next to the axes about which the three angles turn at home, so that each coordinate takes the place of one angle
    and, near home and away from the gimbal lock, is its change. The coordinates are a function of the pose: neither
    which of the equivalent triples a file holds nor its whole turns matter, and no pose nearer than half a turn to
    home is singular. Angles of joints with one or two of them are brought to the turn of their centre, unless the
    joint was seen to go round; lengths stay as they are.

    Attributes
    ----------
    joint_names : tuple of str, length D
    balls : tuple of str, length K
        Joints with three angles.
    orders : mapping of str to str
        Order in which each of them turns, as `Motion.orders`.
    homes, frames : ndarray, shape (K, 3, 3)
    centres : ndarray, shape (D,)
        Rad; zero for ball joints and lengths.
    folds : ndarray of bool, shape (D,)
        Which angles are brought to the turn of their centre.
    """

    joint_names: Tuple[str, ...]
    balls: Tuple[str, ...]
    orders: Mapping[str, str]
    homes: np.ndarray
    frames: np.ndarray
    centres: np.ndarray
    folds: np.ndarray
    _index: Mapping[str, int] = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, 'orders', {joint: self.orders.get(joint, USUAL_ORDER) for joint in self.balls})
        object.__setattr__(self, '_index', {name: index for index, name in enumerate(self.joint_names)})

    @cached_property
    def columns(self):
        """Columns of the angles about x, y and z of each ball joint, ndarray of int, shape (K, 3)."""
        return np.array([[self._index[f'{joint}.r{letter}'] for letter in 'xyz'] for joint in self.balls],
                        dtype=np.int32).reshape(-1, 3)

    @cached_property
    def axes(self):
        """Axes in the order in which each ball joint turns, ndarray of int, shape (K, 3)."""
        return np.array([['XYZ'.index(letter) for letter in self.orders[joint]] for joint in self.balls],
                        dtype=np.int32).reshape(-1, 3)

    @cached_property
    def home(self):
        """Angles at home, rad, shape (D,): the pose with ball coordinates of zero and other angles at their centre."""
        angles = self.centres.copy()
        for home, joint, columns in zip(self.homes, self.balls, self.columns):
            angles[columns] = triples_from(home, self.orders[joint])
        return angles

    @cached_property
    def apart(self):
        """Ball joints of which single angles say something (away from the gimbal lock at home), bool, shape (K,)."""
        middle = self.columns[np.arange(len(self.balls)), self.axes[:, 1]] if self.balls else np.empty(0, dtype=int)
        return np.cos(self.home[middle]) >= _APART

    @property
    def plain(self):
        """Whether nothing is to be done: no ball joint, nothing to fold."""
        return not self.balls and not self.folds.any()

    def turns(self, angles):
        """Whole turns that bring angles to the turn of their centre, rad, shape as ``angles`` (..., D)."""
        with np.errstate(invalid='ignore'):
            turns = 2 * np.pi * np.round((self.centres - angles) / (2 * np.pi))
            return np.where(self.folds & (np.abs(angles) <= _MOST), turns, 0.0)

    def encode(self, angles):
        """Coordinates of poses.

        Parameters
        ----------
        angles : ndarray, shape (..., D)
            Rad (or m); a ball joint of which an angle is missing (NaN) or beyond two turns is missing as a whole.

        Returns
        -------
        ndarray, shape (..., D)
        """
        angles = np.asarray(angles, dtype=np.float64)
        rows = np.ascontiguousarray(angles.reshape(-1, len(self.joint_names)))
        result = rows + self.turns(rows)
        kernels.encode(rows, self.columns, self.axes, self.homes, self.frames, result)
        return result.reshape(angles.shape)

    def encode_some(self, angles):
        """Coordinates of poses, shape (T, D), where single angles of ball joints may be missing.

        The coordinates of those that are there count, the others taken as at home, away from the gimbal lock; else the
        joint is missing as a whole.
        """
        there = ~np.isnan(angles)
        of_ball = there[:, self.columns]                                     # (T, K, 3)
        partly = of_ball.any(axis=2) & ~of_ball.all(axis=2) & self.apart
        if not partly.any():
            return self.encode(angles)
        given = angles.copy()
        for k, columns in enumerate(self.columns):
            rows = np.flatnonzero(partly[:, k])
            given[np.ix_(rows, columns)] = np.where(of_ball[rows, k], angles[np.ix_(rows, columns)], self.home[columns])
        values = self.encode(given)
        values[:, self.columns] = np.where(partly[:, :, None] & ~of_ball, np.nan, values[:, self.columns])
        return values

    def decode(self, values, near=None, std=None, velocity=None):
        """Angles of coordinates; of equivalent angles of a ball joint those nearest to the frame before.

        Parameters
        ----------
        values : ndarray, shape (..., D)
            Rad (or m).
        near : ndarray, shape (D,), optional
            Angles that the first frame follows, rad; those at home where left out.
        std, velocity : ndarray, shape (..., D), optional
            Standard deviations and rates of the coordinates.

        Returns
        -------
        angles : ndarray, shape (..., D)
        std, velocity : ndarray, shape (..., D)
            To first order, only those that are given: ``J diag(std^2) J^T`` and ``J velocity`` with the derivative J
            of the angles by the coordinates. Within 1.1 degrees of the gimbal lock J is that at this distance; no
            standard deviation is larger than half a turn.
        """
        values = np.asarray(values, dtype=np.float64)
        rows = np.ascontiguousarray(values.reshape(-1, values.shape[-1]))
        result = rows.copy()
        near = np.array(self.home if near is None else near, dtype=np.float64)
        rates = [None if one is None else np.array(one, dtype=np.float64).reshape(rows.shape)
                 for one in (std, velocity)]
        kernels.decode(rows, self.columns, self.axes, self.homes, self.frames, near, result, *rates)
        given = [one.reshape(values.shape) for one in rates if one is not None]
        return (result.reshape(values.shape), *given) if given else result.reshape(values.shape)

    def encode_motion(self, motion):
        """The motion in these coordinates; channels that the space does not know stay, joints that are absent too.

        Parameters
        ----------
        motion : Motion
            A ball joint may turn in another order than the space's.
        """
        motion = reordered(motion, {**motion.orders, **self.orders})
        there = [name for name in self.joint_names if name in motion.joint_names]
        place = [motion.joint_names.index(name) for name in there]
        angles = np.full((motion.n_frames, len(self.joint_names)), np.nan)
        own = [self._index[name] for name in there]
        angles[:, own] = motion.positions[:, place]
        positions = motion.positions.copy()
        positions[:, place] = self.encode_some(angles)[:, own]
        return motion.replace(positions=positions)

    def decode_motion(self, motion, near=None):
        """The motion in angles; see `decode`. Its ball joints must be whole."""
        there = [name for name in self.joint_names if name in motion.joint_names]
        place = [motion.joint_names.index(name) for name in there]
        values = np.zeros((motion.n_frames, len(self.joint_names)))
        own = [self._index[name] for name in there]
        values[:, own] = motion.positions[:, place]
        positions = motion.positions.copy()
        positions[:, place] = self.decode(values, near)[:, own]
        orders = {joint: order for joint, order in self.orders.items() if joint in motion.triples}
        return motion.replace(positions=positions, orders={**motion.orders, **orders})

    def fill_in(self, angles, values, std):
        """Fill the gaps of a recording from coordinates.

        Parameters
        ----------
        angles : ndarray, shape (T, D)
            Rad; NaN where missing.
        values, std : ndarray, shape (T, D)
            Coordinates of all joints in every frame (those observed among them), and their standard deviations.

        Returns
        -------
        filled, std : ndarray, shape (T, D)
            No angle that was there is changed; those that are filled in follow its branch.
        """
        filled, spread = angles.copy(), std.copy()
        holes = np.isnan(angles)
        near = self.home.copy()
        known = ~holes
        for column in np.flatnonzero(known.any(axis=0)):  # a gap at the start follows what comes after it
            near[column] = angles[np.argmax(known[:, column]), column]
        for t in range(len(angles)):
            decoded, spread[t] = self.decode(values[t], near, std[t])
            turns = np.where(self.folds, 2 * np.pi * np.round((near - decoded) / (2 * np.pi)), 0.0)
            filled[t] = np.where(holes[t], decoded + turns, angles[t])
            near = filled[t]
        return filled, spread

    def select(self, names):
        """The space of some channels, in their order; ModelError for a ball joint without one of its angles."""
        names = tuple(names)
        chosen = [k for k, joint in enumerate(self.balls) if any(f'{joint}.r{letter}' in names for letter in 'xyz')]
        torn = [self.balls[k] for k in chosen if not all(f'{self.balls[k]}.r{letter}' in names for letter in 'xyz')]
        if torn:
            raise ModelError(f'the joint {torn[0]} was learned as a whole: take all of its angles or none')
        absent = [name for name in names if name not in self._index]
        if absent:
            raise ModelError(f'the joint space of the model does not know {", ".join(absent[:5])}: the file is damaged')
        place = [self._index[name] for name in names]
        return JointSpace(names, tuple(self.balls[k] for k in chosen), self.orders, self.homes[chosen],
                          self.frames[chosen], self.centres[place], self.folds[place])

    def entries(self):
        """What a model file says of the space: (header entries, arrays); `read_space` reads them."""
        about = {'balls': list(self.balls), 'orders': dict(self.orders), 'joint_names': list(self.joint_names)}
        return {_ENTRY: about}, {f'{_ENTRY}.{name}': getattr(self, name) for name in _ARRAYS}


def read_space(header, arrays):
    """The joint space of a model file, or None: the model was learned in the angles themselves.

    Raises
    ------
    ModelError
        If it is damaged.
    """
    if _ENTRY not in header:
        return None
    try:
        about = header[_ENTRY]
        parts = [np.ascontiguousarray(arrays[f'{_ENTRY}.{name}']) for name in _ARRAYS]
        space = JointSpace(tuple(about['joint_names']), tuple(about['balls']), dict(about['orders']),
                           *(part.astype(float) for part in parts[:3]), parts[3].astype(bool))
        count, channels = len(space.balls), len(space.joint_names)
        shapes = {'homes': (count, 3, 3), 'frames': (count, 3, 3), 'centres': (channels,), 'folds': (channels,)}
        for name, shape in shapes.items():
            if getattr(space, name).shape != shape or not np.isfinite(getattr(space, name)).all():
                raise ValueError(f'{name} does not fit')
        for turn in (*space.homes, *space.frames):
            if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or np.linalg.det(turn) < 0:
                raise ValueError('a rotation is none')
        if any(sorted(order) != ['X', 'Y', 'Z'] for order in space.orders.values()):
            raise ValueError('a rotation order is none')
        space.columns  # noqa: B018 (its channels are all there)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f'the joint space of the model is damaged: {error}') from None
    return space


def space_of(path):
    """The joint space of a model file, or None (ModelError for a file that is none or damaged)."""
    return read_space(*load_model(path))


def fit_space(motions, leave=()):
    """The joint space of recordings with the same channels.

    Parameters
    ----------
    motions : sequence of Motion
        Every recording counts alike; the orders of the first are those of the space.
    leave : collection of str
        Joints whose angles stay as they are (a root that travels).

    Returns
    -------
    JointSpace

    Raises
    ------
    MotionError
        If a joint has no frame with all its angles.

    Warns
    -----
    UserWarning
        Of ball joints that go further than 170 degrees from home: at half a turn their coordinates jump.
    """
    first = motions[0]
    names, units = first.joint_names, first.units
    triples = {joint: columns for joint, columns in triples_of(names).items() if joint not in leave}
    balls, homes, frames, far = [], [], [], []
    motions = [reordered(motion.joints(names), first.orders) for motion in motions]
    for joint, columns in triples.items():
        order = first.order_of(joint)
        turns = [_whole(motion.positions[:, columns], order) for motion in motions]
        turns = [turn for turn in turns if len(turn)]
        if not turns:
            raise MotionError(f'no recording ever shows all angles of {joint}: leave it out')
        home = _projected(sum(turn.mean(axis=0) for turn in turns))
        balls.append(joint)
        homes.append(home)
        frames.append(_frame(triples_from(home, order), order))
        least = min(np.trace(home.T @ turn, axis1=1, axis2=2).min() for turn in turns)
        if least < 1 + 2 * np.cos(_FOLDED):
            far.append(joint)
    if far:
        warnings.warn(f'{", ".join(far[:5])} turn further than 170 degrees from their mean rotation: what is learned '
                      f'of them jumps at half a turn', stacklevel=2)
    centres, folds = np.zeros(len(names)), np.zeros(len(names), dtype=bool)
    in_ball = {column for columns in triples.values() for column in columns}
    for column, (name, unit) in enumerate(zip(names, units)):
        if unit == 'rad' and column not in in_ball and name.rpartition('.')[0] not in leave:
            centres[column], folds[column] = _centre([motion.positions[:, column] for motion in motions])
    stack = np.array(homes).reshape(-1, 3, 3), np.array(frames).reshape(-1, 3, 3)
    return JointSpace(names, tuple(balls), first.orders, *stack, centres, folds)


def _whole(triples, order):
    return matrices_of(triples[~np.isnan(triples).any(axis=1)], order)


def _projected(matrix):
    """The rotation nearest to a matrix."""
    u, _, v = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def _frame(angles, order):
    """The rotation nearest to the axes of the three angles, in the body's frame; columns x, y, z."""
    axes, inner = np.empty((3, 3)), np.eye(3)
    for letter in order:
        axis = 'XYZ'.index(letter)
        axes[:, axis] = inner.T[:, axis]
        turn = np.zeros(3)
        turn[axis] = angles[axis]
        inner = matrices_of(turn, letter) @ inner
    return _projected(axes)


def _centre(columns):
    """Centre of an angle over recordings that count alike, and whether all of it lies on one turn around it."""
    seen = [column[~np.isnan(column)] for column in columns]
    seen = [column for column in seen if len(column)]
    total = sum((np.exp(1j * column).mean() for column in seen), 0j)
    centre = float(np.angle(total)) if abs(total) > 1e-9 else 0.0
    for column in seen:
        turn = 2 * np.pi * np.round((centre - np.median(column)) / (2 * np.pi))
        if np.abs(column + turn - centre).max() > _FOLDED:
            return 0.0, False
    return centre, True
