"""Nearest histories: what training motion did after it last looked like this."""

import numpy as np

from style_core.baselines.pose_keeper import PoseKeeper
from style_core.errors import MotionError
from style_core.histories import AHEAD_S, FRAMES, NEIGHBOURS, HistorySearch, RecentPast, gather

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
        The training's rate, Hz.
    ahead_s : float
        Instants closer than this to the end of their recording are not used, s.

    Raises
    ------
    MotionError
        If joints differ, values are missing, or no recording is long enough.
    """

    def __init__(self, training, neighbours=NEIGHBOURS, frames=FRAMES, rate_hz=60.0, ahead_s=AHEAD_S):
        training = list(training)
        if not training:
            raise MotionError('nearest histories need at least one training recording')
        names = training[0].joint_names
        for motion in training:
            if motion.joint_names != names:
                raise MotionError(f'training recording {motion.name!r} has other joints than {training[0].name!r}')
        histories = gather([(motion.name, motion.positions) for motion in training], names, rate_hz)
        self._search = HistorySearch(histories, neighbours, frames, ahead_s)
        self._past = RecentPast(len(names), frames / rate_hz)
        super().__init__(names, histories.positions.mean(axis=0))

    def reset(self):
        super().reset()
        self._past.reset()

    def _take(self, elapsed, pose, observed):
        self._past.add(self._time, pose, observed)
        self._search.find(self._past)
        self._pose = np.where(observed, pose, self._search.pose())

    def _ahead(self, horizons):
        return self._pose + self._search.displacement(horizons)[0]
