"""How wide bands must be: calibration by horizon, by time in the dark, and by the person who is followed.

The filter's variances are those of people in general. Some move more regularly than others, and a band that is right
on average is too wide for the one and too narrow for the other. So predictions are checked when their time has
come, and the standard deviation follows what was found, starting from what is usual.
"""
import math

import numpy as np

__all__ = ['LEAD_S', 'Bands', 'Level', 'check']

#: A prediction this far ahead is kept and checked when its time has come, s; then the next one is kept.
LEAD_S = 5 / 60
#: A check counts at least a fifth and at most five times what is usual.
MOST = 5.0
#: Checks are forgotten at this time constant, s: longer than one action, shorter than a change of shoes.
MEMORY_S = 10.0
#: A joint this long in the dark is on its way back to the band of people in general, s: twice the longest horizon.
FAR_S = 50 / 60


def check(error, std):
    """Mean square of errors in units of the predicted standard deviation."""
    ratio = error / std
    return float(np.dot(ratio, ratio)) / len(ratio)


class Level:
    """Variance of somebody's errors relative to what is usual: a mean of checks that starts at one.

    After checks ``x_1 ... x_n`` (mean squared errors in predicted units) it is
    ``(w + sum_i min(max(x_i / m, 1/5), 5)) / (w + n)``, old checks fading.

    Parameters
    ----------
    median : float
        Usual check ``m``.
    weight : float
        Checks ``w`` that the start is worth.
    """

    def __init__(self, median, weight):
        self._median, self._weight = median, weight
        self.reset()

    def reset(self):
        """Back to what is usual."""
        self._sum = self._count = 0.0

    def add(self, value, share=1.0, elapsed=LEAD_S):
        """Take a check of a ``share`` of the joints, ``elapsed`` seconds after the last."""
        keep = math.exp(-elapsed / MEMORY_S)
        self._sum = keep * self._sum + share * min(max(value / self._median, 1 / MOST), MOST)
        self._count = keep * self._count + share

    @property
    def factor(self):
        """Factor on standard deviations."""
        return math.sqrt((self._weight + self._sum) / (self._weight + self._count))


class Bands:
    """Factors on the predicted standard deviations of whoever leads.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models.
    calibrated : bool
        False: all factors are one (for ablation).
    """

    def __init__(self, behaviours, calibrated=True):
        channels = len(behaviours[0].joint_names)
        self._calibrated = calibrated
        self._curves = [(one.residual.calibration_horizon, one.residual.calibration_scale) for one in behaviours]
        self._now = [float(np.interp(0.0, *curve)) for curve in self._curves]
        self._usual = [(None, None)] * len(behaviours)  # horizons asked for last, and what is usual there
        self._levels = [Level(one.residual.check_median, one.residual.check_weight) for one in behaviours]
        self._age = np.empty(channels)
        self._all = np.ones(channels, dtype=bool).tobytes()
        self._kept = tuple(np.empty((1, channels)) for _ in range(3))
        self._expected = tuple(part[0] for part in self._kept)
        self._lead = np.array([LEAD_S])
        self.reset()

    def reset(self):
        """Forget everything."""
        self._age.fill(math.inf)
        self._dark = True
        self.forget()

    def forget(self):
        """Forget the person."""
        self._track, self._due = None, math.inf
        for level in self._levels:
            level.reset()

    def observe(self, seen, dt):
        """Note which joints were observed, ``dt`` seconds after the last sample."""
        if seen.tobytes() == self._all:  # a tenth of what seen.all() takes
            self._dark = False
            return
        if not self._dark:
            self._age.fill(0.0)
            self._dark = True
        self._age += dt
        self._age[seen] = 0.0

    def follow(self, track, time, y, seen):
        """Check the prediction that is due, if any, and keep the next one of the filter that leads."""
        if track is not self._track:
            self._track, self._due = track, math.inf
        late = time - self._due  # -inf: nothing is kept yet
        if -math.inf < late < -1e-9:
            return
        if -1e-9 <= late <= LEAD_S:  # the sample may be late: the predicted velocity bridges that
            mean, std, velocity = self._expected
            both = seen & self._watched
            share = np.count_nonzero(both) / len(both)
            if share:
                error = y - mean - late * velocity
                value = check(error, std) if share == 1 else check(error[both], std[both])
                self._levels[track.behaviour].add(value, share, LEAD_S + late)
        track.filter.predict(self._lead, *self._kept)
        self._watched = seen.copy()
        self._due = time + LEAD_S

    def factor(self, index, horizons):
        """Factor on the standard deviation of behaviour ``index``: shape (H,), or (H, D) while joints are in the dark.

        A joint in the dark is as uncertain as a prediction made when it was last seen: its horizon counts from there.
        What was found on joints that are seen says less and less of it.
        """
        if not self._calibrated:
            return np.ones(len(horizons))
        level = self._levels[index].factor
        asked, usual = self._usual[index]
        if asked != horizons.tobytes():
            usual = np.interp(horizons, *self._curves[index])
            self._usual[index] = horizons.tobytes(), usual
        factor = level * usual
        if not self._dark:
            return factor
        dark = np.flatnonzero(self._age)
        age = self._age[dark]
        person = 1 + (level - 1) * np.exp(-age / FAR_S)
        factor = np.repeat(factor[:, None], len(self._age), axis=1)
        factor[:, dark] = person * np.interp(horizons[:, None] + age, *self._curves[index])
        return factor

    def present(self, index):
        """Factor on the standard deviation of what is seen now: a number, or (D,) while joints are in the dark."""
        if not self._calibrated:
            return 1.0
        level = self._levels[index].factor
        if not self._dark:
            return level * self._now[index]
        return (1 + (level - 1) * np.exp(-self._age / FAR_S)) * np.interp(self._age, *self._curves[index])
