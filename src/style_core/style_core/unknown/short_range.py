"""Short-range dynamics: how any joint goes on after how it just moved, whatever the motion.

For one joint let ``y_0`` be its angle, ``y_k`` the angle ``l_k`` frames ago and ``f_h`` that ``h`` frames ahead. What
is learned is the second moment matrix ``M`` of the displacements
``z = (y_1 - y_0, ..., y_K - y_0, f_1 - y_0, ..., f_H - y_0)``, one for all joints and all motion. With ``b`` the newest
angle that was seen, ``u`` the displacements from it to the older ones that were seen, and ``g`` those to the future,
the best linear prediction is

    E[g | u] = W^T u,  W = C_uu^-1 C_ug,        Var[g | u] = C_gg - C_gu W,

where every ``C`` is a linear map of ``M`` (``y_k - b = z_k - z_b``). So whatever subset was seen is used exactly: the
weights are those of the subset, not those of the whole with gaps filled.
"""
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from style_core.errors import ModelError, MotionError
from style_core.model_file import load_model, save_model

__all__ = ['FRAME_S', 'LAGS', 'LEADS', 'ShortRange', 'cubic', 'learn_short_range', 'read_short_range']

KIND = 'short-range'
#: One frame of the dynamics, s.
FRAME_S = 1 / 60
#: Angles looked back at, frames ago.
LAGS = (1, 2, 3, 5, 8, 12, 18)
#: Angles predicted, frames ahead.
LEADS = (1, 2, 4, 7, 11, 16, 20, 25, 36, 60)
#: Of an encoder, rad (about 0.06 degrees): keeps weights of differences between near frames finite.
NOISE_STD = 1e-3


@dataclass(frozen=True, eq=False)
class ShortRange:
    """Second moments of displacements.

    Attributes
    ----------
    moments : ndarray, shape (K + H, K + H)
        ``M`` above, rad^2; K = ``len(LAGS)``, H = ``len(LEADS)``.
    usual : ndarray, shape (2, H)
        Of a model on motion that it knows: mean square of its errors, and mean product with those of the short-range
        prediction, as shares of the mean square of the latter. What is believed before anything was measured.
    """

    moments: np.ndarray
    usual: np.ndarray

    def __post_init__(self):
        count = len(LAGS) + len(LEADS)
        if self.moments.shape != (count, count) or self.usual.shape != (2, len(LEADS)):
            raise ModelError(f'short-range dynamics need moments of shape {(count, count)} and usual errors of shape '
                             f'{(2, len(LEADS))}, got {self.moments.shape} and {self.usual.shape}')
        if not (np.isfinite(self.moments).all() and np.isfinite(self.usual).all()):
            raise ModelError('short-range dynamics hold a value that is not finite')

    @cached_property
    def tables(self):
        """Weights and variances for every subset of angles seen.

        Returns
        -------
        weights : ndarray, shape (2^(K+1), H, K + 1)
            Of the angle now and those ``LAGS`` ago, in the prediction of each lead; they add up to one. Bit ``k`` of
            the first index says that angle ``k`` was seen; nothing seen, no weights (zero).
        variance : ndarray, shape (2^(K+1), H)
            Rad^2; infinite where nothing was seen.
        """
        seen, leads = len(LAGS) + 1, len(LEADS)
        # displacements from the angle now, the angle itself (zero) included, with the noise of every reading
        full = np.zeros((seen + leads, seen + leads))
        full[1:, 1:] = self.moments
        full[:seen, :seen] += NOISE_STD ** 2 * np.eye(seen)
        weights = np.zeros((2 ** seen, leads, seen))
        variance = np.full((2 ** seen, leads), np.inf)
        for pattern in range(1, 2 ** seen):
            newest, *older = [k for k in range(seen) if pattern >> k & 1]
            difference = np.eye(seen + leads)
            difference[:, newest] -= 1.0        # everything from the newest angle seen
            moved = difference @ full @ difference.T
            ahead = slice(seen, None)
            gain = np.linalg.solve(moved[np.ix_(older, older)], moved[older, ahead]) if older else np.zeros((0, leads))
            weights[pattern, :, older] = gain
            weights[pattern, :, newest] = 1.0 - gain.sum(axis=0)
            variance[pattern] = np.diag(moved)[ahead] - np.einsum('ah,ah->h', moved[older, ahead], gain)
        return weights, variance

    def save(self, path, training=()):
        """Write a model file (`style_core.model_file.save_model`)."""
        save_model(path, KIND, {'joint_names': ['any'], 'frame_s': FRAME_S, 'lags': list(LAGS), 'leads': list(LEADS),
                                'training': list(training)}, {'moments': self.moments, 'usual': self.usual})


