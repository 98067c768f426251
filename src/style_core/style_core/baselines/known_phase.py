"""An ideal that is told the phase: what remains is the error of bases and style."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper
from style_core.baselines.regression import FadingLeastSquares
from style_core.phase_style.basis_table import Table, tabulate

__all__ = ['KnownPhase']


class KnownPhase(PoseKeeper):
    """Knows the phase of every instant, past and future; learns the style on line as the paper does.

    Parameters
    ----------
    behaviour : Behaviour
        Rhythmic.
    times, phases : ndarray, shape (T,)
        The phase track, unwrapped, rad; past its ends it goes on at its mean velocity.
    forgetting : float
        Lambda of the on-line M-step (eq. A.10-A.13) a frame.
    """

    def __init__(self, behaviour, times, phases, forgetting=0.8):
        self._behaviour, self._forgetting = behaviour, forgetting
        self._table = Table(tabulate(behaviour.processes(), behaviour.rhythmic))
        self._times, self._phases = np.asarray(times, dtype=float), np.asarray(phases, dtype=float)
        super().__init__(behaviour.joint_names, None)

    def reset(self):
        super().reset()
        self._style = self._behaviour.styles.mean(axis=0)
        # a weak pull to nothing, so that the first frame has a solution; of no weight against a single pose
        self._regression = FadingLeastSquares(self._behaviour.style_dimension, 1, self._forgetting, 1e-9)

    def _bases_at(self, times):
        track, start, end = self._phases, self._times[0], self._times[-1]
        mean_velocity = (track[-1] - track[0]) / (end - start)
        phase = np.interp(times, self._times, track)
        phase = phase + mean_velocity * (np.maximum(times - end, 0.0) + np.minimum(times - start, 0.0))
        return np.stack([self._table.evaluate(at)[0] for at in phase])  # (N, J, D)

    def _take(self, elapsed, pose, observed):
        features = self._bases_at(np.array([self._time]))[0]
        if observed.any():
            self._regression.learn(features[:, observed].T, pose[observed][:, None])
        self._style = self._regression.weights()[:, 0]
        self._pose = np.where(observed, pose, self._style @ features)

    def _ahead(self, horizons):
        return np.einsum('j,hjd->hd', self._style, self._bases_at((self._time or 0.0) + horizons))
