"""Put partial messages of several publishers together into frames."""
import numpy as np

from libc.math cimport NAN, fabs, isnan

__all__ = ['Frame', 'FrameAssembler', 'usable']

cdef long long NEVER = -(1LL << 61)


cdef class Frame:
    """All that was measured at one time.

    Attributes
    ----------
    stamp : int
        Ns, the newest of the messages in it; strictly increasing from frame to frame.
    values : ndarray, shape (D,)
        NaN where nothing usable arrived.
    """

    cdef readonly long long stamp
    cdef readonly object values


def usable(const double[:] positions, const Py_ssize_t[:] places, double limit):
    """The numbers of a message that may be used.

    Parameters
    ----------
    positions : ndarray, shape (P,)
    places : ndarray of int, shape (N,)
        Which of them are wanted.
    limit : float
        What is beyond it is not plausible.

    Returns
    -------
    values : ndarray, shape (N,)
        NaN where the number is NaN or not plausible.
    absent, implausible : int
        How many of either there are.
    """
    cdef Py_ssize_t i, absent = 0, implausible = 0, count = places.shape[0]
    result = np.empty(count)
    cdef double[::1] values = result
    for i in range(count):
        if not 0 <= places[i] < positions.shape[0]:
            raise IndexError(f'there is no position {places[i]}')
        values[i] = positions[places[i]]
        if isnan(values[i]):
            absent += 1
        elif fabs(values[i]) > limit:
            implausible += 1
            values[i] = NAN
    return result, absent, implausible


cdef class FrameAssembler:
    """Collect measurements by channel; every measurement enters exactly one frame, and none is used twice.

    A frame is released as soon as every channel that is due has arrived: a channel is due when its own usual interval
    has passed since its last arrival, so publishers of different rates do not wait for each other. A channel that is
    due and does not come holds back one frame, until the next message; from then on it is not waited for until it is
    back.

    Parameters
    ----------
    n_channels : int
    merge_window : int
        Ns; messages whose stamps differ by no more are one frame. Zero makes every message a frame.
    timeout : int
        Ns; a channel silent for longer is not waited for, and counts as timed out in `ages`.
    """

    cdef public long long merge_window, timeout
    cdef readonly Py_ssize_t n_channels
    cdef long long[::1] _last, _interval
    cdef char[::1] _awaited, _present
    cdef double[::1] _values
    cdef object _frame_values
    cdef bint _begun
    cdef long long _first, _newest, _released

    def __init__(self, n_channels, merge_window, timeout):
        self.merge_window = merge_window
        self.timeout = timeout
        self.n_channels = n_channels
        self.reset()

    def reset(self):
        """Forget all arrivals."""
        self._last = np.full(self.n_channels, NEVER, dtype=np.int64)
        self._interval = np.zeros(self.n_channels, dtype=np.int64)
        self._awaited = np.zeros(self.n_channels, dtype=np.int8)
        self._present = np.zeros(self.n_channels, dtype=np.int8)
        self._released = NEVER
        self._clear()

    cdef _clear(self):
        cdef Py_ssize_t c
        self._frame_values = np.empty(self.n_channels)
        self._values = self._frame_values
        for c in range(self.n_channels):
            self._values[c] = NAN
            self._present[c] = False
        self._begun = False

    def add(self, const Py_ssize_t[:] channels, const double[:] values, long long stamp):
        """Take one message.

        Parameters
        ----------
        channels : ndarray of int, shape (N,)
            Distinct channel numbers.
        values : ndarray, shape (N,)
            NaN where the sensor reported that it has nothing.
        stamp : int
            Ns.

        Returns
        -------
        frames : list of Frame
            None, one, or two.
        reason : str
            ``'out of order'`` or ``'late'`` where the message was dropped, else ''.
        """
        cdef Py_ssize_t i, c, count = channels.shape[0]
        cdef bint again = False
        if values.shape[0] != count:
            raise ValueError(f'{count} channels, but {values.shape[0]} values')
        for i in range(count):
            c = channels[i]
            if not 0 <= c < self.n_channels:
                raise IndexError(f'there is no channel {c}')
            if stamp <= self._last[c]:
                return [], 'out of order'
            again = again or self._present[c]
        frames = []
        if self._begun and (again or abs(stamp - self._first) > self.merge_window):
            frames.append(self._release())
        for i in range(count):
            c = channels[i]
            # an interval longer than the time-out was a pause and says nothing: such a channel is due at once
            self._interval[c] = stamp - self._last[c] if self._last[c] > stamp - self.timeout else 0
            self._last[c] = stamp
            self._awaited[c] = True
        if stamp <= self._released:
            return frames, 'late'
        for i in range(count):
            self._values[channels[i]] = values[i]
            self._present[channels[i]] = True
        self._first = min(self._first, stamp) if self._begun else stamp
        self._newest = max(self._newest, stamp) if self._begun else stamp
        self._begun = True
        for c in range(self.n_channels):
            if self._waited_for(c):
                return frames, ''
        frames.append(self._release())
        return frames, ''

    cdef bint _waited_for(self, Py_ssize_t c) noexcept:
        """Whether a channel is due in the frame at hand and has not come."""
        return (self.merge_window != 0 and self._awaited[c] and not self._present[c]
                and self._last[c] + self._interval[c] <= self._first + self.merge_window
                and self._last[c] > self._newest - self.timeout)

    cdef _release(self):
        cdef Py_ssize_t c
        for c in range(self.n_channels):
            if self._waited_for(c):
                self._awaited[c] = False
        cdef Frame frame = Frame.__new__(Frame)
        frame.stamp, frame.values = self._newest, self._frame_values
        self._released = self._newest
        self._clear()
        return frame

    def ages(self, now):
        """Time since each channel's last arrival, s, shape (D,); infinite where it never came."""
        last = np.asarray(self._last)
        ages = (now - last) * 1e-9
        ages[last == NEVER] = np.inf
        return ages
