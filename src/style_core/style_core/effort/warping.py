"""Dynamic time warping: how alike two motions are once timing is set aside, and which frames correspond."""
from typing import NamedTuple

import numpy as np

from style_core.effort import _warp
from style_core.errors import MotionError

__all__ = ['Warp', 'warp', 'squared_distances', 'smooth_warp', 'SLOPE_LIMIT']

#: bound on |d delta / d s| of a smooth warp, see `smooth_warp`; keeps time running forwards for alpha in [-0.25, 1.25]
SLOPE_LIMIT = 0.6


class Warp(NamedTuple):
    """A time alignment of two motions.

    Attributes
    ----------
    cost : float
        SSD of equation (3): sum of squared distances along the path.
    rows, columns : ndarray of int32, shape (L,)
        Corresponding frames of the first and the second motion.
    """

    cost: float
    rows: np.ndarray
    columns: np.ndarray

    @property
    def mean_cost(self):
        """Cost per point of the path: comparable between motions of different lengths."""
        return self.cost / len(self.rows)


def squared_distances(first, second):
    """Squared Euclidean distances of all frame pairs.

    Parameters
    ----------
    first : ndarray, shape (n, D)
    second : ndarray, shape (m, D)

    Returns
    -------
    ndarray, shape (n, m)
    """
    # a common shift keeps the three-term formula from cancelling when poses lie far from zero
    centre = second.mean(axis=0)
    first, second = first - centre, second - centre
    distances = first @ second.T
    distances *= -2.0
    distances += np.einsum('ij,ij->i', first, first)[:, None]
    distances += np.einsum('ij,ij->i', second, second)
    return np.maximum(distances, 0.0, out=distances)


def warp(first, second):
    """Align two motions in time.

    Equations (3)-(5) of Torresani, Hackney and Bregler (2006).

    Parameters
    ----------
    first : array_like, shape (n, D)
    second : array_like, shape (m, D)

    Returns
    -------
    Warp

    Raises
    ------
    MotionError
        If a motion is empty, not finite, or the numbers of channels differ.
    """
    first, second = _checked(first), _checked(second)
    if first.shape[1] != second.shape[1]:
        raise MotionError(f'cannot warp motions of {first.shape[1]} and {second.shape[1]} channels')
    costs = np.empty((len(first), len(second)))
    _warp.warp_costs(np.ascontiguousarray(squared_distances(first, second)), costs)
    longest = len(first) + len(second) - 1
    rows, columns = np.empty(longest, np.int32), np.empty(longest, np.int32)
    length = _warp.trace_path(costs, rows, columns)
    return Warp(float(costs[-1, -1]), rows[:length][::-1], columns[:length][::-1])


def smooth_warp(path, smoothing_frames=8.0):
    """Turn the staircase of a warp into a smooth curve along which time always runs forwards.

    With s = (p + q) / 2 and delta = (q - p) / 2 the path is a function delta(s). Its slope is smoothed with a Gaussian
    and then projected onto the slopes within ``SLOPE_LIMIT`` that reach the same end, so that for every alpha in
    [-0.25, 1.25] the blended time s + (2 alpha - 1) delta increases strictly.

    Parameters
    ----------
    path : Warp
    smoothing_frames : float
        Standard deviation of the Gaussian, in frames; 0 leaves the staircase (within the slope limit).

    Returns
    -------
    s, delta : ndarray, shape (N,)
        Samples of the curve every half frame; s increases from 0 to (n + m - 2) / 2.

    Raises
    ------
    MotionError
        If one motion is more than four times as long as the other, or shorter than two frames.
    """
    from scipy.ndimage import gaussian_filter1d
    n, m = int(path.rows[-1]), int(path.columns[-1])
    if min(n, m) < 1:
        raise MotionError('a fragment of a single frame cannot be interpolated')
    end, total = (n + m) / 2, (m - n) / 2
    if abs(total) > SLOPE_LIMIT * end:
        raise MotionError(f'fragments of {n + 1} and {m + 1} frames differ too much in length to be interpolated '
                          '(at most four times)')
    s = np.linspace(0.0, end, n + m + 1)
    centre = (path.rows + path.columns) / 2
    staircase = np.interp(s, centre, (path.columns - path.rows) / 2)
    slope = np.diff(staircase) / np.diff(s)
    if smoothing_frames > 0:
        slope = gaussian_filter1d(slope, 2.0 * smoothing_frames, mode='nearest')
    slope = _project(slope, total / end, SLOPE_LIMIT)
    delta = np.concatenate([[0.0], np.cumsum(slope * np.diff(s))])
    delta[-1] = total
    return s, delta


def _project(values, mean, limit):
    """Nearest values within +-limit that have the mean: a clipped common shift, found by bisection."""
    low, high = mean - limit - values.max(), mean + limit - values.min()
    low, high = min(low, -limit - values.max()), max(high, limit - values.min())
    for _ in range(100):
        shift = 0.5 * (low + high)
        if np.clip(values + shift, -limit, limit).mean() < mean:
            low = shift
        else:
            high = shift
    return np.clip(values + 0.5 * (low + high), -limit, limit)


def _checked(frames):
    frames = np.ascontiguousarray(frames, dtype=np.float64)
    if frames.ndim != 2 or not frames.size:
        raise MotionError(f'a motion to warp must have shape (T, D) with T, D > 0, got {frames.shape}')
    if not np.isfinite(frames).all():
        raise MotionError('a motion to warp has missing values: fill them first (motion-style fill)')
    return frames
