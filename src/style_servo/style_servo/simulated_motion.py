"""Motion of the simulated servos: profile generator, position loop, load and heat, all servos in one vector step.

The numbers make servos that move, lag, load and heat plausibly. They are not an identified model of any product.
"""
import numpy as np

__all__ = ['Motion', 'STEP_S']

STEP_S = 0.002
FASTEST = 12.0              # rad/s, no-load speed
STRONGEST = 1500.0          # rad/s^2 at full current
BANDWIDTH = 120.0           # rad/s, position and velocity loops
OVERLOAD_AFTER_S = 1.0      # at full load
AMBIENT = 30.0              # deg C


class Motion:
    """State of n servos. Angles in rad from the position value 0 of the servo's own scale.

    Attributes are arrays of shape (n,): ``position``, ``velocity`` (of the horn), ``profile_position``,
    ``profile_velocity`` (the reference the servo generates), ``goal``, ``goal_velocity``, ``speed`` and
    ``acceleration`` (of the profile; infinite = no profile), ``torque``, ``velocity_mode``, ``halted``, ``blocked``
    (bool), ``load`` (-1..1), ``temperature`` (deg C), ``overloaded`` (s at full load).
    """

    def __init__(self, start):
        n = len(start)
        self.position = np.array(start, dtype=np.float64)
        self.goal = self.position.copy()
        self.profile_position = self.position.copy()
        self.velocity, self.profile_velocity, self.goal_velocity, self.load, self.overloaded = np.zeros((5, n))
        self.speed, self.acceleration = np.full((2, n), np.inf)
        self.torque, self.velocity_mode, self.halted, self.blocked = np.zeros((4, n), dtype=bool)
        self.temperature = np.full(n, AMBIENT)
        self._time = None

    def advance(self, now):
        """Move to time ``now`` (s) in whole steps of 2 ms, as servos have a cycle of their own."""
        if self._time is None:
            self._time = now
        while now - self._time >= STEP_S - 1e-9:
            self._step(STEP_S)
            self._time += STEP_S

    def stop_profile(self, i):
        """Make servo ``i`` hold where it is: torque just enabled, or stopped by its Bus Watchdog."""
        self.goal[i] = self.profile_position[i] = self.position[i]
        self.goal_velocity[i] = self.profile_velocity[i] = 0.0

    def _step(self, h):
        speed = np.minimum(self.speed, FASTEST)
        change = np.minimum(self.acceleration, 1e6) * h
        gap = self.goal - self.profile_position
        distance = np.abs(gap)
        # largest speed from which the profile still stops at the goal, one step ahead
        stopping = np.sqrt(2 / h * change * distance + (0.5 * change) ** 2) - 0.5 * change
        wanted = np.copysign(np.minimum(np.minimum(speed, distance / h), stopping), gap)
        if self.velocity_mode.any():
            wanted = np.where(self.velocity_mode, _within(self.goal_velocity, FASTEST), wanted)
        if self.halted.any():
            wanted[self.halted] = 0.0
        self.profile_velocity += _within(wanted - self.profile_velocity, change)
        self.profile_position += self.profile_velocity * h
        push = (BANDWIDTH ** 2 * (self.profile_position - self.position)
                + 2 * BANDWIDTH * (self.profile_velocity - self.velocity))
        all_on = self.torque.all()
        if not all_on:
            push = np.where(self.torque, push, -10.0 * self.velocity)
        push = _within(push, STRONGEST)
        # semi-implicit in the damping, so that the step is stable at any bandwidth
        self.velocity += push * (h / (1 + 2 * BANDWIDTH * h + (BANDWIDTH * h) ** 2))
        self.velocity = _within(self.velocity, FASTEST)
        if self.blocked.any():
            self.velocity[self.blocked] = 0.0
        self.position += self.velocity * h
        friction = 0.03 * np.tanh(20 * self.velocity) + 0.05 / FASTEST * self.velocity
        self.load = _within(push / STRONGEST + friction, 1.0)
        if not all_on:
            off = ~self.torque
            self.profile_position[off] = self.position[off]
            self.profile_velocity[off] = self.load[off] = 0.0
        full = np.abs(self.load) > 0.95
        self.overloaded = (self.overloaded + h) * full
        self.temperature += h * (0.5 * self.load ** 2 - 0.01 * (self.temperature - AMBIENT))


def _within(values, limit):
    return np.minimum(np.maximum(values, -limit), limit)
