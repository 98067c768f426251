"""Hold still, and keep going (for ever, or for a while)."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper

__all__ = ['ZeroVelocity', 'ConstantVelocity']


class ZeroVelocity(PoseKeeper):
    """Predicts that every joint stays where it was last seen."""

    def _ahead(self, horizons):
        return np.repeat(self._pose[None], len(horizons), axis=0)


class ConstantVelocity(PoseKeeper):
    """Predicts that every joint keeps the velocity it had between its last two observations, or that it fades.

    Parameters
    ----------
    joint_names, rest
        See `PoseKeeper`.
    decay : float
        Rate at which the velocity fades, 1/s, >= 0.
    """

    def __init__(self, joint_names, rest=None, decay=0.0):
        if not (np.isfinite(decay) and decay >= 0):
            raise ValueError(f'decay must be a finite rate of 0 or more, got {decay}')
        self._decay = float(decay)
        super().__init__(joint_names, rest)

    def _span(self, time):
        """Time at full velocity that moves as far as ``time`` at a fading one, s."""
        return time if self._decay == 0 else -np.expm1(-self._decay * time) / self._decay

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
        return self._ahead(np.zeros(1))[0]

    def _ahead(self, horizons):
        unseen = np.where(np.isfinite(self._age), self._age, 0.0)
        return self._pose + self._span(unseen + horizons[:, None]) * self._velocity
