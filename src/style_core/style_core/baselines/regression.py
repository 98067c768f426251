"""Function approximation on line: least squares with forgetting, linear and on radial bases."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from style_core.baselines.pose_keeper import PoseKeeper
from style_core.errors import MotionError

__all__ = ['FadingLeastSquares', 'LinearLeastSquares', 'RadialBasisNetwork']


class FadingLeastSquares:
    """Least squares with a forgetting factor (Haykin 2002) in information form.

    The ridge does not fade with the data, unlike in the covariance recursion, whose matrix grows without bound in
    directions that are not excited (here: most of them, as a cycle visits a thin part of the space).
    """

    def __init__(self, n_features, n_outputs, forgetting, ridge):
        self._forgetting, self._ridge = forgetting, ridge
        self._information = np.zeros((n_features, n_features))
        self._cross = np.zeros((n_features, n_outputs))

    def learn(self, features, outputs):
        """Take observations of one instant: ``features`` (N, F), ``outputs`` (N, O)."""
        self._information *= self._forgetting
        self._information += features.T @ features
        self._cross *= self._forgetting
        self._cross += features.T @ outputs

    def weights(self):
        """Return the weights, shape (F, O)."""
        ridged = self._information.copy()
        ridged[np.diag_indices_from(ridged)] += self._ridge
        return cho_solve(cho_factor(ridged, overwrite_a=True, check_finite=False), self._cross, check_finite=False)


class _Iterated(PoseKeeper):
    """Learns the step from frame to frame and iterates it; hidden joints are held at their last value."""

    def __init__(self, joint_names, rest, n_outputs, rate_hz, forgetting, ridge):
        self._n_outputs, self._rate, self._forgetting, self._ridge = n_outputs, rate_hz, forgetting, ridge
        super().__init__(joint_names, rest)

    def reset(self):
        super().reset()
        self._regression = FadingLeastSquares(self._n_features, self._n_outputs, self._forgetting, self._ridge)
        self._started = False
        self._weights = None

    def _take(self, elapsed, pose, observed):
        before, after = self._reduced(self._pose), self._reduced(pose)
        if self._started:
            self._regression.learn(self._features(before)[None], (after - before)[None])
        self._started, self._pose, self._weights = True, pose, None

    def _ahead(self, horizons):
        if self._weights is None:
            self._weights = self._regression.weights()
        place = np.asarray(horizons) * self._rate
        state = self._reduced(self._pose)
        path = [state]
        for _ in range(int(np.ceil(place.max() - 1e-9)) if len(place) else 0):
            state = state + self._features(state) @ self._weights
            # an unstable linear map grows without bound; past the range of any joint its growth says nothing more
            state = np.clip(state, self._low, self._high)
            path.append(state)
        path = np.array(path + [path[-1]])
        left = np.minimum(np.floor(place + 1e-9).astype(int), len(path) - 2)
        share = np.clip(place - left, 0.0, 1.0)[:, None]
        return self._restored((1.0 - share) * path[left] + share * path[left + 1])


class LinearLeastSquares(_Iterated):
    """Recursive least squares: the next pose as a linear function of this one, iterated over the horizon.

    Parameters
    ----------
    joint_names : sequence of str, length D
    rest : array_like, shape (D,), optional
    rate_hz : float
    forgetting : float
        The paper's 0.95.
    ridge : float
        Pulls the step to zero, in units of squared features.
    """

    def __init__(self, joint_names, rest=None, rate_hz=60.0, forgetting=0.95, ridge=1e-2):
        self._n_features = len(joint_names) + 1
        self._low, self._high = -2.0 * np.pi, 2.0 * np.pi
        super().__init__(joint_names, rest, len(joint_names), rate_hz, forgetting, ridge)

    def _features(self, state):
        return np.append(state, 1.0)

    def _reduced(self, pose):
        return pose

    def _restored(self, path):
        return path


class RadialBasisNetwork(_Iterated):
    """Gaussian radial bases on a grid over the first principal components, weights learned on line (RBFs + PCA).

    Parameters
    ----------
    recordings : sequence of Motion
        Where the principal components and the range of the grid are taken from. The paper takes them from the test
        recording itself.
    components, per_axis : int
        The paper's 3 components and 10 bases an axis.
    rate_hz, forgetting, ridge : float
        As in `LinearLeastSquares`.
    """

    def __init__(self, recordings, components=3, per_axis=10, rate_hz=60.0, forgetting=0.95, ridge=1e-2):
        recordings = list(recordings)
        if not recordings:
            raise MotionError('principal components need at least one recording')
        poses = np.concatenate([motion.positions for motion in recordings])
        if not np.isfinite(poses).all():
            raise MotionError('principal components need recordings without missing values')
        self._centre = poses.mean(axis=0)
        _, _, axes = np.linalg.svd(poses - self._centre, full_matrices=False)
        self._axes = axes[:components]
        reduced = (poses - self._centre) @ self._axes.T
        self._low, self._high = reduced.min(axis=0), reduced.max(axis=0)
        ticks = [np.linspace(low, high, per_axis) for low, high in zip(self._low, self._high)]
        self._grid = np.stack([tick.ravel() for tick in np.meshgrid(*ticks, indexing='ij')], axis=1)
        self._width = (self._high - self._low) / (per_axis - 1)
        self._n_features = len(self._grid)
        super().__init__(recordings[0].joint_names, self._centre, components, rate_hz, forgetting, ridge)

    def _features(self, state):
        return np.exp(-0.5 * (((state - self._grid) / self._width) ** 2).sum(axis=1))

    def _reduced(self, pose):
        return self._axes @ (pose - self._centre)

    def _restored(self, path):
        return self._centre + path @ self._axes
