"""What every on-line predictor here shares: how long a silence may be, and the innovation statistic."""
import math

__all__ = ['InnovationMonitor', 'GAP_S']

#: After a longer silence what was known about the phase is worth nothing, s: the search starts again.
GAP_S = 1.0


class InnovationMonitor:
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

    def __init__(self, window_s=0.1, factor=3.0, usual=(0.3, 1.0)):
        self._window_s, self._factor, self._usual = window_s, factor, usual
        self.reset()

    def reset(self):
        """Forget everything."""
        self.level = None
        self.median = None

    @property
    def limit(self):
        """Average innovation above which the filter is lost."""
        low, high = self._usual
        return self._factor * min(max(self.median if self.median is not None else high, low), high)

    def add(self, innovation, dt):
        """Take one innovation statistic; returns True while it is out of bounds."""
        if math.isnan(innovation):
            return False
        if self.level is None:
            self.level, self.median = innovation, innovation
            return False
        self.level += (1 - math.exp(-dt / self._window_s)) * (innovation - self.level)
        # a running median: up and down by the same share of itself
        self.median *= math.exp(math.copysign(0.6 * min(dt, 0.5), self.level - self.median))
        return self.level > self.limit
