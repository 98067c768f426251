"""Variational expectation-maximisation of the locomotion model, on plain arrays.

The model (Pan and Torresani 2009, section 2; docs/locomotion.md derives every line below): K recordings of F features,
C styles, and for each style a latent cycle of M positions that all recordings of that style repeat.

- latent cycle c, feature f: ``z ~ N(m0_f, A^-1)``, ``A = coupling I + smoothing L``, ``m0 = coupling A^-1 parent``,
  with L the Laplacian of the ring of M positions. (The normalised form of the product of a chain and a pull to the
  parent.)
- recording k: label ``l ~ weights``; position ``pi_1`` uniform, then advancing by 1 .. J with probabilities
  ``jumps[k]``; ``x_i ~ N(z^l[pi_i], 1 / precision[l])``, feature by feature, so that a missing entry is marginalised by
  leaving it out.

Mean field ``Q = prod_k Q(path k) Q(label k) prod_c Q(cycle c)``. Every ``update_*`` function raises `bound` or leaves
it.
"""
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np
from scipy.optimize import brentq

from style_core.locomotion import kernels

__all__ = ['Data', 'Settings', 'Parameters', 'CycleMoments', 'PathMoments', 'Posterior', 'prepare', 'update_paths',
           'update_cycles', 'update_labels', 'update_parameters', 'expected_log_likelihood', 'bound']

