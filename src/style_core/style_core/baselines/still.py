"""Hold still, and keep going."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper

__all__ = ['ZeroVelocity', 'ConstantVelocity']


class ZeroVelocity(PoseKeeper):
    """Predicts that every joint stays where it was last seen."""

    def _ahead(self, horizons):
        return np.repeat(self._pose[None], len(horizons), axis=0)


class ConstantVelocity(PoseKeeper):
    """Predicts that every joint keeps the velocity it had between its last two observations."""

    def reset(self):
        super().reset()
        self._velocity = np.zeros(len(self.joint_names))
        self._age = np.full(len(self.joint_names), np.inf)

    def _take(self, elapsed, pose, observed):
        since = self._age + elapsed
        with np.errstate(invalid='ignore'):
            moved = observed & np.isfinite(since) & (since > 0)
        self._velocity = np.where(moved, (pose - self._pose) / np.where(moved, since, 1.0), self._velocity)
        self._age = np.where(observed, 0.0, since)
        self._pose = pose

    def _filled(self):
        unseen = np.where(np.isfinite(self._age), self._age, 0.0)
        return self._pose + unseen * self._velocity

    def _ahead(self, horizons):
        return self._filled() + horizons[:, None] * self._velocity
