"""Segmentation of any motion into library fragments by one-stage dynamic programming (Ney's recursion)."""
from typing import NamedTuple

import numpy as np

from style_core.effort import _warp
from style_core.effort.warping import squared_distances
from style_core.errors import MotionError

__all__ = ['Segment', 'Segmenter', 'segment']

#: frames whose distances to the library are computed at once: bounds memory, fills the matrix product
_CHUNK = 256


class Segment(NamedTuple):
    """A stretch of the input and the fragment it matches: frames ``start`` to ``stop - 1``."""

    start: int
    stop: int
    fragment: int


class Segmenter:
    """Equations (8)-(11) of Torresani, Hackney and Bregler (2006), for recordings and for live streams.

    The recursion keeps one cost and one record a library frame, so memory does not grow with the library's size times
    the input's length.

    Parameters
    ----------
    sequences : sequence of ndarray, shape (T_i, D)
        Scaled poses of the library's fragments.
    """

    def __init__(self, sequences):
        if not len(sequences):
            raise MotionError('there are no fragments to segment with')
        lengths = np.array([len(sequence) for sequence in sequences])
        self._stacked = np.concatenate(sequences)
        self._ends = np.cumsum(lengths).astype(np.int32)
        self._starts = (self._ends - lengths).astype(np.int32)
        self.reset()

    def reset(self):
        """Forget the input."""
        self._costs = np.full(len(self._stacked), np.inf)
        self._records = np.full(len(self._stacked), -1, dtype=np.int64)
        self._end_costs = np.empty(0)
        self._end_records = np.empty(0, dtype=np.int64)
        self._frames = 0
        self._reported = 0

    def push(self, frames):
        """Take further input frames, shape (F, D), scaled as the library.

        Raises
        ------
        MotionError
            If the channels differ or a value is missing.
        """
        frames = np.atleast_2d(np.asarray(frames, dtype=np.float64))
        if frames.shape[1] != self._stacked.shape[1]:
            raise MotionError(f'input frames have {frames.shape[1]} channels, the library {self._stacked.shape[1]}')
        if not np.isfinite(frames).all():
            raise MotionError('the input has missing values: fill them first (motion-style fill)')
        for first in range(0, len(frames), _CHUNK):
            chunk = frames[first:first + _CHUNK]
            count = len(chunk)
            if self._frames + count > len(self._end_costs):
                more = max(count, len(self._end_costs), 4 * _CHUNK)
                self._end_costs = np.concatenate([self._end_costs, np.empty(more)])
                self._end_records = np.concatenate([self._end_records, np.empty(more, dtype=np.int64)])
            window = slice(self._frames, self._frames + count)
            _warp.one_stage(np.ascontiguousarray(squared_distances(chunk, self._stacked)), self._starts, self._ends,
                            self._costs, self._records, self._end_costs[window], self._end_records[window],
                            self._frames)
            self._frames += count

    def settled(self):
        """Segments that no further input can change, each reported once.

        Two hypotheses that share a beginning have settled it: the common beginning of all living hypotheses is final.

        Returns
        -------
        list of Segment
        """
        if not self._frames:
            return []
        alive = np.unique(self._records[np.isfinite(self._costs)])
        chains = None
        for record in alive:
            chain = self._chain(int(record))[:-1]  # the fragment still running has no end yet
            if chains is None:
                chains = chain
            else:
                shared = 0
                while shared < min(len(chain), len(chains)) and chain[shared] == chains[shared]:
                    shared += 1
                chains = chains[:shared]
            if len(chains) <= self._reported:
                return []
        new = chains[self._reported:]
        self._reported = len(chains)
        return new

    def finish(self):
        """Best segmentation of everything pushed, ending a fragment at the last frame (11).

        Returns
        -------
        segments : list of Segment
        cost : float
            The least sum of squared distances (8).

        Raises
        ------
        MotionError
            If nothing was pushed.
        """
        if not self._frames:
            raise MotionError('there is no input to segment')
        last = self._frames - 1
        segments = self._chain(int(self._end_records[last]))
        return segments, float(self._end_costs[last])

    def _chain(self, record):
        """Segments up to a record, oldest first; the last one ends at the newest frame."""
        chain, stop = [], self._frames
        while True:
            start, fragment = divmod(record, len(self._ends))
            chain.append(Segment(start, stop, fragment))
            if start == 0:
                return chain[::-1]
            stop = start
            record = int(self._end_records[start - 1])


def segment(frames, sequences):
    """Segment a whole recording.

    Parameters
    ----------
    frames : ndarray, shape (T, D)
        Scaled poses.
    sequences : sequence of ndarray, shape (T_i, D)

    Returns
    -------
    segments : list of Segment
    cost : float
    """
    segmenter = Segmenter(sequences)
    segmenter.push(frames)
    return segmenter.finish()
