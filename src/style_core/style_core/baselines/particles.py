"""Particle filter on the phase-style model (as Matsubara et al. 2012, section 4.1.2, compare with)."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper

__all__ = ['ParticleFilter']

#: Phases at which the bases are tabulated; a particle uses the nearest, at most 0.35 degrees of the cycle away.
BINS = 512


class ParticleFilter(PoseKeeper):
    """Posterior of phase, phase velocity and style as weighted particles; the proposal is the transition model.

    Phase and velocity move as in the model, the style by a random walk; the pose predicted is the mean over the
    particles. Particles in one phase bin share the bases, so likelihoods and predictions cost J^2 a particle and
    not J D: 10^5 particles take tens of milliseconds a frame where the paper needs 105 s.

    Parameters
    ----------
    behaviour : Behaviour
        Rhythmic.
    n_particles : int
    seed : int
    style_walk : float
        Standard deviation of the random walk of the style a second, in standard deviations of the training styles.
    """

    def __init__(self, behaviour, n_particles=1000, seed=0, style_walk=1.0):
        if not behaviour.rhythmic:
            raise ValueError('the particle filter needs a rhythmic behaviour')
        self._behaviour, self._n, self._seed, self._style_walk = behaviour, int(n_particles), seed, style_walk
        grid = np.arange(BINS) * 2 * np.pi / BINS
        self._bases = np.stack([process.evaluate(grid)[0] for process in behaviour.processes()], axis=1)  # (B, J, D)
        self._precision = 1.0 / behaviour.noise
        self._style_spread = behaviour.styles.std(axis=0)
        super().__init__(behaviour.joint_names, self._bases.mean(axis=0).T @ behaviour.styles.mean(axis=0))

    def reset(self):
        super().reset()
        rng = self._rng = np.random.default_rng(self._seed)
        mean, spread, low, high = self._behaviour.velocity
        self._phase = rng.uniform(0.0, 2 * np.pi, self._n)
        self._velocity = np.clip(mean + spread * rng.normal(size=self._n), low, high)
        pick = rng.integers(len(self._behaviour.styles), size=self._n)
        self._style = self._behaviour.styles[pick] + 0.5 * self._style_spread * rng.normal(
            size=(self._n, self._behaviour.style_dimension)
        )
        self._log_weight = np.zeros(self._n)
        self._weight = np.full(self._n, 1.0 / self._n)

    def _take(self, elapsed, pose, observed):
        rng = self._rng
        if elapsed > 0:
            density = self._behaviour.acceleration
            kick = np.sqrt(density * elapsed) * rng.normal(size=self._n)
            other = np.sqrt(density * elapsed) * rng.normal(size=self._n)
            # exact integral of white acceleration: correlated kicks of phase and velocity
            self._phase += elapsed * (self._velocity + 0.5 * kick + other / np.sqrt(12.0))
            self._velocity = np.clip(self._velocity + kick, *self._behaviour.velocity[2:])
            walk = self._style_walk * np.sqrt(elapsed) * self._style_spread
            self._style += walk * rng.normal(size=self._style.shape)
        if observed.any():
            bases = self._bases[:, :, observed]
            weighted = bases * self._precision[observed]
            gram = np.einsum('bjd,bkd->bjk', weighted, bases)
            cross = weighted @ pose[observed]
            bins = self._bins(self._phase)
            style = self._style
            self._log_weight += np.einsum('kj,kj->k', style, cross[bins]) - 0.5 * np.einsum(
                'kj,kjl,kl->k', style, gram[bins], style, optimize=False
            )
        self._log_weight -= self._log_weight.max()
        weight = np.exp(self._log_weight)
        weight /= weight.sum()
        if 1.0 / np.sum(weight**2) < 0.5 * self._n:
            comb = (np.arange(self._n) + rng.random()) / self._n
            kept = np.minimum(np.searchsorted(np.cumsum(weight), comb), self._n - 1)
            self._phase, self._velocity, self._style = self._phase[kept], self._velocity[kept], self._style[kept]
            self._log_weight = np.zeros(self._n)
            weight = np.full(self._n, 1.0 / self._n)
        self._weight = weight
        self._pose = np.where(observed, pose, self._ahead(np.zeros(1))[0])

    @staticmethod
    def _bins(phase):
        return np.rint(phase * (BINS / (2 * np.pi))).astype(np.int64) % BINS

    def _ahead(self, horizons):
        pose = np.empty((len(horizons), len(self.joint_names)))
        for row, horizon in enumerate(horizons):
            bins = self._bins(self._phase + horizon * self._velocity)
            share = np.stack(
                [np.bincount(bins, self._weight * column, minlength=BINS) for column in self._style.T], axis=1
            )
            pose[row] = np.einsum('bj,bjd->d', share, self._bases)
        return pose
