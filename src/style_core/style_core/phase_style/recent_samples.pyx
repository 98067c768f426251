"""The last samples, far enough apart to count one by one, so that a hypothesis can start in the past and catch up."""
import numpy as np

from style_core.phase_style.settings import SPACING_S, WINDOW

__all__ = ['SPACING_S', 'WINDOW', 'RecentSamples']


cdef class RecentSamples:
    """Samples in one piece of memory, several windows long, so that the last ones always lie side by side.

    Parameters
    ----------
    channels : int
    """

    def __init__(self, int channels):
        self.y = np.zeros((8 * WINDOW, channels))
        self.observed = np.zeros((8 * WINDOW, channels), dtype=np.uint8)
        self._times = np.zeros(8 * WINDOW)
        self.values, self.flags, self.time = self.y, self.observed, self._times
        self.reset()

    def reset(self):
        """Forget all samples."""
        self.count = self.first = self.base = 0
        self.last = 0.0

    def forget(self):
        """Samples before the last one no longer count."""
        self.first = max(self.count - 1, 0)

    cdef bint add(self, double time, const double[::1] y, const unsigned char[::1] seen) except -1:
        """Keep an observation if it is far enough from the last one and not empty; returns whether it was."""
        cdef long row, d, count = 0
        for d in range(seen.shape[0]):
            count += seen[d]
        if (self.count and time - self.last < SPACING_S) or count == 0:
            return False
        row = self.row(self.count)
        if row == self.values.shape[0]:
            for memory in (self.y, self.observed, self._times):
                memory[:WINDOW] = memory[-WINDOW:]
            self.base = self.count - WINDOW
            row = WINDOW
        self.values[row, :] = y
        self.flags[row, :] = seen
        self.time[row] = self.last = time
        self.count += 1
        return True

    cdef long row(self, long sample) noexcept:
        """Where a sample lies."""
        return sample - self.base

    cdef long usable(self) noexcept:
        """How many of the last samples this search may use."""
        return self.count - self.first
