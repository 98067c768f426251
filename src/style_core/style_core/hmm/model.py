"""Hidden Markov models with full-covariance Gaussian states: inference over one or several sequences."""
from dataclasses import dataclass

import numpy as np

from style_core.errors import ModelError
from style_core.hmm import _recursions
from style_core.hmm.gaussian import log_density, moments

__all__ = ['Hmm', 'Occupancy', 'occupancy', 'viterbi', 'filter_step', 'check_hmm', 'em_step']


@dataclass(frozen=True, eq=False)
class Hmm:
    """Parameters of a hidden Markov model.

    Attributes
    ----------
    start : ndarray, shape (N,)
        Probability of beginning in each state.
    trans : ndarray, shape (N, N)
        ``trans[j, i]`` is the probability of going from state j to state i; rows sum to 1.
    means : ndarray, shape (N, D)
    covs : ndarray, shape (N, D, D)
    """

    start: np.ndarray
    trans: np.ndarray
    means: np.ndarray
    covs: np.ndarray

    @property
    def n_states(self):
        return len(self.start)


@dataclass(frozen=True, eq=False)
class Occupancy:
    """What forward-backward says about one sequence.

    Attributes
    ----------
    gamma : ndarray, shape (T, N)
        Probability of each state at each frame given the whole sequence.
    counts : ndarray, shape (N, N)
        Expected number of transitions from j to i.
    log_likelihood : float
        Nats.
    """

    gamma: np.ndarray
    counts: np.ndarray
    log_likelihood: float


def check_hmm(model):
    """Raise ModelError unless shapes fit, probabilities are probabilities and covariances positive definite."""
    n, d = model.means.shape
    if model.start.shape != (n,) or model.trans.shape != (n, n) or model.covs.shape != (n, d, d):
        raise ModelError(f'shapes of a hidden Markov model do not fit: start {model.start.shape}, trans '
                         f'{model.trans.shape}, means {model.means.shape}, covs {model.covs.shape}')
    if not (np.isfinite(model.means).all() and np.isfinite(model.covs).all()):
        raise ModelError('means or covariances of a hidden Markov model are not finite')
    for name, rows in (('start', model.start[None]), ('trans', model.trans)):
        if (rows < 0).any() or not np.allclose(rows.sum(axis=1), 1.0, atol=1e-8):
            raise ModelError(f'{name} probabilities are negative or do not sum to 1')
    log_density(np.zeros((1, d)), model.means, model.covs)
    return model


def _arcs(trans):
    source, target = np.nonzero(trans)
    return np.log(trans[source, target]), source.astype(np.intc), target.astype(np.intc)


def _log(probabilities):
    with np.errstate(divide='ignore'):
        return np.log(probabilities)


def occupancy(log_b, start, trans):
    """Forward-backward over one sequence (Rabiner 1989; Brand and Hertzmann 2000, eqs. 4-7).

    Runs in scaled probabilities; where a path underflows and might have mattered, the sequence is done again in
    logarithms, over the possible transitions only.

    Parameters
    ----------
    log_b : ndarray, shape (T, N)
        Log density of each frame under each state; may be minus infinity.
    start : ndarray, shape (N,)
    trans : ndarray, shape (N, N)

    Returns
    -------
    Occupancy

    Raises
    ------
    ModelError
        If the sequence is empty, or the model cannot produce it.
    """
    log_b = np.ascontiguousarray(log_b, dtype=float)
    start, trans = np.ascontiguousarray(start, dtype=float), np.ascontiguousarray(trans, dtype=float)
    n_frames, n = log_b.shape
    if n_frames == 0:
        raise ModelError('a sequence has no frames')
    if np.isnan(log_b).any():
        raise ModelError('log densities contain NaN')
    alpha, beta, weight = np.empty((3, n_frames, n))
    likelihood, doubtful = _recursions.forward_backward_scaled(
        log_b, start, trans, np.ascontiguousarray(trans.T), alpha, beta, weight)
    if not doubtful:
        beta *= alpha
        return Occupancy(beta, trans * (alpha[:-1].T @ weight[1:]), likelihood)
    gamma, counts = np.zeros((n_frames, n)), np.zeros((n, n))
    likelihood = _recursions.forward_backward_log(log_b, _log(start), *_arcs(trans), gamma, counts)
    if not np.isfinite(likelihood):
        raise ModelError('the model gives the sequence no probability')
    return Occupancy(gamma, counts, likelihood)


def viterbi(log_b, start, trans):
    """Most probable state sequence.

    Parameters
    ----------
    log_b, start, trans : ndarray
        As for `occupancy`.

    Returns
    -------
    path : ndarray of int32, shape (T,)
    log_probability : float
        Of path and data together, nats.
    """
    log_b = np.ascontiguousarray(log_b, dtype=float)
    if len(log_b) == 0:
        raise ModelError('a sequence has no frames')
    path = np.zeros(len(log_b), dtype=np.intc)
    score = _recursions.viterbi_path(log_b, _log(np.asarray(start, dtype=float)),
                                     *_arcs(np.asarray(trans, dtype=float)), path)
    if not np.isfinite(score):
        raise ModelError('the model gives the sequence no probability')
    return path, score


def filter_step(belief, trans, log_b):
    """One step of the filtering distribution.

    Parameters
    ----------
    belief : ndarray, shape (N,)
        Before the step.
    trans : ndarray, shape (N, N)
    log_b : ndarray, shape (N,)

    Returns
    -------
    belief : ndarray, shape (N,)
    log_likelihood : float
        Log probability of the observation given the earlier ones.
    """
    joint = _log(belief @ trans) + log_b
    peak = joint.max()
    if not np.isfinite(peak):
        raise ModelError('the model gives the observation no probability')
    scaled = np.exp(joint - peak)
    total = scaled.sum()
    return scaled / total, peak + np.log(total)


def em_step(model, sequences, floor=1e-6):
    """One iteration of maximum-likelihood EM over several sequences (eqs. 8-10).

    Parameters
    ----------
    model : Hmm
    sequences : list of ndarray, shape (T_k, D)
        NaN = missing.
    floor : float
        Added to the diagonal of every covariance.

    Returns
    -------
    model : Hmm
    log_likelihood : float
        Of the data under the model that was passed in.
    """
    total, counts, first, likelihood = None, 0.0, 0.0, 0.0
    for x in sequences:
        found = occupancy(log_density(x, model.means, model.covs), model.start, model.trans)
        part = moments(x, found.gamma, model.means, model.covs)
        total = part if total is None else total + part
        counts = counts + found.counts
        first = first + found.gamma[0]
        likelihood += found.log_likelihood
    used = total.weight > 1e-10
    weight = np.where(used, total.weight, 1.0)
    means = np.where(used[:, None], total.total / weight[:, None], model.means)
    covs = np.where(used[:, None, None], total.scatter(means) / weight[:, None, None], model.covs)
    covs = 0.5 * (covs + covs.transpose(0, 2, 1))
    covs[used] += floor * np.eye(means.shape[1])
    rows = counts.sum(axis=1, keepdims=True)
    trans = np.where(rows > 0, counts / np.where(rows > 0, rows, 1.0), model.trans)
    return Hmm(first / first.sum(), trans, means, covs), likelihood
