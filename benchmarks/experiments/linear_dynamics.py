"""A mixture of linear dynamical systems, by EM: the paper's LGSSM comparison as far as it can be built simply.

Each group c has x_t = H z_t + noise, z_t = A z_(t-1) + noise. Gains are those of the steady state, so that one pass
serves all recordings of any length together; labels are soft.
"""
import numpy as np
from scipy.linalg import solve_discrete_are

_FLOOR = 1e-4


class LinearDynamics:
    """One linear dynamical system with a steady-state Kalman filter and smoother."""

    def __init__(self, x, seen, weights, n_states, rng):
        """Start from the principal directions of the weighted frames, turned a little at random."""
        frames = x.reshape(-1, x.shape[2])
        share = np.sqrt((weights[:, None] * seen).reshape(-1))
        _, _, directions = np.linalg.svd(
            frames * share[:, None] + 1e-9 * rng.normal(size=frames.shape), full_matrices=False
        )
        self.H = directions[:n_states].T + 0.05 * rng.normal(size=(x.shape[2], n_states))
        self.A = 0.95 * np.eye(n_states) + 0.05 * rng.normal(size=(n_states, n_states))
        self.Q, self.R = 0.1 * np.eye(n_states), 0.3 * np.ones(x.shape[2])
        self._gains()

    def _gains(self):
        radius = np.abs(np.linalg.eigvals(self.A)).max()
        if radius > 0.999:
            self.A *= 0.999 / radius
        P = solve_discrete_are(self.A.T, self.H.T, self.Q, np.diag(self.R))
        S = self.H @ P @ self.H.T + np.diag(self.R)
        self.S_inverse = np.linalg.inv(S)
        self.log_det = np.linalg.slogdet(2 * np.pi * S)[1]
        self.K = P @ self.H.T @ self.S_inverse
        self.filtered = P - self.K @ S @ self.K.T
        self.J = self.filtered @ self.A.T @ np.linalg.inv(P)
        smoothed = self.filtered
        for _ in range(100):
            smoothed = self.filtered + self.J @ (smoothed - P) @ self.J.T
        self.smoothed = smoothed

    def filter(self, x, seen):
        """Log likelihood (K,) and filtered means (K, T, n)."""
        K, T, _ = x.shape
        z = np.zeros((K, len(self.A)))
        means, total = np.empty((K, T, len(self.A))), np.zeros(K)
        for t in range(T):
            z = z @ self.A.T
            gap = (x[:, t] - z @ self.H.T) * seen[:, t, None]
            total -= 0.5 * (np.einsum('kf,fg,kg->k', gap, self.S_inverse, gap) + self.log_det * seen[:, t])
            z = z + gap @ self.K.T
            means[:, t] = z
        return total, means

    def update(self, x, seen, weights, means):
        """M-step from smoothed moments; ``weights`` (K,) of the recordings."""
        z = means.copy()
        for t in range(x.shape[1] - 2, -1, -1):
            ahead = seen[:, t + 1, None]
            z[:, t] += ahead * ((z[:, t + 1] - means[:, t] @ self.A.T) @ self.J.T)
        w = weights[:, None] * seen
        pair = w[:, 1:]
        total, pairs = w.sum(), pair.sum()
        if pairs < 2 * len(self.A):
            return
        lagged = self.smoothed @ self.J.T
        now = np.einsum('kt,kti,ktj->ij', pair, z[:, 1:], z[:, 1:]) + pairs * self.smoothed
        before = np.einsum('kt,kti,ktj->ij', pair, z[:, :-1], z[:, :-1]) + pairs * self.smoothed
        cross = np.einsum('kt,kti,ktj->ij', pair, z[:, 1:], z[:, :-1]) + pairs * lagged
        self.A = np.linalg.solve(before + 1e-6 * np.eye(len(before)), cross.T).T
        Q = (now - self.A @ cross.T) / pairs
        self.Q = 0.5 * (Q + Q.T) + _FLOOR * np.eye(len(Q))
        square = np.einsum('kt,kti,ktj->ij', w, z, z) + total * self.smoothed
        mixed = np.einsum('kt,ktf,ktj->fj', w, x, z)
        self.H = np.linalg.solve(square + 1e-6 * np.eye(len(square)), mixed.T).T
        self.R = np.maximum((np.einsum('kt,ktf->f', w, x * x) - (self.H * mixed).sum(axis=1)) / total, 1e-3)
        try:
            self._gains()
        except (np.linalg.LinAlgError, ValueError):     # no steady state: keep the noise generous and go on
            self.Q, self.R = self.Q + 0.1 * np.eye(len(self.Q)), self.R + 0.1
            self._gains()


def cluster(recordings, n_groups, seed, n_states=6, n_iterations=15):
    """Group recordings (each (T_k, F)) by a mixture of linear dynamical systems; returns labels (K,)."""
    rng = np.random.default_rng(seed)
    longest = max(len(x) for x in recordings)
    x = np.zeros((len(recordings), longest, recordings[0].shape[1]))
    seen = np.zeros((len(recordings), longest))
    for k, y in enumerate(recordings):
        x[k, :len(y)], seen[k, :len(y)] = y, 1.0
    labels = rng.dirichlet(np.full(n_groups, 0.5), len(recordings))
    systems = [LinearDynamics(x, seen, labels[:, c], n_states, rng) for c in range(n_groups)]
    weights = np.full(n_groups, 1.0 / n_groups)
    for _ in range(n_iterations):
        found = [system.filter(x, seen) for system in systems]
        score = np.log(weights) + np.stack([total for total, _ in found], axis=1)
        labels = np.exp(score - np.logaddexp.reduce(score, axis=1)[:, None])
        weights = (labels.sum(axis=0) + 0.1) / (len(labels) + 0.1 * n_groups)
        for c, system in enumerate(systems):
            system.update(x, seen, labels[:, c], found[c][1])
    return labels.argmax(axis=1)
