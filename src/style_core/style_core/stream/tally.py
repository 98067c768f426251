"""Counts and timings of a running stream, for diagnostics."""
from collections import Counter, deque

import numpy as np

__all__ = ['Tally']


class Tally:
    """Count what happened and remember the newest of every kind of timing.

    Parameters
    ----------
    window : int
        How many timings of each kind are kept.
    """

    def __init__(self, window=2000):
        self._window = window
        self.total = Counter()
        self._since = Counter()
        self._timings = {}

    def count(self, what, number=1):
        """Count an event."""
        self.total[what] += number
        self._since[what] += number

    def time(self, what, seconds):
        """Record a duration, s."""
        self._timings.setdefault(what, deque(maxlen=self._window)).append(seconds)

    def fresh(self):
        """Counts since the last call, and start counting anew (the totals stay)."""
        since, self._since = self._since, Counter()
        return since

    def percentiles(self, what, ranks=(50, 99)):
        """Percentiles of a timing, s, and forget it; NaN where nothing was recorded."""
        kept = self._timings.pop(what, ())
        return tuple(np.percentile(kept, ranks)) if kept else (float('nan'),) * len(ranks)
