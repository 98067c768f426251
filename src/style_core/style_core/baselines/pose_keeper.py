"""What every baseline shares: checks of the input, the last known pose, and an estimate without phase or style."""

import numpy as np

from style_core.errors import MotionError
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
        self.reset()

    def reset(self):
        """Forget everything observed."""
        self._time = None
        self._pose = self._rest.copy()
        self._observed = np.zeros(len(self.joint_names), dtype=bool)

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`)."""
        y = np.asarray(y, dtype=float)
        if y.shape != self._pose.shape:
            raise ValueError(f'{len(self.joint_names)} joint positions are needed, got shape {y.shape}')
        if not np.isfinite(time) or (self._time is not None and time <= self._time):
            raise ValueError(f'time must increase: {time} after {self._time}')
        observed = np.isfinite(y) if mask is None else np.asarray(mask, dtype=bool) & np.isfinite(y)
        if observed.shape != y.shape:
            raise ValueError(f'the mask must have {len(y)} entries, got shape {observed.shape}')
        elapsed = 0.0 if self._time is None else time - self._time
        self._time, self._observed = time, observed
        self._take(elapsed, np.where(observed, y, self._pose), observed)
        mean, std = self._filled(), np.full(len(y), np.nan)
        nothing = np.full((2, 2), np.nan)
        return Estimate(
            time=time,
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
        if self._time is None:
            raise ValueError('nothing was observed yet')
        horizons = np.asarray(horizons, dtype=float)
        mean = self._ahead(horizons)
        if len(horizons) > 1:  # along the path predicted, as a second evaluation would cost as much as the first
            velocity = np.gradient(mean, horizons, axis=0)
        else:
            velocity = (self._ahead(horizons + 1e-3) - mean) / 1e-3
        return Prediction(times=self._time + horizons, mean=mean, std=np.full(mean.shape, np.nan), velocity=velocity)

    def _take(self, elapsed, pose, observed):
        self._pose = pose

    def _filled(self):
        return self._pose.copy()

    def _ahead(self, horizons):
        raise NotImplementedError
