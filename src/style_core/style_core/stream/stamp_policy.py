"""What to do with each time stamp: take it, drop it with a named reason, or start again."""
from typing import NamedTuple, Optional

__all__ = ['StampVerdict', 'StampPolicy', 'NANOSECONDS']

NANOSECONDS = 1_000_000_000


class StampVerdict(NamedTuple):
    """The outcome for one message.

    Attributes
    ----------
    stamp : int or None
        The time to use, ns; None where the message is to be dropped.
    reason : str
        Why it was dropped (``'stale'``, ``'future'``, ``'jump'``), ``'zero'`` where the arrival time stands in,
        else ''.
    reset : bool
        The clock has jumped: forget what came before.
    """

    stamp: Optional[int]
    reason: str = ''
    reset: bool = False


class StampPolicy:
    """Judge stamps one after another; all times in ns.

    A stamp of zero means the arrival time. A stamp older than ``max_age`` on arrival is stale, one as far ahead is in
    the future; zero turns both checks off (a recording played back without its clock). A stamp more than
    ``reorder_window`` behind the newest, or more than ``max_gap`` ahead, is a jump of the clock: the first such message
    is dropped, and when a second one agrees with it everything starts again from there. So one message with a broken
    stamp costs nothing, and a looped recording costs one message. Where stamps and arrivals both say that time has
    passed there was a pause, and everything starts again at once.
    """

    def __init__(self, max_age, max_gap, reorder_window):
        self.max_age = max_age
        self.max_gap = max_gap
        self.reorder_window = reorder_window
        self.reset()

    def reset(self):
        """Forget all stamps."""
        self._newest = self._newest_arrival = None
        self._candidate = None

    def judge(self, stamp, arrival):
        """Judge the stamp of a message that arrived at ``arrival``; returns a `StampVerdict`."""
        reason = ''
        if stamp == 0:
            stamp, reason = arrival, 'zero'
        elif self.max_age:
            if arrival - stamp > self.max_age:
                return StampVerdict(None, 'stale')
            if stamp - arrival > self.max_age:
                return StampVerdict(None, 'future')
        if self._newest is None:
            self._newest, self._newest_arrival = stamp, arrival
            return StampVerdict(stamp, reason)
        ahead = stamp - self._newest
        if -self.reorder_window <= ahead <= self.max_gap:
            if ahead >= 0:
                self._newest, self._newest_arrival = stamp, arrival
            self._candidate = None
            return StampVerdict(stamp, reason)
        paused = ahead > 0 and abs(arrival - self._newest_arrival - ahead) <= self.max_gap
        if paused or (self._candidate is not None and 0 < stamp - self._candidate <= self.max_gap):
            self._newest, self._newest_arrival, self._candidate = stamp, arrival, None
            return StampVerdict(stamp, reason, reset=True)
        self._candidate = stamp
        return StampVerdict(None, 'jump')
