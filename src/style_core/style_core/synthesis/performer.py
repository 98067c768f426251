"""What the synthesizer node asks: the next window of a robot's trajectory, whatever is exchanged meanwhile."""
import numpy as np

from style_core.errors import ModelError
from style_core.follow.playback import quintic
from style_core.synthesis.motor_limits import MotorLimits

__all__ = ['Performer', 'window_times']

_POWERS = np.arange(6)
_INSTANT = 1e-4


def window_times(step, horizon):
    """Times ahead of the points of a window, shape (K,), s: now, then every ``step`` up to ``horizon``.

    The first point is over when the window arrives. A receiver would else have to invent the way to it, and a
    joint_trajectory_controller stands still for an update at every window.
    """
    return step * np.arange(max(1, int(np.floor(horizon / step + 1e-9))) + 1)


class Performer:
    """A source moving a robot, within its limits.

    Position, velocity and acceleration asked for stay continuous when the source is exchanged; what a motor cannot do
    is replaced by the nearest it can, see `style_core.synthesis.motor_limits`.

    Parameters
    ----------
    source : MotionSource
    robot : style_core.synthesis.retargeting.Robot
    """

    def __init__(self, source, robot):
        self.robot = robot
        self.source, self._bound = source, robot.bind(source.joint_names)
        self.joint_names = self._bound.joint_names
        bound = self._bound
        self.limits = MotorLimits(bound.lower, bound.upper, bound.velocity, bound.acceleration)
        self._next = None
        self._decay, self._age, self._length = None, 0.0, 0.0
        self.elapsed = 0.0

    @property
    def ready(self):
        """Whether there is anything to say."""
        return self.source.ready

    @property
    def coming(self):
        """The source that is about to take over, or the one that has."""
        return self.source if self._next is None else self._next[0]

    @property
    def blending(self):
        """Whether one source is still on its way into another."""
        return self._decay is not None

    def exchange(self, source, seconds):
        """Go over to another source within ``seconds``, as soon as it is ready.

        Raises
        ------
        ModelError
            If it does not move this robot; the old one stays then.
        """
        bound = self.robot.bind(source.joint_names)
        if bound.joint_names != self.joint_names:
            raise ModelError('the new model moves other joints: configure anew to change the robot')
        self._next = source, bound, max(seconds, 0.05)
        self._take_over()

    def _take_over(self):
        if self._next is None or not self._next[0].ready:
            return
        source, bound, seconds = self._next
        self._next = None
        self.elapsed = 0.0
        if not self.source.ready:
            self.source, self._bound = source, bound
            return
        before = self._state()
        self.source, self._bound, self._decay = source, bound, None
        gap = [old - new for old, new in zip(before, self._state())]
        self._decay, self._age, self._length = quintic(seconds, *gap, 0.0, 0.0, 0.0), 0.0, seconds

    def _state(self):
        """Position, velocity and acceleration now."""
        positions, velocities = self._free(np.array([0.0, _INSTANT]))
        return positions[0], velocities[0], (velocities[1] - velocities[0]) / _INSTANT

    def advance(self, dt):
        """Let ``dt`` seconds pass."""
        self.source.advance(dt)
        self.limits.advance(dt)
        if self._next is not None:
            self._next[0].advance(dt)
        self.elapsed += dt
        if self._decay is not None:
            self._age += dt
            if self._age >= self._length:
                self._decay = None
        self._take_over()

    def window(self, ahead):
        """Positions and velocities of the robot's joints to send, shape (K, R) each, at times ahead (K,), s."""
        ahead = np.asarray(ahead, dtype=float)
        return self.limits.window(ahead, *self._bound.limit(*self._free(ahead)))

    def at(self, ahead):
        """The same as the last window has them, at any times within it."""
        ahead = np.asarray(ahead, dtype=float)
        return self.limits.at(ahead, *self._bound.limit(*self._free(ahead)))

    def _free(self, ahead):
        """The same before limits."""
        positions, velocities = self._bound.combine(*self.source.window(ahead))
        if self._decay is not None:
            time = np.minimum(self._age + ahead, self._length)[:, None]
            positions = positions + time**_POWERS @ self._decay.T
            velocities = velocities + (_POWERS * time ** np.maximum(_POWERS - 1, 0)) @ self._decay.T
        return positions, velocities
