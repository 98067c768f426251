"""A recording restyled by effort as a source of motion: every fragment with the effort asked for when it comes up."""
from itertools import count

import numpy as np

from style_core.effort.descriptors import EFFORTS
from style_core.effort.joins import Joiner
from style_core.effort.restyle import checked_target, choose_blend
from style_core.effort.segmentation import segment
from style_core.synthesis.sources.source import COAST_S, TimedSource, coast_to_rest, hermite

__all__ = ['RestyledSource']

#: what the ends of the scales are called (Laban)
_NAMES = {'free': (3, 0, 0), 'bound': (-3, 0, 0), 'strong': (0, 3, 0), 'light': (0, -3, 0), 'sudden': (0, 0, 3),
          'sustained': (0, 0, -3), 'neutral': (0, 0, 0), 'flow': (1, 0, 0), 'weight': (0, 1, 0), 'time': (0, 0, 1)}


class RestyledSource(TimedSource):
    """Perform a recording with other effort (`style_core.effort.restyle`), fragment by fragment.

    The style is the asked effort, (flow, weight, time) in [-3, 3]; another one holds from the next fragment that has
    not been made yet. The root is left out: this moves joints.

    Parameters
    ----------
    library : EffortLibrary
    motion : Motion
        With the joints of the library, no value missing.
    loop : bool
        Perform it for ever.
    speed : float
    """

    labels = EFFORTS

    def __init__(self, library, motion, loop=False, speed=1.0):
        super().__init__(speed)
        self.styles = {name: np.array(value, dtype=float) for name, value in _NAMES.items()}
        self.joint_names = library.space.joint_names
        self._library, self._loop = library, loop
        if abs(motion.rate_hz - library.rate_hz) > 1e-6 * library.rate_hz:
            motion = motion.resample(library.rate_hz)
        self._segments, _ = segment(library.space.encode(motion).joints * library.scale, library.sequences)
        self._target = np.zeros(3)
        self._chosen = {}       # fragment -> poses for the target
        self._joiner = Joiner(library.rate_hz)
        self._pieces = self._make()
        self._positions = np.empty((0, len(self.joint_names)))
        self._first = 0         # number of the oldest frame kept
        self._marks = []        # (number of the first frame, effort asked, part of the recording) of pieces on the way
        self._to_make = sum(piece.stop - piece.start for piece in self._segments)
        self._ended = False
        self._fill(0)

    @property
    def style(self):
        """See `MotionSource.style`."""
        return self._marks[0][1]

    @property
    def target(self):
        """See `MotionSource.target`."""
        return self._target

    @property
    def phase(self):
        """Part of the recording that has been performed, [0, 1]; to a fragment."""
        return self._marks[0][2]

    @property
    def remaining(self):
        """See `MotionSource.remaining`; fragments still to be made count as long as in the recording."""
        if self._loop:
            return np.inf
        frames = self._first + len(self._positions) + self._to_make - 1
        left = max(frames / self._library.rate_hz + COAST_S - self._content, 0.0)
        return left / self.speed if self.speed > 0 else (np.inf if left else 0.0)

    def set_style(self, v, seconds):
        """Ask for another effort from the next fragment on; ``seconds`` does not matter.

        Raises
        ------
        UsageError
            If it is not three numbers in [-3, 3].
        """
        v = checked_target(v)
        if not np.array_equal(v, self._target):
            self._target, self._chosen = v, {}

    def advance(self, dt):
        """See `MotionSource.advance`."""
        super().advance(dt)
        now = int(self._content * self._library.rate_hz)
        self._fill(now)
        drop = min(now - 1 - self._first, len(self._positions) - 3)
        if drop > 0:
            self._positions = self._positions[drop:]
            self._first += drop
        while len(self._marks) > 1 and self._marks[1][0] <= now:
            self._marks.pop(0)

    def _make(self):
        """Joined pieces: (poses, effort asked, part of the recording before it, frames of the recording)."""
        waiting = None
        for turn in count():
            if turn and not self._loop:
                break
            for number, piece in enumerate(self._segments):
                if piece.fragment not in self._chosen:
                    self._chosen[piece.fragment] = choose_blend(self._library, piece.fragment, self._target)[2]
                done = self._joiner.append(self._chosen[piece.fragment])
                if done is not None:
                    yield done, *waiting
                waiting = self._target, number / len(self._segments), piece.stop - piece.start
        yield self._joiner.finish(), *waiting

    def _fill(self, number):
        """Make frames up to ``number`` and two more, so that no velocity changes later."""
        while not self._ended and self._first + len(self._positions) < number + 3:
            made = next(self._pieces, None)
            if made is None:
                self._ended = True
                return
            poses, effort, part, frames = made
            self._to_make -= frames
            self._marks.append((self._first + len(self._positions), effort, part))
            before = self._positions[-1] if len(self._positions) else None
            motion = self._library.space.decode(poses, self._library.rate_hz, reference=before)
            columns = [motion.joint_names.index(name) for name in self.joint_names]
            self._positions = np.concatenate([self._positions, motion.positions[:, columns]])

    def _course(self, ahead, content):
        rate = self._library.rate_hz
        self._fill(int(np.max(content, initial=0.0) * rate) + 1)
        times = (self._first + np.arange(len(self._positions))) / rate
        velocities = np.gradient(self._positions, 1 / rate, axis=0)
        here, slope = hermite(times, self._positions, velocities, np.clip(content, times[0], times[-1]))
        over = content > times[-1]
        if over.any():
            here[over], slope[over] = coast_to_rest(self._positions[-1], velocities[-1], content[over] - times[-1])
        return here, slope, np.zeros_like(slope)
