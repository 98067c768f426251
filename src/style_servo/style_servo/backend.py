"""What the bridge asks of a back end, whatever moves the joints."""
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

__all__ = ['Backend', 'BackendFault', 'Coming', 'Measurement']


class BackendFault(RuntimeError):
    """The motors cannot be driven any further; the message names the joint or port, the cause and what to do.

    Attributes
    ----------
    connection_lost : bool
        Whether the way to the motors is gone, or somebody else has them, so that nothing may be sent any more.
    """

    def __init__(self, message, connection_lost=False):
        super().__init__(message)
        self.connection_lost = connection_lost


@dataclass(eq=False)
class Measurement:
    """What the joints do. Arrays of shape (D,); NaN where nothing is known.

    Attributes
    ----------
    position, velocity : ndarray
        Rad, rad/s.
    effort : ndarray
        Motor current in A; for servos that report a load, that load from -1 to 1; for ros2_control its effort.
    temperature, voltage : ndarray
        Deg C and V, refreshed slowly.
    fresh : bool
        Whether the last exchange brought new positions.
    """

    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    temperature: np.ndarray
    voltage: np.ndarray
    fresh: bool = False

    @classmethod
    def unknown(cls, n):
        """Nothing known about n joints."""
        return cls(*np.full((5, n), np.nan))


class Coming(NamedTuple):
    """What comes after a command, for back ends that can send it ahead.

    Attributes
    ----------
    time : float
        Which the command is for, s on the monotonic clock.
    plan : callable
        ``plan(ahead)`` gives the trajectory through the last commands, the next ``ahead`` s of them, and on to a stand:
        times (N,), s on the monotonic clock, positions and velocities (N, D), to be joined by cubics.
    """

    time: float
    plan: object


class Backend(Protocol):
    """A way to the motors.

    ``statistics`` is a dict of counters for diagnostics, ``notes`` a list of warnings found while connecting, ``facts``
    a dict of what was found then, ``warnings`` a list of what is about to stop a motor. One whose commands need a while
    to reach the motors has a ``lead``: commands are made so long before their time, s.
    """

    measurement: Measurement
    statistics: dict
    notes: list
    facts: dict
    warnings: list

    def connect(self):
        """Open, check and configure everything; torque is off afterwards. Raises BackendFault or UsageError."""

    def enable(self):
        """Torque on at the posture the joints are in, without motion; refreshes the measurement."""

    def exchange(self, position, velocity, coming):
        """Send one command (shape (D,), rad and rad/s) and read the joints back into ``measurement``.

        ``coming`` is a :class:`Coming`.

        A single lost or damaged packet is counted and leaves ``measurement.fresh`` false; what cannot go on raises
        BackendFault.
        """

    def observe(self):
        """Read the joints back without commanding them (torque is off); errors as in exchange."""

    def disable(self):
        """Torque off, as far as the motors can still be reached. Never raises; returns whether it succeeded."""

    def close(self):
        """Torque off and let go of the motors. Never raises."""
