"""What every baseline shares: checks of the input, the last known pose, and an estimate without phase or style."""

import numpy as np

from style_core.errors import MotionError
from style_core.phase_style.observation import ObservationChecker
from style_core.predictor import Estimate, Prediction, Status

__all__ = ['PoseKeeper']


class PoseKeeper:
    """Keeps the last known value of every joint; a joint never seen stands at its rest position.

    Parameters
    ----------
    joint_names : sequence of str, length D
    rest : array_like, shape (D,), optional
        Rad; zero where left out.
    """

    def __init__(self, joint_names, rest=None):
        self.joint_names = tuple(joint_names)
        self._rest = np.zeros(len(self.joint_names)) if rest is None else np.array(rest, dtype=float)
        if self._rest.shape != (len(self.joint_names),) or not np.isfinite(self._rest).all():
            raise MotionError(f'rest pose must be {len(self.joint_names)} finite numbers')
        self._observation = ObservationChecker(len(self.joint_names))
        self.reset()

    def reset(self):
        """Forget everything observed."""
        self._observation.reset()
        self._pose = self._rest.copy()
        self._observed = np.zeros(len(self.joint_names), dtype=bool)

    @property
    def _time(self):
        return self._observation.time

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`)."""
        elapsed = self._observation.check(time, y, mask)
        y, observed = self._observation.y, self._observation.flags()
        self._observed = observed
        self._take(elapsed, np.where(observed, y, self._pose), observed)
        mean, std = self._filled(), np.full(len(y), np.nan)
        nothing = np.full((2, 2), np.nan)
        return Estimate(
            time=self._time,
            phase=np.nan,
            phase_velocity=np.nan,
            phase_covariance=nothing,
            style=np.empty(0),
            style_covariance=np.empty((0, 0)),
            mean=mean,
            std=std,
            observed=observed,
            innovation=np.nan,
            log_likelihood=np.nan,
            status=Status.TRACKING,
        )

    def predict(self, horizons):
        """Predict ``horizons`` s ahead (see `OnlinePredictor.predict`); baselines give no band (``std`` is NaN)."""
        horizons = np.asarray(horizons, dtype=float)
        if horizons.ndim != 1 or not (np.isfinite(horizons).all() and (horizons >= 0).all()):
            raise ValueError('horizons must be a one-dimensional array of finite times >= 0')
        mean = self._ahead(horizons)
        # along the path predicted, as a second evaluation would cost as much as the first
        if len(horizons) > 1 and (np.diff(horizons) > 0).all():
            velocity = np.gradient(mean, horizons, axis=0)
        else:
            velocity = (self._ahead(horizons + 1e-3) - mean) / 1e-3
        nothing = np.full(mean.shape, np.nan)
        return Prediction((self._time or 0.0) + horizons, mean, nothing, velocity)

    def _take(self, elapsed, pose, observed):
        self._pose = pose

    def _filled(self):
        return self._pose.copy()

    def _ahead(self, horizons):
        raise NotImplementedError
