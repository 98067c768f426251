"""One person's departure from a style: a third level below parent and style, and a memory from frame to frame.

The model of the paper ends at the style; what a single recording does differently is white noise to it. Most of that
difference repeats (posture, the swing of an arm) and the rest fades within a few frames. So the residual of a recording
about its style's cycle is written, feature by feature, as

    x_i - z[pi_i] = delta[pi_i] + epsilon_i,
    delta ~ N(0, (pull I + smooth L)^-1) on the ring of positions,
    epsilon: stationary, variance ``noise``, correlation ``memory`` between neighbouring frames.

``delta`` has the cyclic tridiagonal posterior of the latent cycles; frames correlated by rho count (1 - rho) / (1 +
rho) each in it. All missing entries are left out, exactly.
"""
from dataclasses import dataclass

import numpy as np

from style_core.locomotion import kernels
from style_core.locomotion.em import ring_eigenvalues

__all__ = ['Personal', 'Departure', 'residual_sums', 'departure', 'estimate', 'bridge']


@dataclass(frozen=True, eq=False)
class Personal:
    """Hyperparameters of each feature: ``pull``, ``smooth`` (precisions), ``noise`` (variance), ``memory``; all
    (F,)."""

    pull: np.ndarray
    smooth: np.ndarray
    noise: np.ndarray
    memory: np.ndarray

    @property
    def frame_weight(self):
        """Independent frames that one frame is worth, (1 - rho) / (1 + rho); shape (F,)."""
        return (1 - self.memory) / (1 + self.memory)


@dataclass(frozen=True, eq=False)
class Departure:
    """Posterior of delta: mean, variance, covariance with the position before; each (M, F)."""

    mean: np.ndarray
    variance: np.ndarray
    neighbour: np.ndarray


def departure(personal, count, total):
    """Posterior of a recording's departure.

    Parameters
    ----------
    personal : Personal
    count, total : ndarray, shape (M, F)
        Expected number of observed entries at each position, and the sum of their residuals about the style's cycle.

    Returns
    -------
    Departure
    """
    gain = personal.frame_weight / personal.noise
    moments = [np.empty(count.shape) for _ in range(3)]
    kernels.cyclic_chain(np.ascontiguousarray(2 * personal.smooth + personal.pull + count * gain), personal.smooth,
                         np.ascontiguousarray(total * gain), *moments, np.empty(count.shape[1]))
    return Departure(*moments)


def residual_sums(x, mean, occupancy):
    """Expected number of observed entries at each position and the sum of their residuals, each (M, F).

    Parameters
    ----------
    x : ndarray, shape (T, F)
        NaN = missing.
    mean : ndarray, shape (M, F)
        The style's cycle.
    occupancy : ndarray, shape (T, M)
    """
    seen = np.isfinite(x)
    count = occupancy.T @ seen.astype(float)
    return count, occupancy.T @ np.where(seen, x, 0.0) - count * mean


def estimate(recordings, n_iterations=6):
    """Hyperparameters from recordings, by EM.

    Parameters
    ----------
    recordings : sequence of (x, mean, occupancy)
        Frames (T_k, F) with NaN = missing, the cycle of their style (M, F), posterior of the positions (T_k, M).
    n_iterations : int

    Returns
    -------
    Personal
    """
    parts = [(np.isfinite(x), occupancy, *residual_sums(x, mean, occupancy), x - occupancy @ mean)
             for x, mean, occupancy in recordings]
    n_positions, n_features = parts[0][2].shape
    variance = np.maximum(sum(np.nansum(r**2, axis=0) for *_, r in parts)
                          / np.maximum(sum(seen.sum(axis=0) for seen, *_ in parts), 1), 1e-10)
    # to begin with: half the variance to a constant offset, a quarter to the shape, a quarter to the rest.
    # An offset has variance 1 / (pull M); the shape 1 / smooth times the mean inverse eigenvalue, (M^2 - 1) / (12 M)
    personal = Personal(
        2 / (n_positions * variance), n_positions / 3 / variance, variance / 4, np.full(n_features, 0.8)
    )
    eigen, twice = ring_eigenvalues(n_positions)
    ratios = np.geomspace(1e-2, 1e7, 60)
    volume = np.array([(twice * np.log1p(ratio * eigen)).sum() for ratio in ratios])
    for _ in range(n_iterations):
        flat, rough, square, lagged, number, pairs = (np.zeros(n_features) for _ in range(6))
        for seen, occupancy, count, total, about in parts:
            found = departure(personal, count, total)
            flat += (found.mean**2 + found.variance).sum(axis=0)
            rough += ((found.mean - np.roll(found.mean, 1, axis=0))**2
                      + found.variance + np.roll(found.variance, 1, axis=0) - 2 * found.neighbour).sum(axis=0)
            rest = np.where(seen, about - occupancy @ found.mean, 0.0)
            square += (rest**2).sum(axis=0) + (count * found.variance).sum(axis=0)
            lagged += (rest[1:] * rest[:-1]).sum(axis=0)
            number += seen.sum(axis=0)
            pairs += (seen[1:] & seen[:-1]).sum(axis=0)
        # pull and ratio = smooth / pull: the pull is explicit given the ratio, the ratio is found on a grid
        pull = len(parts) * n_positions / (flat + ratios[:, None] * rough)
        best = (volume[:, None] + n_positions * np.log(pull)).argmax(axis=0)
        pull = pull[best, np.arange(n_features)]
        noise = np.maximum(square / np.maximum(number, 1), 1e-10)
        memory = np.clip(lagged / np.maximum(pairs, 1) / noise, 0.0, 0.98)
        personal = Personal(pull, ratios[best] * pull, noise, memory)
    return personal


def bridge(residual, memory):
    """Expected epsilon at every frame from the frames where it was seen.

    A stationary first-order chain depends only on the nearest seen frames before and after; with correlations a and
    b to them, the conditional mean is ``((a - a b^2) left + (b - b a^2) right) / (1 - a^2 b^2)``.

    Parameters
    ----------
    residual : ndarray, shape (T, F)
        NaN = not seen.
    memory : ndarray, shape (F,)

    Returns
    -------
    mean, share : ndarray, shape (T, F)
        The conditional mean, and the share of the stationary variance that remains (0 at a seen frame).
    """
    mean, share = np.zeros_like(residual), np.ones_like(residual)
    frames = np.arange(len(residual))
    for f, rho in enumerate(memory):
        seen = np.flatnonzero(np.isfinite(residual[:, f]))
        if not seen.size:
            continue
        before = np.searchsorted(seen, frames, side='right') - 1
        after = np.minimum(before + 1, len(seen) - 1)
        left, right = seen[np.maximum(before, 0)], seen[after]
        a = np.where(before >= 0, rho**np.abs(frames - left), 0.0)
        b = np.where(right > frames, rho**np.abs(right - frames), 0.0)
        rest = np.maximum(1 - a * a * b * b, 1e-300)
        at_seen = a == 1.0
        mean[:, f] = np.where(at_seen, residual[left, f],
                              ((a - a * b * b) * residual[left, f] + (b - b * a * a) * residual[right, f]) / rest)
        share[:, f] = np.where(at_seen, 0.0, (1 - a * a) * (1 - b * b) / rest)
    return mean, share
