"""Limited commands as a trajectory that keeps the same limits at every moment in between.

Commands C_j come every period h, with steps w_j = C_j - C_{j-1} that obey |w_j| <= V h and |w_j - w_{j-1}| <= A h^2.
A spline through the commands themselves would not obey V and A: between them it has to swing. One through the middles
of the steps does. At the time half-way between two commands let the position be (C_{j-1} + C_j) / 2 and the velocity
w_j / h. From one such knot to the next the mean velocity is

    ((C_j + C_{j+1}) / 2 - (C_{j-1} + C_j) / 2) / h = (w_j + w_{j+1}) / 2 h,

the mean of both ends: a cubic between them is a parabola, with the constant acceleration (w_{j+1} - w_j) / h^2. So
position, velocity and acceleration stay within the limits at every moment, whatever the rate of whoever samples it,
and the curve passes each command within A h^2 / 8.
"""
import math
from collections import deque

import numpy as np

__all__ = ['Foresight', 'knots']

PAST_S = 0.01       # of a plan that is over when it is made


def knots(commands, period):
    """Positions and velocities half-way between commands, without those that lie on one parabola with their neighbours.

    Parameters
    ----------
    commands : ndarray, shape (K + 1, D)
        One a period, rad, at times 0, h, ..., K h; K >= 1. A sequence that is to end at rest ends with two equal ones.
    period : float
        h, s.

    Returns
    -------
    times : ndarray, shape (N,)
        Increasing, s; the first is h / 2, the last (K - 1/2) h.
    positions, velocities : ndarray, shape (N, D)
        Rad, rad/s.
    """
    steps = np.diff(commands, axis=0)
    bends = np.diff(steps, axis=0)
    kept = np.ones(len(steps), dtype=bool)
    # emitted commands are lattice points: equal accelerations are equal to the last bit
    kept[1:-1] = np.any(bends[1:] != bends[:-1], axis=1)
    index = np.flatnonzero(kept)
    return (index + 0.5) * period, commands[index] + 0.5 * steps[index], steps[index] / period


class Foresight:
    """What a limiter has commanded, what it would command next, and both as one trajectory.

    Parameters
    ----------
    limiter : Limiter
    playback : Playback
        Where the limiter's targets come from.
    lead : float
        So long before its time a command is made, s.
    """

    def __init__(self, limiter, playback, lead):
        self._limiter, self._playback, self._lead = limiter, playback, lead
        self._trail = deque(maxlen=math.ceil((lead + PAST_S) / limiter.period) + 2)

    def begin(self):
        """The limiter was reset: the joints have always stood there."""
        self._trail.extend([self._limiter.position.copy()] * self._trail.maxlen)

    def note(self):
        """The limiter has made a command."""
        self._trail.append(self._limiter.position.copy())

    def due(self):
        """The command whose time is now, when the last was made its lead before its own: shape (D,), rad."""
        return self._trail[-1 - round(self._lead / self._limiter.period)]

    def plan(self, time, periods, playing):
        """The trajectory of the commands: the last ones, ``periods`` more, and braking to a stand.

        Parameters
        ----------
        time : float
            Which the last command is for, s on the playback's clock.
        periods : int
            How far to follow what plays.
        playing : bool
            False: brake at once. The plan is as long all the same.

        Returns
        -------
        times, positions, velocities : ndarray
            As from :func:`knots`; times in s on the playback's clock.
        """
        period = self._limiter.period
        times = time + period * np.arange(1, 1 + (periods if playing else 0))
        coming = self._limiter.foresee(*self._playback.preview(times), periods)
        times, positions, velocities = knots(np.vstack([*self._trail, coming]), period)
        return time - (len(self._trail) - 1) * period + times, positions, velocities