def displacements(y):
    """Displacements ``z`` of recorded angles.

    Parameters
    ----------
    y : ndarray, shape (T, D)
        Rad, a frame every `FRAME_S`.

    Returns
    -------
    ndarray, shape (N, K + H, D)
        At every frame with all of `LAGS` before it and all of `LEADS` after it; rad.
    """
    at = np.arange(LAGS[-1], len(y) - LEADS[-1])[:, None]
    return y[at + np.concatenate([-np.array(LAGS), LEADS])] - y[at]


def learn_short_range(recordings, usual):
    """Learn short-range dynamics.

    Parameters
    ----------
    recordings : iterable of ndarray, each (T, D)
        Rad, 60 frames a second, complete. Every recording counts the same, and so does every joint of it.
    usual : ndarray, shape (2, H)
        See `ShortRange`.

    Raises
    ------
    MotionError
        If no recording is long enough.
    """
    every = []
    for y in recordings:
        z = displacements(np.asarray(y, dtype=float)) if len(y) > LAGS[-1] + LEADS[-1] else np.empty((0, 1, 1))
        if z.size:
            every.append(np.einsum('tad,tbd->ab', z, z) / (len(z) * z.shape[2]))
    if not every:
        raise MotionError(f'short-range dynamics need a recording of more than {LAGS[-1] + LEADS[-1]} frames')
    return ShortRange(np.mean(every, axis=0), np.asarray(usual, dtype=float))


def read_short_range(path=None):
    """Read short-range dynamics; without a path those that come with the package (see `ShortRange` for errors)."""
    return _read(Path(path) if path is not None else Path(__file__).with_name('short_range.npz'))


@cache
def _read(path):
    header, arrays = load_model(path, KIND)
    if tuple(header.get('lags', ())) != LAGS or tuple(header.get('leads', ())) != LEADS:
        raise ModelError(f'{path} was learned for other lags or leads than this version uses')
    return ShortRange(arrays['moments'], arrays['usual'])


def cubic(knots, at):
    """Piecewise cubic interpolation as a linear map of values at knots.

    The cubic Hermite polynomial between two knots, with the slope at a knot that of the parabola through it and its
    neighbours: smooth, and exact for parabolas. Constant beyond the last knot.

    Parameters
    ----------
    knots : ndarray, shape (N,), N >= 4
        Increasing.
    at : ndarray, shape (M,)
        Not before the first knot.

    Returns
    -------
    first : ndarray of int32, shape (M,)
        Of the four knots whose values count.
    weights : ndarray, shape (2, M, 4)
        Of these values in value and slope at ``at``.
    """
    count = len(knots)
    # slopes at the knots as a linear map of the values
    slopes = np.zeros((count, count))
    for k in range(count):
        near = np.clip(np.arange(k - 1, k + 2), 0, count - 1) if 0 < k < count - 1 else \
            np.arange(3) + (0 if k == 0 else count - 3)
        powers = (knots[near] - knots[k])[None] ** np.arange(3)[:, None]
        slopes[k, near] = np.linalg.solve(powers, [0.0, 1.0, 0.0])
    inside = np.clip(at, knots[0], knots[-1])
    low = np.clip(np.searchsorted(knots, inside, side='right') - 1, 0, count - 2)
    width = (knots[low + 1] - knots[low])[:, None]
    s = (inside - knots[low])[:, None] / width
    eye = np.eye(count)
    ends, tangents = (eye[low], eye[low + 1]), (width * slopes[low], width * slopes[low + 1])
    values = ((1 + 2 * s) * (1 - s) ** 2 * ends[0] + s ** 2 * (3 - 2 * s) * ends[1]
              + s * (1 - s) ** 2 * tangents[0] - s ** 2 * (1 - s) * tangents[1])
    rates = (6 * s * (1 - s) * (ends[1] - ends[0]) + (1 - s) * (1 - 3 * s) * tangents[0]
             - s * (2 - 3 * s) * tangents[1]) / width
    rates[at > knots[-1]] = 0.0
    first = np.clip(low - 1, 0, count - 4).astype(np.int32)
    take = first[:, None] + np.arange(4)
    return first, np.ascontiguousarray([np.take_along_axis(part, take, axis=1) for part in (values, rates)])
