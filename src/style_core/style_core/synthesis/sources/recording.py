"""A recording as a source of motion."""
import numpy as np

from style_core.errors import MotionError
from style_core.synthesis.player import loop_cut
from style_core.synthesis.sources.source import COAST_S, TimedSource, coast_to_rest, hermite

__all__ = ['MotionFileSource']

#: a seamless loop fades its end into its start over at most this long, s
SEAM_S = 0.3


class MotionFileSource(TimedSource):
    """Play a recording, once or as a loop without a seam.

    Parameters
    ----------
    motion : Motion
        No missing values, two frames at least, continuous angles (`style_core.recordings.read_recording`).
    loop : bool
        Cut at the best matching poses; the difference that remains is spread over the end of the loop.
    speed : float
    """

    def __init__(self, motion, loop=False, speed=1.0):
        super().__init__(speed)
        if np.isnan(motion.positions).any():
            raise MotionError(f'{motion.name or "the motion"} has missing values: fill or cut them first')
        if motion.n_frames < 2:
            raise MotionError(f'{motion.name or "the motion"} has a single frame')
        self.joint_names, self._loop = motion.joint_names, loop
        if loop:
            motion = _closed(motion)
        self._times = motion.times - motion.times[0]
        self._positions, self._velocities = motion.positions, motion.velocities()
        if loop:
            self._velocities[-1] = self._velocities[0]

    @property
    def duration(self):
        """Of the recording or the loop, s."""
        return float(self._times[-1])

    @property
    def phase(self):
        """Part of the recording that has been played, [0, 1]."""
        if self._loop:
            return float(self._content / self.duration % 1.0)
        return float(min(self._content / self.duration, 1.0))

    @property
    def remaining(self):
        """See `MotionSource.remaining`."""
        if self._loop:
            return np.inf
        left = max(self.duration + COAST_S - self._content, 0.0)
        return left / self.speed if self.speed > 0 else (np.inf if left else 0.0)

    def _course(self, ahead, content):
        if self._loop:
            content = np.mod(content, self.duration)
        positions, slope = hermite(self._times, self._positions, self._velocities, np.minimum(content, self.duration))
        over = content > self.duration
        if over.any():
            positions[over], slope[over] = coast_to_rest(self._positions[-1], self._velocities[-1],
                                                         content[over] - self.duration)
        return positions, slope, np.zeros_like(slope)


def _closed(motion):
    """The best loop, ending in the pose and the velocity it starts from."""
    cut, _ = loop_cut(motion, shortest_s=min(1.0, 0.5 * motion.duration_s))
    step = 1.0 / cut.rate_hz
    times = np.append(cut.times, cut.times[-1] + step)
    follow = motion.at([min(times[-1], motion.times[-1])]).positions
    positions = np.concatenate([cut.positions, follow])
    # the first pose once more at the end, and what is missing to it spread over the last part
    missing = positions[0] - positions[-1]
    length = min(SEAM_S, 0.5 * (times[-1] - times[0]))
    u = np.clip((times - (times[-1] - length)) / length, 0.0, 1.0)[:, None]
    return cut.replace(positions=positions + missing * u**3 * (10 - 15 * u + 6 * u * u), times=times)
