"""Checking one observation after the other against the protocol of `style_core.predictor`."""
import numpy as np

from libc.math cimport fabs, isfinite

__all__ = ['ObservationChecker']

#: No joint is farther than this from zero, rad: a value beyond it counts as not observed.
cdef double FARTHEST = 1e4


cdef class ObservationChecker:
    """Keeps the last observation that was in order.

    Parameters
    ----------
    channels : int

    Attributes
    ----------
    y : ndarray, shape (D,)
    observed : ndarray of uint8, shape (D,)
        1 where a value that a joint can have was given and not masked.
    seen : ndarray of bool, shape (D,)
        The same.
    time : float or None
        Stamp of the last observation, s.
    """

    cdef readonly object y, observed, seen, time
    cdef int _channels
    cdef double[::1] _y
    cdef unsigned char[::1] _observed

    def __init__(self, int channels):
        self._channels = channels
        self.y = np.zeros(channels)
        self.observed = np.zeros(channels, dtype=np.uint8)
        self._y, self._observed, self.seen = self.y, self.observed, self.observed.view(bool)
        self.time = None

    def reset(self):
        """Forget the last time stamp."""
        self.time = None

    def flags(self):
        """Which channels were observed: ndarray of bool, shape (D,), of its own."""
        return self.seen.copy()

    def check(self, time, y, mask):
        """Store an observation in ``y`` and ``observed``; return the time since the last one, s (0 for the first).

        Raises
        ------
        ValueError
            If a shape is wrong, a value is infinite, or time does not increase. Nothing is changed then.
        """
        cdef int d
        cdef double dt = 0
        cdef const double[:] given
        cdef const unsigned char[:] used
        cdef double now = time
        if not isfinite(now):
            raise ValueError(f'time must be finite, got {time}')
        if self.time is not None:
            dt = now - <double>self.time
            if not dt > 0:
                raise ValueError(f'time must increase: got {now!r} s after {self.time!r} s')
        y = np.asarray(y, dtype=float)
        if y.ndim != 1 or len(y) != self._channels:
            raise ValueError(f'observation must have shape ({self._channels},), got {y.shape}')
        given = y
        for d in range(self._channels):
            if fabs(given[d]) > 1.7976931348623157e308:
                raise ValueError('observation holds an infinite value')
        if mask is not None:
            mask = np.asarray(mask)
            if mask.shape != (self._channels,) or mask.dtype != bool:
                raise ValueError(f'mask must be boolean of shape ({self._channels},), got {mask.dtype} {mask.shape}')
            used = mask.view(np.uint8)
        for d in range(self._channels):
            self._y[d] = given[d]
            self._observed[d] = fabs(given[d]) < FARTHEST and (mask is None or used[d])  # NaN is not
        self.time = now
        return dt
