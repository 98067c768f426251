"""Full-covariance Gaussians of many states at once: densities and moments, missing channels marginalised exactly."""
import numpy as np

from style_core.errors import ModelError
from style_core.hmm import _recursions

__all__ = ['log_density', 'moments', 'Moments']

_CHUNK = 512  # frames whitened at a time: 512 x 75 states x 10 dimensions stays in the second-level cache


def _patterns(x):
    """Yield (frames, observed channels) for every distinct pattern of missing values; None for all channels."""
    missing = np.isnan(x)
    damaged = missing.any(axis=1)
    if not damaged.any():
        yield slice(None), None
        return
    if not damaged.all():
        yield np.flatnonzero(~damaged), None
    frames = np.flatnonzero(damaged)
    masks, which = np.unique(missing[frames], axis=0, return_inverse=True)
    which = np.ravel(which)
    for k, mask in enumerate(masks):
        yield frames[which == k], np.flatnonzero(~mask)


def _cholesky(covs):
    try:
        return np.linalg.cholesky(covs)
    except np.linalg.LinAlgError:
        raise ModelError('a covariance of the hidden Markov model is not positive definite') from None


def log_density(x, means, covs):
    """Log density of every frame under every state.

    Parameters
    ----------
    x : ndarray, shape (T, D)
        NaN = missing; the density is then that of the observed channels (0 if none is).
    means : ndarray, shape (N, D)
    covs : ndarray, shape (N, D, D)

    Returns
    -------
    ndarray, shape (T, N)
        Nats.

    Raises
    ------
    ModelError
        If a covariance is not positive definite.
    """
    x = np.ascontiguousarray(x, dtype=float)
    out = np.empty((len(x), len(means)))
    for frames, observed in _patterns(x):
        if observed is None:
            out[frames] = _complete_log_density(x[frames], means, covs)
        elif len(observed):
            rows = np.ix_(frames, observed)
            out[frames] = _complete_log_density(x[rows], means[:, observed],
                                                covs[:, observed[:, None], observed[None, :]])
        else:
            out[frames] = 0.0
    return out


def _complete_log_density(x, means, covs):
    n, d = means.shape
    factor = _cholesky(covs)
    whitener = np.linalg.inv(factor)
    stacked = whitener.reshape(n * d, d).T
    offset = np.einsum('nij,nj->ni', whitener, means)
    constant = -0.5 * d * np.log(2 * np.pi) - np.log(np.einsum('nii->ni', factor)).sum(axis=1)
    out = np.empty((len(x), n))
    for begin in range(0, len(x), _CHUNK):
        _recursions.gaussian_log_density(x[begin:begin + _CHUNK] @ stacked, offset, constant, out[begin:begin + _CHUNK])
    return out


class Moments:
    """Expected occupancy, sum and scatter of the data in each state.

    Attributes
    ----------
    weight : ndarray, shape (N,)
    total : ndarray, shape (N, D)
        Sum of occupancy times data.
    square : ndarray, shape (N, D, D)
        Sum of occupancy times the outer product of the data.
    """

    def __init__(self, weight, total, square):
        self.weight, self.total, self.square = weight, total, square

    def __add__(self, other):
        return Moments(self.weight + other.weight, self.total + other.total, self.square + other.square)

    def scatter(self, means):
        """Scatter matrices around ``means`` (N, D): shape (N, D, D)."""
        cross = self.total[:, :, None] * means[:, None, :]
        return (self.square - cross - cross.transpose(0, 2, 1)
                + self.weight[:, None, None] * means[:, :, None] * means[:, None, :])

    def keep(self, states):
        """The moments of some states only."""
        return Moments(self.weight[states], self.total[states], self.square[states])


def moments(x, gamma, means=None, covs=None):
    """Moments of one sequence under an occupancy matrix.

    Missing channels enter by their expectation and covariance given the observed ones and the state, as EM
    asks for; that needs the current ``means`` and ``covs``.

    Parameters
    ----------
    x : ndarray, shape (T, D)
    gamma : ndarray, shape (T, N)
    means : ndarray, shape (N, D), optional
    covs : ndarray, shape (N, D, D), optional

    Returns
    -------
    Moments

    Raises
    ------
    ModelError
        If values are missing and no current parameters are given.
    """
    n, d = gamma.shape[1], x.shape[1]
    upper = np.triu_indices(d)
    result = Moments(gamma.sum(axis=0), np.zeros((n, d)), np.zeros((n, d, d)))
    for frames, observed in _patterns(x):
        weights, data = gamma[frames], x[frames]
        if observed is None:
            products = data[:, upper[0]] * data[:, upper[1]]
            half = weights.T @ products
            result.square[:, upper[0], upper[1]] += half
            result.square[:, upper[1], upper[0]] += np.where(upper[0] == upper[1], 0.0, half)
            result.total += weights.T @ data
            continue
        if means is None:
            raise ModelError('data with missing values need the current means and covariances')
        hidden = np.setdiff1d(np.arange(d), observed)
        sums = weights.sum(axis=0)
        for i in np.flatnonzero(sums > 1e-12):
            full = np.tile(means[i], (len(data), 1))
            gain = np.linalg.solve(covs[i][np.ix_(observed, observed)], covs[i][np.ix_(observed, hidden)])
            full[:, observed] = data[:, observed]
            full[:, hidden] += (data[:, observed] - means[i, observed]) @ gain
            rest = covs[i][np.ix_(hidden, hidden)] - covs[i][np.ix_(hidden, observed)] @ gain
            result.total[i] += weights[:, i] @ full
            result.square[i] += (full * weights[:, i, None]).T @ full
            result.square[i][np.ix_(hidden, hidden)] += sums[i] * rest
    return result
