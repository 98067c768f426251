"""Nearest histories: what training motion did after it last looked like this."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper
from style_core.errors import MotionError

__all__ = ['NearestHistories']


class NearestHistories(PoseKeeper):
    """Mean displacement of the ``neighbours`` training instants whose last ``frames`` frames looked most alike.

    A joint hidden at the moment gets the neighbours' own positions instead of a displacement.

    Parameters
    ----------
    training : sequence of Motion
        All with the same joints, at ``rate_hz``, without missing values.
    neighbours, frames : int
    rate_hz : float
        The rate the observations will come at, Hz.
    ahead_s : float
        Instants closer than this to the end of their recording are not used, s.

    Raises
    ------
    MotionError
        If joints differ, values are missing, or no recording is long enough.
    """

    def __init__(self, training, neighbours=5, frames=10, rate_hz=60.0, ahead_s=25 / 60):
        training = list(training)
        if not training:
            raise MotionError('nearest histories need at least one training recording')
        names = training[0].joint_names
        for motion in training:
            if motion.joint_names != names:
                raise MotionError(f'training recording {motion.name!r} has other joints than {training[0].name!r}')
            if not np.isfinite(motion.positions).all():
                raise MotionError(f'training recording {motion.name!r} has missing values')
        self._bank = np.concatenate([motion.positions for motion in training])
        self._half_norm = 0.5 * np.einsum('td,td->t', self._bank, self._bank)
        self._rate = float(rate_hz)
        self._frames = int(frames)
        length = np.array([motion.n_frames for motion in training])
        start = np.repeat(np.cumsum(length) - length, length)
        self._stop = start + np.repeat(length, length)
        index = np.arange(len(self._bank))
        far = int(np.ceil(ahead_s * rate_hz - 1e-9))
        self._usable = np.flatnonzero((index - start >= self._frames - 1) & (index + far < self._stop))
        if len(self._usable) < neighbours:
            raise MotionError(
                f'training recordings are too short for histories of {frames} frames and {ahead_s:g} s ahead'
            )
        self._neighbours = int(neighbours)
        super().__init__(names, self._bank.mean(axis=0))

    def reset(self):
        super().reset()
        self._distance = np.zeros((self._frames, len(self._bank)))  # of the last frames, newest first
        self._found = self._usable[: self._neighbours]

    def _take(self, elapsed, pose, observed):
        if observed.all():
            new = self._half_norm - self._bank @ pose
        else:
            seen = self._bank[:, observed]
            new = 0.5 * np.einsum('td,td->t', seen, seen) - seen @ pose[observed]
        self._distance = np.roll(self._distance, 1, axis=0)
        self._distance[0] = new
        total = np.zeros(len(self._usable))
        for age in range(self._frames):  # constants a frame are the same for every candidate and do not matter
            total += self._distance[age, self._usable - age]
        nearest = np.argpartition(total, self._neighbours - 1)[: self._neighbours]
        self._found = self._usable[np.sort(nearest)]
        self._pose = np.where(observed, pose, self._bank[self._found].mean(axis=0))

    def _ahead(self, horizons):
        place = self._found[:, None] + horizons[None] * self._rate
        place = np.minimum(place, self._stop[self._found][:, None] - 1)
        left = np.minimum(np.floor(place + 1e-9).astype(int), self._stop[self._found][:, None] - 1)
        right = np.minimum(left + 1, self._stop[self._found][:, None] - 1)
        share = np.clip(place - left, 0.0, 1.0)[..., None]
        then = (1.0 - share) * self._bank[left] + share * self._bank[right]
        moved = then - self._bank[self._found][:, None]
        return self._pose + moved.mean(axis=0)
