"""Gaussian processes over phase: one a basis, hyperparameters by marginal likelihood (Matsubara et al. 2012)."""
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

__all__ = ['PhaseProcess', 'embed', 'fit_process', 'negative_log_marginal']


def embed(phase, rhythmic):
    """Eq. (4): ``z = [cos, sin]`` of a rhythmic phase, the phase itself for discrete motion; shape (N, 1 or 2)."""
    phase = np.asarray(phase, dtype=float)
    if rhythmic:
        return np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return phase[..., None]


def _squared_distance(a, b):
    return np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=-1)


@dataclass(frozen=True, eq=False)
class PhaseProcess:
    """Posterior of one basis, eqs. (7)-(10).

    Attributes
    ----------
    phase : ndarray, shape (C,)
        Training phases.
    outputs : ndarray, shape (C, D)
    beta : ndarray, shape (3,)
        Signal variance, inverse squared length, noise precision.
    rhythmic : bool
    """

    phase: np.ndarray
    outputs: np.ndarray
    beta: np.ndarray
    rhythmic: bool

    def _solve(self):
        z = embed(self.phase, self.rhythmic)
        gram = self.beta[0] * np.exp(-0.5 * self.beta[1] * _squared_distance(z, z))
        gram[np.diag_indices_from(gram)] += 1 / self.beta[2]
        return z, cho_factor(gram, lower=True)

    def evaluate(self, phase):
        """Posterior mean (N, D), its derivative by phase (N, D) and the variance shared by all channels (N,)."""
        z, factor = self._solve()
        at = embed(phase, self.rhythmic)
        cross = self.beta[0] * np.exp(-0.5 * self.beta[1] * _squared_distance(at, z))
        if self.rhythmic:
            tangent = np.stack([-np.sin(phase), np.cos(phase)], axis=-1)
        else:
            tangent = np.ones_like(at)
        slope = -self.beta[1] * np.einsum('nk,nck->nc', tangent, at[:, None, :] - z[None, :, :]) * cross
        weights = cho_solve(factor, self.outputs)
        variance = self.beta[0] - np.einsum('nc,cn->n', cross, cho_solve(factor, cross.T))
        return cross @ weights, slope @ weights, np.maximum(variance, 0.0)


def negative_log_marginal(log_beta, squared_distance, scatter, channels):
    """Negative log marginal likelihood of a basis and its gradient by the logarithms of the hyperparameters.

    Parameters
    ----------
    log_beta : ndarray, shape (3,)
    squared_distance : ndarray, shape (C, C)
        Between the embedded phases.
    scatter : ndarray, shape (C, C)
        ``outputs @ outputs.T``.
    channels : int
        D, the number of outputs that share the kernel.
    """
    signal, inverse_length, precision = np.exp(log_beta)
    count = len(squared_distance)
    smooth = signal * np.exp(-0.5 * inverse_length * squared_distance)
    gram = smooth.copy()
    gram[np.diag_indices(count)] += 1 / precision
    try:
        factor = cho_factor(gram, lower=True)
    except np.linalg.LinAlgError:
        return 1e25, np.zeros(3)
    inverse = cho_solve(factor, np.eye(count))
    half_log_determinant = np.sum(np.log(np.diag(factor[0])))
    value = channels * (half_log_determinant + 0.5 * count * np.log(2 * np.pi)) + 0.5 * np.sum(inverse * scatter)
    # d value / d gram = (D K^-1 - K^-1 S K^-1) / 2
    sensitivity = 0.5 * (channels * inverse - inverse @ scatter @ inverse)
    gradient = np.array([
        np.sum(sensitivity * smooth),
        np.sum(sensitivity * smooth * (-0.5 * inverse_length * squared_distance)),
        -np.trace(sensitivity) / precision])
    return value, gradient


def fit_process(phase, outputs, rhythmic):
    """Learn one basis: maximise the marginal likelihood of eq. (7).

    Parameters
    ----------
    phase : ndarray, shape (C,)
    outputs : ndarray, shape (C, D)
    rhythmic : bool

    Returns
    -------
    PhaseProcess
    """
    from scipy.optimize import minimize  # as in `learning`
    z = embed(phase, rhythmic)
    distance = _squared_distance(z, z)
    scale = max(float(np.mean(outputs ** 2)), 1e-12)
    scatter = outputs @ outputs.T / scale
    span = 2 * np.pi if rhythmic else 1.0
    start = np.log([1.0, (6 / span) ** 2 * (1.0 if rhythmic else 4.0), 1e3])
    bounds = [(np.log(1e-4), np.log(1e5)), (np.log(0.01 / span ** 2), np.log(4e4 / span ** 2)),
              (np.log(1.0), np.log(1e7))]
    found = minimize(negative_log_marginal, start, args=(distance, scatter, outputs.shape[1]), jac=True,
                     method='L-BFGS-B', bounds=bounds, options={'maxiter': 60})
    beta = np.exp(found.x) * [scale, 1.0, 1 / scale]
    return PhaseProcess(np.array(phase, dtype=float), np.array(outputs, dtype=float), beta, rhythmic)
