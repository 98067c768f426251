"""A motion as solid parts: what a viewer moves from frame to frame."""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.errors import MotionError
from style_core.mirroring import partner_name
from style_core.sizes import demand

__all__ = ['Figure', 'bone_parts', 'figure_of', 'quaternions', 'sides', 'turned_up']

#: width of a bone as a share of the body's height; least and most share of the bone's length
_BONE, _SLIMMEST, _STOUTEST = 0.022, 0.05, 0.6
#: how far the left side goes towards white, so that near and far stay apart
_LEFT_TINT, _MIDDLE_TINT = 0.45, 0.2


@dataclass(frozen=True, eq=False)
class Figure:
    """P solid parts over T frames, in a world whose z axis points up.

    Attributes
    ----------
    name : str
    times : ndarray, shape (T,)
        s.
    shapes : tuple of str, length P
        ``'box'``, ``'cylinder'`` (along its z axis), ``'sphere'``, or a cylinder with a ball at the end, ``'bone'``,
        and ``'head'``, with a larger one.
    positions : ndarray of float32, shape (T, P, 3)
        Centres, m; NaN where a missing angle leaves the place open.
    wxyzs : ndarray of float32, shape (T, P, 4)
        Unit quaternions.
    scales : ndarray of float32, shape (T, P, 3)
        Extents along the part's own axes, m.
    colours : ndarray of uint8, shape (P, 3)
    body_names : tuple of str, length B
    points : ndarray, shape (T, B, 3)
        Where each body of the skeleton is, m.
    rotations : ndarray, shape (T, B, 3, 3)
    """

    name: str
    times: np.ndarray
    shapes: Tuple[str, ...]
    positions: np.ndarray
    wxyzs: np.ndarray
    scales: np.ndarray
    colours: np.ndarray
    body_names: Tuple[str, ...]
    points: np.ndarray
    rotations: np.ndarray

    def frame_at(self, seconds):
        """Number of the frame in force ``seconds`` after the first; the first or last beyond the ends."""
        frame = np.searchsorted(self.times, self.times[0] + seconds + 1e-9, side='right') - 1
        return int(np.clip(frame, 0, len(self.times) - 1))

    @property
    def duration_s(self):
        """From the first frame to the last, s."""
        return float(self.times[-1] - self.times[0])

    def moved(self, offset):
        """The same, displaced by ``offset``, shape (3,) or (T, 3), m."""
        offset = np.broadcast_to(np.asarray(offset, dtype=float), (len(self.times), 3))[:, None]
        return Figure(self.name, self.times, self.shapes, (self.positions + offset).astype(np.float32), self.wxyzs,
                      self.scales, self.colours, self.body_names, self.points + offset, self.rotations)


def figure_of(motion, skeleton, colour=(213, 94, 0)):
    """A person as bones and joints.

    Parameters
    ----------
    motion : Motion
        Channels of the skeleton; absent ones stay at rest.
    skeleton : Skeleton
    colour : three int
        Of the right side; left side and trunk are lighter.

    Returns
    -------
    Figure

    Raises
    ------
    MotionError
        If the motion has no channel of the skeleton, or one that it lacks.
    """
    demand(100 * motion.n_frames * len(skeleton.bodies), f'{motion.name or "the motion"} as a body', 'a shorter piece')
    points, rotations = turned_up(skeleton, *skeleton.poses(motion))
    return Figure(motion.name, motion.times, *bone_parts(skeleton, points, colour), skeleton.body_names, points,
                  rotations)


def turned_up(skeleton, points, rotations):
    """Positions (T, B, 3) and rotations (T, B, 3, 3) with z up, whatever axis of the skeleton's points up."""
    if skeleton.up == 'z':
        return points, rotations
    if skeleton.up != 'y':
        raise MotionError(f'skeleton {skeleton.name!r}: up is {skeleton.up!r}, not y or z')
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])    # x to y, y to z, z to x
    return points @ turn.T, turn @ rotations


def bone_parts(skeleton, points, colour):
    """Shapes, positions, quaternions, scales and colours of bones and joints; see `Figure`."""
    parents, names = skeleton.parents, list(skeleton.body_names)
    children = np.flatnonzero(parents >= 0)
    along = points[:, children] - points[:, parents[children]]
    lengths = np.linalg.norm(along, axis=2)
    typical = np.nanmedian(np.where(np.isfinite(lengths), lengths, 0.0), axis=0)
    children, along, lengths, typical = (array[..., typical > 1e-4] if array.ndim < 3 else array[:, typical > 1e-4]
                                         for array in (children, along, lengths, typical))
    width = np.clip(_BONE * _height(skeleton), _SLIMMEST * typical, _STOUTEST * typical)
    middle = (points[:, children] + points[:, parents[children]]) / 2
    paint = tinted(colour, sides([names[child] for child in children], names))
    scales = np.stack([np.broadcast_to(width, lengths.shape)] * 2 + [lengths], axis=-1).astype(np.float32)
    shapes = tuple('head' if names[child].lower() == 'head' else 'bone' for child in children)
    paint = tinted(colour, sides([names[child] for child in children], names))
    return shapes, middle.astype(np.float32), _towards(along).astype(np.float32), scales, paint


def sides(names, among):
    """``'left'``, ``'right'`` or ``'middle'`` for each name, from the partner it has ``among`` the names."""
    found = []
    for name in names:
        partner = partner_name(name, among)
        differing = next((a for a, b in zip(name, partner) if a != b), '')
        found.append('middle' if partner == name else 'left' if differing in 'lL' else 'right')
    return found


def tinted(colour, which):
    """Colours, uint8 of shape (P, 3): full on the right, lighter in the middle, lightest on the left."""
    share = np.array([{'left': _LEFT_TINT, 'middle': _MIDDLE_TINT, 'right': 0.0}[side] for side in which])[:, None]
    return ((1 - share) * np.asarray(colour, dtype=float) + share * 255).round().astype(np.uint8)


def quaternions(rotations):
    """Unit quaternions (w, x, y, z), shape (..., 4), of rotation matrices, shape (..., 3, 3); NaN stays NaN."""
    from scipy.spatial.transform import Rotation
    flat = rotations.reshape(-1, 3, 3)
    known = np.isfinite(flat).all(axis=(1, 2))
    result = np.full((len(flat), 4), np.nan)
    if known.any():
        result[known] = np.roll(Rotation.from_matrix(flat[known]).as_quat(), 1, axis=1)
    return result.reshape(*rotations.shape[:-2], 4)


def _towards(along):
    """Quaternions that turn the z axis into the directions ``along``, shape (T, S, 3): the shortest way."""
    with np.errstate(invalid='ignore', divide='ignore'):
        x, y, z = np.moveaxis(along / np.linalg.norm(along, axis=-1, keepdims=True), -1, 0)
    w = 1.0 + z
    result = np.stack([w, -y, x, np.zeros_like(x)], axis=-1)
    result[w < 1e-9] = (0.0, 1.0, 0.0, 0.0)     # straight down: half a turn about x
    return result / np.linalg.norm(result, axis=-1, keepdims=True)


def _height(skeleton):
    return max(float(np.ptp(skeleton.rest()[0], axis=0).max()), 1e-3)
