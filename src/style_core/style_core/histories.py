"""Histories: recorded motion, and what it did after it last looked like what was just seen.

A memory holds recordings as they are. The instants whose last frames looked most alike say how the motion went on;
their mean displacement is added to the present pose.
"""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.errors import MotionError
from style_core.history_search import displace, even_window, nearest

__all__ = ['AHEAD_S', 'FRAMES', 'NEIGHBOURS', 'Histories', 'HistorySearch', 'RecentPast', 'gather']

#: Instants found, and frames of history they are compared by.
NEIGHBOURS = 5
FRAMES = 10
#: An instant must be followed by so much of its recording, s - unless the motion ends there.
AHEAD_S = 25 / 60
#: Principal directions of whole histories that are compared first (the compiled search has this number built in).
SKETCH = 16


@dataclass(frozen=True, eq=False)
class Histories:
    """Recorded motion to look things up in.

    Attributes
    ----------
    joint_names : tuple of str, length D
    rate_hz : float
    names : tuple of str, length R
        Of the recordings.
    lengths : ndarray of int32, shape (R,)
        Frames of each.
    ends : ndarray of bool, shape (R,)
        Whether the last pose of a recording is where the motion came to rest; otherwise it was only cut there.
    positions : ndarray of float32, shape (N, D)
        All recordings, one after the other, rad.
    """

    joint_names: Tuple[str, ...]
    rate_hz: float
    names: Tuple[str, ...]
    lengths: np.ndarray
    ends: np.ndarray
    positions: np.ndarray

    def without(self, left_out):
        """The same without the recordings whose index is in ``left_out``; None if nothing is left."""
        kept = ~np.isin(np.arange(len(self.names)), list(left_out))
        if not kept.any():
            return None
        return Histories(self.joint_names, self.rate_hz, tuple(np.array(self.names)[kept].tolist()),
                         self.lengths[kept], self.ends[kept], self.positions[np.repeat(kept, self.lengths)])


def gather(recordings, joint_names, rate_hz, ends=None):
    """Histories of recordings at one rate.

    Parameters
    ----------
    recordings : list of (str, ndarray of shape (T, D))
        Name and positions, rad, without missing values.
    joint_names : sequence of str
    rate_hz : float
    ends : sequence of bool, optional
        See `Histories`; by default all recordings were only cut.

    Raises
    ------
    MotionError
        If there is no recording, or values are missing.
    """
    if not recordings:
        raise MotionError('nearest histories need at least one recording')
    for name, positions in recordings:
        if not np.isfinite(positions).all():
            raise MotionError(f'recording {name!r} has missing values: histories must be complete')
    ends = np.zeros(len(recordings), dtype=bool) if ends is None else np.asarray(ends, dtype=bool)
    return Histories(tuple(joint_names), float(rate_hz), tuple(name for name, _ in recordings),
                     np.array([len(positions) for _, positions in recordings], dtype=np.int32), ends,
                     np.concatenate([positions for _, positions in recordings]).astype(np.float32, order='C'))


