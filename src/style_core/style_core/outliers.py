"""Which values of an observation to believe, for filters that know what they expect and how well.

The rules are those of the full phase-style filter (`style_core.phase_style.rejection`, compiled for its blocks of
channels): a joint far beyond what its variance allows is the sensor's fault where few joints are, and the motion's, or
that of the whole message, where many are.
"""
import numpy as np

__all__ = ['Doubt', 'LIMIT', 'FAREWELL_S']

#: standard deviations beyond which a joint is not believed
LIMIT = 20.0
#: share of the joints up to which it is the sensors that are wrong, and number of joints below which one is many
_FEW, _ALONE = 0.15, 4
#: a joint that is out by the same again and again has moved: it is believed after so long, s
_BELIEVED_S = 0.05
#: a follower whose observations as a whole were not believed for so long follows something else, s
FAREWELL_S = 0.25


class Doubt:
    """Judge one observation after the other.

    Parameters
    ----------
    channels : int

    Attributes
    ----------
    moved : ndarray of bool, shape (D,)
        Joints of the last observation that are believed again after having been out: the filter must be told that its
        own idea of them was wrong.
    out_s : float
        For how long whole observations have not been believed, s.
    """

    def __init__(self, channels):
        self._channels = channels
        self.reset()

    def reset(self):
        """Forget all doubts."""
        self._since = np.full(self._channels, -1.0)     # time in doubt, s; negative: not in doubt
        self._gap = np.zeros(self._channels)
        self._value = np.zeros(self._channels)
        self._doubting = False
        self.moved = np.zeros(self._channels, dtype=bool)
        self.out_s = 0.0

    def judge(self, y, gap, variance, seen, elapsed, tracking):
        """Joints to believe.

        Parameters
        ----------
        y, gap, variance : ndarray, shape (D,)
            Values, what they lie off the expected ones, and the variance that they should have done so with.
        seen : ndarray of bool, shape (D,)
            What was observed; only these are looked at.
        elapsed : float
            Since the last observation, s.
        tracking : bool
            Whether the filter knows where it is: only then are whole observations left out.

        Returns
        -------
        ndarray of bool, shape (D,)
        """
        square = np.where(seen, gap * gap / variance, 0.0)
        out = square > LIMIT**2
        if self.moved.any():
            self.moved[:] = False
        if not (self._doubting or out.any()):
            self.out_s = 0.0
            return seen
        count, seen_count = int(np.count_nonzero(out)), int(np.count_nonzero(seen))
        if count and count > _FEW * seen_count and (count > 1 or seen_count < _ALONE):
            if tracking:
                self.out_s += elapsed
                return np.zeros(self._channels, dtype=bool)
            return seen
        self.out_s = 0.0
        known = self._since >= 0
        again = known & out & ((gap - self._gap)**2 <= LIMIT**2 * variance)
        # a value that stands still is a dead encoder's, however long
        self._since = np.where(out, np.where(again, self._since + np.where(y != self._value, elapsed, 0.0), 0.0),
                               np.where(seen, -1.0, self._since))
        self._gap, self._value = np.where(out, gap, self._gap), np.where(out, y, self._value)
        self.moved = out & (self._since >= _BELIEVED_S)
        self._since[self.moved] = -1.0
        self._doubting = bool((self._since >= 0).any())
        return seen & (~out | self.moved)
