"""Put partial messages of several publishers together into frames."""
from dataclasses import dataclass

import numpy as np

__all__ = ['Frame', 'FrameAssembler']

_NEVER = np.iinfo(np.int64).min // 4


@dataclass(frozen=True, eq=False)
class Frame:
    """All that was measured at one time.

    Attributes
    ----------
    stamp : int
        Ns, the newest of the messages in it; strictly increasing from frame to frame.
    values : ndarray, shape (D,)
        NaN where nothing usable arrived.
    """

    stamp: int
    values: np.ndarray


class FrameAssembler:
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

    def __init__(self, n_channels, merge_window, timeout):
        self.merge_window = merge_window
        self.timeout = timeout
        self.n_channels = n_channels
        self.reset()

    def reset(self):
        """Forget all arrivals."""
        self._last = np.full(self.n_channels, _NEVER, dtype=np.int64)
        self._interval = np.zeros(self.n_channels, dtype=np.int64)
        self._awaited = np.zeros(self.n_channels, dtype=bool)
        self._released = _NEVER
        self._clear()

    def _clear(self):
        self._values = np.full(self.n_channels, np.nan)
        self._present = np.zeros(self.n_channels, dtype=bool)
        self._first = self._newest = None

    def add(self, channels, values, stamp):
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
        last = self._last[channels]
        if stamp <= last.max(initial=_NEVER):
            return [], 'out of order'
        frames = []
        if self._first is not None and (
                abs(stamp - self._first) > self.merge_window or self._present[channels].any()):
            frames.append(self._release())
        # an interval longer than the time-out was a pause and says nothing: such a channel is due at once
        self._interval[channels] = np.where(last > stamp - self.timeout, stamp - last, 0)
        self._last[channels] = stamp
        self._awaited[channels] = True
        if stamp <= self._released:
            return frames, 'late'
        self._values[channels] = values
        self._present[channels] = True
        self._first = stamp if self._first is None else min(self._first, stamp)
        self._newest = stamp if self._newest is None else max(self._newest, stamp)
        if not self._waited_for().any():
            frames.append(self._release())
        return frames, ''

    def _waited_for(self):
        """Channels that are due in the frame at hand and have not come."""
        if self.merge_window == 0:
            return np.zeros(self.n_channels, dtype=bool)
        missing = self._awaited & ~self._present
        if missing.any():
            missing &= self._last + self._interval <= self._first + self.merge_window
            missing &= self._last > self._newest - self.timeout
        return missing

    def _release(self):
        self._awaited &= ~self._waited_for()
        frame = Frame(self._newest, self._values)
        self._released = self._newest
        self._clear()
        return frame

    def ages(self, now):
        """Time since each channel's last arrival, s, shape (D,); infinite where it never came."""
        ages = (now - self._last) * 1e-9
        ages[self._last == _NEVER] = np.inf
        return ages
