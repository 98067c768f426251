"""Loss of track: the innovation statistic that every filter here is watched by."""
from libc.math cimport copysign, exp, isnan

__all__ = ['InnovationMonitor']


cdef class InnovationMonitor:
    """Tell when a filter no longer explains what it sees.

    The innovation per channel is averaged over ``window_s``. Three times the running median of these averages is a
    loss. A filter whose variances fit has a median of about one; a median outside ``usual`` is not believed, so that
    a filter that never fitted is not measured by its own failure.

    Parameters
    ----------
    window_s : float
    factor : float
    usual : (float, float)
        Range of medians to believe; the upper may be infinite.
    """

    cdef readonly double window_s, factor
    cdef readonly tuple usual
    cdef double low, high, level, median
    cdef bint started

    def __init__(self, window_s=0.1, factor=3.0, usual=(0.3, 1.0)):
        self.window_s, self.factor, self.usual = window_s, factor, usual
        self.low, self.high = usual
        self.reset()

    def reset(self):
        """Forget everything."""
        self.started = False
        self.level = 0
        self.median = self.high

    @property
    def limit(self):
        """Average innovation above which the filter is lost."""
        return self._limit()

    cdef double _limit(self):
        return self.factor * min(max(self.median, self.low), self.high)

    def add(self, double innovation, double dt):
        """Count one innovation statistic in; returns True while it is out of bounds."""
        if isnan(innovation):
            return False
        if not self.started:
            self.started = True
            self.level, self.median = innovation, innovation
            return False
        self.level += (1 - exp(-dt / self.window_s)) * (innovation - self.level)
        # a running median: up and down by the same share of itself
        self.median *= exp(copysign(0.6 * min(dt, 0.5), self.level - self.median))
        return self.level > self._limit()