class HistorySearch:
    """The nearest histories of a memory.

    The search is exact. What was found last, moved on by the time that has passed, gives a bound within which most
    candidates are given up after their newest frame.

    Parameters
    ----------
    histories : Histories
    neighbours, frames : int
    ahead_s : float
        See `AHEAD_S`.

    Raises
    ------
    MotionError
        If the recordings are too short.
    """

    def __init__(self, histories, neighbours=NEIGHBOURS, frames=FRAMES, ahead_s=AHEAD_S):
        self.histories = histories
        channels = len(histories.joint_names)
        # what varies most comes first, so that most candidates are given up after a glance
        self._order = np.argsort(-histories.positions.var(axis=0), kind='stable').astype(np.int32)
        self._bank = np.zeros((len(histories.positions), -(-channels // 16) * 16), dtype=np.float32)
        self._bank[:, :channels] = histories.positions[:, self._order]
        start = np.repeat(np.cumsum(histories.lengths) - histories.lengths, histories.lengths)
        length = np.repeat(histories.lengths, histories.lengths)
        index = np.arange(len(start))
        ahead = np.where(np.repeat(histories.ends, histories.lengths), 0,
                         int(np.ceil(ahead_s * histories.rate_hz - 1e-9)))
        usable = (index - start >= frames - 1) & (index + ahead < start + length)
        self._usable = np.flatnonzero(usable).astype(np.int32)
        self._is_usable = usable
        self._last = (start + length - 1).astype(np.int32)
        if len(self._usable) < neighbours:
            raise MotionError(f'the recordings are too short for {neighbours} histories of {frames} frames and '
                              f'{ahead_s:g} s after them')
        self._window = np.zeros((frames, self._bank.shape[1]), dtype=np.float32)
        windows = self._bank[self._usable[:, None] - np.arange(frames)].reshape(len(self._usable), -1)
        some = windows[:: 1 + len(windows) // 2000]
        self._basis = np.zeros((SKETCH, windows.shape[1]), dtype=np.float32)
        directions = np.linalg.svd(some - some.mean(axis=0), full_matrices=False)[2][:SKETCH]
        self._basis[:len(directions)] = directions
        self._sketches = np.ascontiguousarray(windows @ self._basis.T)
        self._weight = np.zeros_like(self._window)
        self._distance = np.zeros(neighbours, dtype=np.float32)
        self.found = self._usable[:neighbours].copy()

    def find(self, past):
        """Search for what was seen last.

        Parameters
        ----------
        past : RecentPast
            With the same channels.

        Returns
        -------
        bool
            False if nothing of the last frames was seen: ``found`` stays as it is.
        """
        past.fill(1 / self.histories.rate_hz, self._order, self._window, self._weight)
        seen = np.count_nonzero(self._weight)
        if not seen:
            return False
        sketch = None
        if seen == self._weight.shape[0] * len(self._order):
            sketch = self._basis @ self._window.reshape(-1)
        # what was found last has moved on meanwhile: a good guess, and so a bound
        guess = np.minimum(self.found + past.frames_since_asked(self.histories.rate_hz), len(self._bank) - 1)
        bound = np.inf
        if self._is_usable[guess].all() and len(set(guess.tolist())) == len(guess):
            nearest(self._bank, guess.astype(np.int32), self._window, self._weight, np.inf, None,
                    None, self.found, self._distance)
            bound = self._distance[-1]
        nearest(self._bank, self._usable, self._window, self._weight, bound, self._sketches, sketch, self.found,
                self._distance)
        return True

    def pose(self):
        """Mean pose of the histories found, at their newest frame, rad, shape (D,)."""
        return self.histories.positions[self.found].mean(axis=0, dtype=float)

    def displacement(self, horizons):
        """How far the motion went after the histories found.

        Parameters
        ----------
        horizons : ndarray, shape (H,)
            S, >= 0.

        Returns
        -------
        mean, velocity : ndarray, shape (H, D)
            Rad and rad/s.
        """
        shape = (len(horizons), len(self.histories.joint_names))
        mean, velocity = np.empty(shape), np.empty(shape)
        displace(self.histories.positions, self.found, self._last[self.found], self.histories.rate_hz,
                 np.ascontiguousarray(horizons, dtype=float), mean, velocity)
        return mean, velocity


class RecentPast:
    """The last observations, whenever they came.

    Parameters
    ----------
    channels : int
    span_s : float
        How far back they are kept, s.
    """

    ROOM = 128

    def __init__(self, channels, span_s):
        self._nearest = 4 * span_s / self.ROOM  # of a fast sensor only some are kept: values between are linear
        self._times = np.zeros(self.ROOM)
        self._y = np.zeros((self.ROOM, channels), dtype=np.float32)
        self._seen = np.zeros_like(self._y)
        self.reset()

    def reset(self):
        """Forget everything observed."""
        self._count = 0
        self._asked = None

    def add(self, time, y, observed):
        """Keep an observation, ``y`` and ``observed`` of shape (D,)."""
        at = self._count
        if at > 2 and self._times[at - 1] - self._times[at - 2] < self._nearest:
            at -= 1  # the newest always stays
        elif at == self.ROOM:
            at //= 2  # twice the span, at the least
            for kept in (self._times, self._y, self._seen):
                kept[:at] = kept[at:]
        self._times[at] = time
        self._seen[at] = observed
        self._y[at] = y
        if not observed.all():
            self._y[at][~observed] = 0.0
        self._count = at + 1

    def fill(self, period, order, window, weight):
        """Fill ``window`` and ``weight`` as `style_core.history_search.even_window` does."""
        even_window(self._times, self._y, self._seen, self._count, period, order, window, weight)

    def frames_since_asked(self, rate_hz):
        """Frames since this was asked last; 0 the first time."""
        now = self._times[self._count - 1]
        since = 0 if self._asked is None else round(min((now - self._asked) * rate_hz, 1e6))
        self._asked = now
        return since
