"""Maximum a posteriori estimators under minimum-entropy and cross-entropy priors (Brand and Hertzmann 2000, C, D)."""
import numpy as np

from style_core.style_machine import _entropic

__all__ = ['gaussian_entropy', 'gaussian_divergence', 'multinomial_entropy', 'multinomial_map', 'specific_map',
           'generic_map']


def _log_det(covs):
    return 2 * np.log(np.einsum('...ii->...i', np.linalg.cholesky(covs))).sum(axis=-1)


def gaussian_entropy(covs):
    """Entropy of Gaussians, eq. 14: covs (..., d, d) -> (...), nats."""
    d = covs.shape[-1]
    return 0.5 * (d * np.log(2 * np.pi * np.e) + _log_det(covs))


def gaussian_divergence(reference_means, reference_covs, means, covs):
    """Cross-entropy D(reference || model) of Gaussians, eq. 15: means (..., d), covs (..., d, d) -> (...), nats."""
    gap = means - reference_means
    inverse = np.linalg.inv(covs)
    return 0.5 * (_log_det(covs) - _log_det(reference_covs) + np.einsum('...ij,...ji->...', inverse, reference_covs)
                  + np.einsum('...i,...ij,...j->...', gap, inverse, gap) - covs.shape[-1])


def multinomial_entropy(rows):
    """Entropy of probability rows, eq. 12: (..., M) -> (...), nats."""
    return -np.where(rows > 0, rows * np.log(np.where(rows > 0, rows, 1.0)), 0.0).sum(axis=-1)


def multinomial_map(counts, z, previous):
    """Probability rows that maximise ``sum(counts log p) - z H(p)``, eqs. 18 and 19.

    With z > 0 (minimum entropy) rare events are driven out; z = 0 is maximum likelihood; z < 0 (annealing)
    evens the probabilities out. Where the paper prints ``Z e^(lambda/Z) - 1`` it means ``Z e^(lambda/Z - 1)``.

    Parameters
    ----------
    counts : ndarray, shape (R, M)
        Non-negative, with reference counts of a cross-entropy prior already added.
    z : float
    previous : ndarray, shape (R, M)
        Kept for rows without any counts.

    Returns
    -------
    ndarray, shape (R, M)
    """
    rows = np.array(previous, dtype=float)
    for count, row in zip(np.ascontiguousarray(counts, dtype=float), rows):
        _entropic.entropic_row(count, float(z), row)
    return rows


def _symmetric(matrices):
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def specific_map(stats, reference_means, reference_covs, strength, floor):
    """Gaussians of a specific model under the cross-entropy prior, eqs. 16 and 17 (their Z is zero here).

    Parameters
    ----------
    stats : Moments
        Of the sequence under its occupancies.
    reference_means, reference_covs : ndarray, shapes (N, d), (N, d, d)
        The generic model.
    strength : float
        Z', in frames; > 0.
    floor : ndarray, shape (d, d)
        Scatter of the sensor resolution, part of the prior: keeps covariances positive definite.

    Returns
    -------
    means : ndarray, shape (N, d)
    covs : ndarray, shape (N, d, d)
    """
    means = (stats.total + strength * reference_means) / (stats.weight + strength)[:, None]
    gap = means - reference_means
    scatter = stats.scatter(means) + strength * (gap[:, :, None] * gap[:, None, :] + reference_covs) + floor
    return means, _symmetric(scatter / (stats.weight + strength)[:, None, None])


def generic_map(stats, z, temperature, pooled_inverse, specific_means, specific_covs, strength, floor, covs):
    """Gaussians of the generic model: all data, minimum entropy, and its own part of the cross-entropies.

    Minimises over (mu, K), for each state, with N the occupancy and S the scatter of all sequences around mu,

        1/2 (N + z - T) log|K| + 1/2 tr K^-1 (S + floor) + T/2 tr(P^-1 K) + Z' sum_s D(N(mu, K) || N(mu_s, K_s))

    first over mu for the K given, then over K. The stationary K solves ``K G K + m K = S + floor`` with
    ``G = Z' sum_s K_s^-1 + T P^-1`` and ``m = N + z - T - n Z'``; its only positive definite root is
    ``K = L^-T (sqrt(m^2/4 I + L^T (S + floor) L) - m/2 I) L^-1`` for ``G = L L^T``.

    Parameters
    ----------
    stats : Moments
        Of all sequences.
    z, temperature : float
        Exponent of the entropy prior and annealing temperature T, in frames.
    pooled_inverse : ndarray, shape (d, d)
        P^-1, of the covariance of all data: what the Gaussians tend to as T grows.
    specific_means, specific_covs : ndarray, shapes (S, N, d), (S, N, d, d)
    strength : float
        Z', frames.
    floor : ndarray, shape (d, d)
    covs : ndarray, shape (N, d, d)
        Current covariances.

    Returns
    -------
    means : ndarray, shape (N, d)
    covs : ndarray, shape (N, d, d)
    """
    precisions = np.linalg.inv(specific_covs)
    pull = strength * precisions.sum(axis=0)
    own = np.linalg.inv(covs)
    left = own * stats.weight[:, None, None] + pull
    right = (np.einsum('nij,nj->ni', own, stats.total)
             + strength * np.einsum('snij,snj->ni', precisions, specific_means))
    means = np.linalg.solve(left, right[..., None])[..., 0]
    scatter = _symmetric(stats.scatter(means)) + floor
    m = stats.weight + z - temperature - len(specific_means) * strength
    lower = np.linalg.cholesky(_symmetric(pull + temperature * pooled_inverse))
    upper = lower.transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(_symmetric(upper @ scatter @ lower))
    values = np.maximum(values, 0.0)
    half = 0.5 * m[:, None]
    root = np.sqrt(half ** 2 + values)
    roots = np.where(half > 0, values / np.where(half > 0, root + half, 1.0), root - half)  # without cancellation
    side = np.linalg.solve(upper, vectors * np.sqrt(roots)[:, None, :])
    return means, _symmetric(side @ side.transpose(0, 2, 1))