_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class Data:
    """Recordings, centred and scaled by the caller to about unit variance.

    Attributes
    ----------
    values : tuple of ndarray, shape (T_k, F)
        Missing entries hold 0.
    seen : tuple of ndarray, shape (T_k, F), or None
        1 where observed; None for a complete recording.
    """

    values: Tuple[np.ndarray, ...]
    seen: Tuple[Optional[np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class Settings:
    """Sizes and fixed hyperparameters, in units of the scaled data.

    Attributes
    ----------
    n_styles, n_positions, max_jump : int
        C, M and J.
    parent_smoothness : float
        eta of the parent's improper prior: ``-eta sum_m |parent_m - parent_(m-1)|^2``.
    label_pseudo, jump_pseudo : float
        Pseudo-counts of the Dirichlet penalties, ``eta sum log``.
    precision_pseudo : float
        Frames of unit variance added to each style and feature: a style without recordings keeps a valid precision.
    precision_max : ndarray, shape (F,)
        Upper limit of the precisions: the noise floor of the sensors. Without it a constant channel has no maximum.
    learn_coupling : bool
        Learn the pull towards the parent too; the smoothing is always learned.
    """

    n_styles: int
    n_positions: int
    max_jump: int
    precision_max: np.ndarray
    parent_smoothness: float = 0.1
    label_pseudo: float = 0.1
    jump_pseudo: float = 0.1
    precision_pseudo: float = 1.0
    learn_coupling: bool = False


@dataclass(frozen=True, eq=False)
class Parameters:
    """What the M-step estimates: parent (M, F), coupling and smoothing > 0, precision (C, F), weights (C,), jumps
    (K, J)."""

    parent: np.ndarray
    coupling: float
    smoothing: float
    precision: np.ndarray
    weights: np.ndarray
    jumps: np.ndarray


@dataclass(frozen=True, eq=False)
class CycleMoments:
    """Q(cycles): mean, variance and covariance of m with m - 1, each (C, M, F); log determinant of the precision (C,
    F)."""

    mean: np.ndarray
    variance: np.ndarray
    neighbour: np.ndarray
    log_det: np.ndarray


@dataclass(frozen=True, eq=False)
class PathMoments:
    """What the rest needs of Q(paths).

    Attributes
    ----------
    count : ndarray, shape (K, M, F)
        Expected number of observed entries at each position.
    total : ndarray, shape (K, M, F)
        Expected sum of the observations there.
    visits : ndarray, shape (K, M)
        Expected number of frames there, observed or not.
    jumps : ndarray, shape (K, J)
        Expected number of advances by 1 .. J.
    entropy : ndarray, shape (K,)
    """

    count: np.ndarray
    total: np.ndarray
    visits: np.ndarray
    jumps: np.ndarray
    entropy: np.ndarray


@dataclass(frozen=True, eq=False)
class Posterior:
    """The three factors: labels (K, C), cycles, paths (None before the first update)."""

    labels: np.ndarray
    cycles: CycleMoments
    paths: Optional[PathMoments] = None


def prepare(recordings):
    """Split recordings (sequence of (T_k, F), NaN = missing) into values and masks."""
    values, seen = [], []
    for x in recordings:
        mask = np.isfinite(x)
        complete = bool(mask.all())
        values.append(np.ascontiguousarray(x if complete else np.where(mask, x, 0.0)))
        seen.append(None if complete else mask.astype(float))
    return Data(tuple(values), tuple(seen))


def ring_eigenvalues(n):
    """Eigenvalues of the ring Laplacian L, in the order of `numpy.fft.rfft`, and how often each stands in the full
    set."""
    k = np.arange(n // 2 + 1)
    twice = np.where((k == 0) | (2 * k == n), 1.0, 2.0)
    return 2.0 - 2.0 * np.cos(2 * np.pi * k / n), twice


def prior_mean(parent, coupling, smoothing):
    """``m0 = coupling A^-1 parent`` (M, F), by the Fourier transform that diagonalises A."""
    eigen, _ = ring_eigenvalues(len(parent))
    gain = coupling / (coupling + smoothing * eigen)
    return np.fft.irfft(gain[:, None] * np.fft.rfft(parent, axis=0), len(parent), axis=0)


def emission(x, seen, precision, mean, variance, labels):
    """Expected log likelihood of each frame at each position under Q(label) Q(cycles) (Pan and Torresani eq. 10).

    Parameters
    ----------
    x, seen : (T, F), or None for a complete ``seen``
    precision : (C, F)
    mean, variance : (C, M, F)
    labels : (C,)

    Returns
    -------
    ndarray, shape (T, M)
        Without the terms that are the same at every position.
    """
    weighted = labels[:, None] * precision
    linear = np.einsum('cf,cmf->mf', weighted, mean)
    square = np.einsum('cf,cmf->mf', weighted, mean * mean + variance)
    out = x @ linear.T
    out -= 0.5 * (square.sum(axis=1) if seen is None else seen @ square.T)
    return out


def update_paths(data, parameters, posterior, threads=1):
    """Q(paths) by forward-backward with the expected emissions (eq. 7, 10), one recording after another or in
    threads."""
    n_positions, n_features = parameters.parent.shape
    n_jumps = parameters.jumps.shape[1]

    def one(k):
        x, seen = data.values[k], data.seen[k]
        scores = emission(x, seen, parameters.precision, posterior.cycles.mean, posterior.cycles.variance,
                          posterior.labels[k])
        occupancy, moves = np.empty_like(scores), np.empty(n_jumps)
        log_jump = np.log(parameters.jumps[k])
        evidence, fit = kernels.forward_backward(scores, log_jump, occupancy, moves)
        visits = occupancy.sum(axis=0)
        count = np.broadcast_to(visits[:, None], (n_positions, n_features)) if seen is None else occupancy.T @ seen
        entropy = evidence + np.log(n_positions) - moves @ log_jump - fit
        return count, occupancy.T @ x, visits, moves, entropy

    indices = range(len(data.values))
    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(one, indices))
    else:
        parts = [one(k) for k in indices]
    return replace(posterior, paths=PathMoments(*(np.stack(part) for part in zip(*parts))))


def update_cycles(parameters, posterior):
    """Q(cycles): a cyclic tridiagonal Gaussian a style and feature (eq. 9, with the inverse of S where it belongs)."""
    precision, paths = parameters.precision, posterior.paths
    n_styles, n_features = precision.shape
    n_positions = len(parameters.parent)
    count = np.tensordot(paths.count, posterior.labels, (0, 0))              # (M, F, C)
    total = np.tensordot(paths.total, posterior.labels, (0, 0))
    gain = precision.T
    diagonal = 2 * parameters.smoothing + parameters.coupling + count * gain
    potential = parameters.coupling * parameters.parent[:, :, None] + total * gain
    size = n_features * n_styles
    mean, variance, neighbour = (np.empty((n_positions, size)) for _ in range(3))
    log_det = np.empty(size)
    kernels.cyclic_chain(diagonal.reshape(n_positions, size), np.full(size, float(parameters.smoothing)),
                         potential.reshape(n_positions, size), mean, variance, neighbour, log_det)

    def by_style(array):
        return np.ascontiguousarray(array.reshape(n_positions, n_features, n_styles).transpose(2, 0, 1))

    moments = CycleMoments(by_style(mean), by_style(variance), by_style(neighbour),
                           np.ascontiguousarray(log_det.reshape(n_features, n_styles).T))
    return replace(posterior, cycles=moments)


def _squares(data):
    """Sum of squares and number of the observed entries, each (K, F)."""
    square = np.stack([(x * x).sum(axis=0) for x in data.values])
    number = np.stack([np.full(x.shape[1], float(len(x))) if seen is None else seen.sum(axis=0)
                       for x, seen in zip(data.values, data.seen)])
    return square, number


def _expected_squares(data, posterior):
    """Expected squared distance of each recording's entries to each style's cycle (K, C, F), and their number (K,
    F)."""
    square, number = _squares(data)
    cycles, paths = posterior.cycles, posterior.paths
    cross = np.einsum('kmf,cmf->kcf', paths.total, cycles.mean)
    spread = np.einsum('kmf,cmf->kcf', paths.count, cycles.mean**2 + cycles.variance)
    return square[:, None, :] - 2 * cross + spread, number


def expected_log_likelihood(data, parameters, posterior):
    """E log p(x_k | path, label c, cycles) under Q(paths) Q(cycles), shape (K, C), with every constant."""
    distance, number = _expected_squares(data, posterior)
    precision = parameters.precision
    return 0.5 * (number @ (np.log(precision) - _LOG_2PI).T - np.einsum('kcf,cf->kc', distance, precision))


def update_labels(data, parameters, posterior):
    """Q(labels) (eq. 11)."""
    score = np.log(parameters.weights) + expected_log_likelihood(data, parameters, posterior)
    score -= score.max(axis=1, keepdims=True)
    labels = np.exp(score)
    return replace(posterior, labels=labels / labels.sum(axis=1, keepdims=True))


def _prior_statistics(parameters, posterior):
    """Of Q(cycles), summed over styles and features: E|z_m - z_(m-1)|^2, E|z|^2, mean . parent, and the parent's
    power."""
    cycles, parent = posterior.cycles, parameters.parent
    before = np.roll(cycles.mean, 1, axis=1)
    rough = ((cycles.mean - before)**2).sum() + 2 * (cycles.variance - cycles.neighbour).sum()
    size = (cycles.mean**2 + cycles.variance).sum()
    cross = (cycles.mean.sum(axis=0) * parent).sum()
    power = (np.abs(np.fft.rfft(parent, axis=0))**2).sum(axis=1) / len(parent)
    return rough, size, cross, power


def _log_prior(statistics, n_cycles, n_styles, coupling, smoothing, n_positions):
    """E log p(cycles | parent) without - M/2 log 2 pi; n_cycles = C F. Jointly concave in coupling and smoothing."""
    rough, size, cross, power = statistics
    eigen, twice = ring_eigenvalues(n_positions)
    own = coupling + smoothing * eigen
    return (0.5 * n_cycles * (twice * np.log(own)).sum()
            - 0.5 * (smoothing * rough + coupling * size - 2 * coupling * cross
                     + n_styles * (twice * power * coupling**2 / own).sum()))


def _update_prior(parameters, posterior, settings):
    """Parent, smoothing and coupling: each the exact maximiser given the others.

    Pan and Torresani's (12, 13) treat the chain and the pull as if each had a normaliser of its own; the product has
    one, log|A|, and its maximiser is the root of a decreasing function.
    """
    mean = posterior.cycles.mean
    n_styles, n_positions, n_features = mean.shape
    eigen, twice = ring_eigenvalues(n_positions)
    coupling, smoothing = parameters.coupling, parameters.smoothing
    n_cycles = n_styles * n_features

    weight = n_styles * coupling**2 / (coupling + smoothing * eigen) + 2 * settings.parent_smoothness * eigen
    parent = np.fft.irfft(coupling * np.fft.rfft(mean.sum(axis=0), axis=0) / weight[:, None], n_positions, axis=0)
    rough, size, cross, power = _prior_statistics(replace(parameters, parent=parent), posterior)

    def along_smoothing(log_value):
        own = coupling + np.exp(log_value) * eigen
        return (n_cycles * (twice * eigen / own).sum() - rough
                + n_styles * (twice * power * coupling**2 * eigen / own**2).sum())

    def along_coupling(log_value):
        value = np.exp(log_value)
        own = value + smoothing * eigen
        slope = (value**2 + 2 * value * smoothing * eigen) / own**2
        return n_cycles * (twice / own).sum() - size + 2 * cross - n_styles * (twice * power * slope).sum()

    smoothing = _root(along_smoothing)
    if settings.learn_coupling:
        coupling = _root(along_coupling)
    return parent, coupling, smoothing


def _root(slope, low=1e-6, high=1e8):
    """Maximiser in [low, high] of a concave function, from its slope against the logarithm of its argument."""
    if slope(np.log(low)) <= 0:
        return low
    if slope(np.log(high)) >= 0:
        return high
    return float(np.exp(brentq(slope, np.log(low), np.log(high), xtol=1e-10)))


def update_parameters(data, parameters, posterior, settings):
    """The M-step (eq. 12-17): each parameter at the maximum of the bound given the posterior."""
    distance, number = _expected_squares(data, posterior)
    labels = posterior.labels
    frames = labels.T @ number + settings.precision_pseudo
    misfit = np.einsum('kc,kcf->cf', labels, distance) + settings.precision_pseudo
    precision = np.minimum(frames / misfit, settings.precision_max)
    weights = labels.sum(axis=0) + settings.label_pseudo
    jumps = posterior.paths.jumps + settings.jump_pseudo
    parent, coupling, smoothing = _update_prior(parameters, posterior, settings)
    return Parameters(parent, coupling, smoothing, precision, weights / weights.sum(),
                      jumps / jumps.sum(axis=1, keepdims=True))


def bound(data, parameters, posterior, settings):
    """Lower bound of the penalised log likelihood (eq. 3), every term exact; what all updates raise."""
    labels, paths, cycles = posterior.labels, posterior.paths, posterior.cycles
    n_styles, n_positions, n_features = cycles.mean.shape
    expected = expected_log_likelihood(data, parameters, posterior)
    with np.errstate(divide='ignore', invalid='ignore'):
        entropy = np.where(labels > 0, labels * np.log(labels), 0.0)
    recordings = ((labels * (np.log(parameters.weights) + expected)).sum() - entropy.sum()
                  + (paths.jumps * np.log(parameters.jumps)).sum() + paths.entropy.sum()
                  - len(labels) * np.log(n_positions))
    prior = _log_prior(_prior_statistics(parameters, posterior), n_styles * n_features, n_styles,
                       parameters.coupling, parameters.smoothing, n_positions)
    cycle_entropy = 0.5 * (n_styles * n_features * n_positions - cycles.log_det.sum())
    step = parameters.parent - np.roll(parameters.parent, 1, axis=0)
    penalty = (-settings.parent_smoothness * (step**2).sum()
               + settings.label_pseudo * np.log(parameters.weights).sum()
               + settings.jump_pseudo * np.log(parameters.jumps).sum()
               + 0.5 * settings.precision_pseudo * (np.log(parameters.precision) - parameters.precision).sum())
    return float(recordings + prior + cycle_entropy + penalty)
