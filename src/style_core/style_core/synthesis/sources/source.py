"""Where motion comes from: what every source can do, and the clock they share."""
from typing import Mapping, Protocol, Tuple

import numpy as np

from style_core.errors import UsageError
from style_core.follow.playback import quintic
from style_core.style_expression import evaluate_style
from style_core.synthesis.glide import Glide

__all__ = ['MotionSource', 'TimedSource', 'hermite', 'coast_to_rest', 'read_style']

#: a source whose motion ends comes to rest within this time, s
COAST_S = 0.3


class MotionSource(Protocol):
    """Something that moves joints; time runs on by `advance` only, `window` just looks ahead.

    Attributes
    ----------
    joint_names : tuple of str
    styles : mapping of str to ndarray, shape (K,)
        Styles with names; empty where the source has none.
    labels : tuple of str, length K
        What each style coordinate is called.
    ready : bool
        Whether it can say where the joints are.
    phase : float
        Of the performance; rad in [0, 2 pi), or [0, 1] for one with start and goal.
    remaining : float
        S until it comes to rest; infinite where it goes on for ever.
    """

    joint_names: Tuple[str, ...]
    styles: Mapping[str, np.ndarray]
    labels: Tuple[str, ...]
    ready: bool
    phase: float
    remaining: float

    def window(self, ahead):
        """Positions and velocities, shape (K, D) each, at the times ``ahead`` (s from now, increasing, >= 0)."""

    def advance(self, dt):
        """Let ``dt`` seconds pass."""

    def set_style(self, v, seconds):
        """Go over to the style coordinates ``v`` within ``seconds``."""

    def set_speed(self, speed, seconds):
        """Play at another speed (1 as learned, 0 stands still), reached within ``seconds``."""

    @property
    def style(self):
        """Style coordinates in force, shape (K,)."""

    @property
    def target(self):
        """Style coordinates approached, shape (K,)."""


class TimedSource:
    """A source with a clock of its own that runs at an adjustable speed: content time.

    Subclasses define ``_course(ahead, content)``: positions and their derivatives by content time and by real time
    (the part a changing style adds), each (K, D), at real times ahead and the content times that belong to them.
    """

    styles: Mapping[str, np.ndarray] = {}
    labels: Tuple[str, ...] = ()
    ready = True
    phase = 0.0
    remaining = np.inf

    def __init__(self, speed=1.0):
        self._speed = Glide(speed)
        self._content = 0.0

    @property
    def speed(self):
        """Content seconds a second, now."""
        return self._speed.at()

    @property
    def style(self):
        """See `MotionSource.style`."""
        return np.zeros(0)

    @property
    def target(self):
        """See `MotionSource.target`."""
        return np.zeros(0)

    def set_style(self, v, seconds):
        """Refuse: this source has no styles."""
        if len(v):
            raise UsageError('this motion has no styles')

    def set_speed(self, speed, seconds):
        """See `MotionSource.set_speed`."""
        if not (np.isfinite(speed) and speed >= 0):
            raise UsageError(f'the speed must be 0 or more, not {speed}')
        self._speed.go(speed, seconds)

    def window(self, ahead):
        """See `MotionSource.window`."""
        ahead = np.asarray(ahead, dtype=float)
        positions, by_content, by_time = self._course(ahead, self._content + self._speed.integral(ahead))
        return positions, by_content * self._speed.at(ahead)[:, None] + by_time

    def advance(self, dt):
        """See `MotionSource.advance`."""
        self._content += self._speed.integral(dt)
        self._speed.advance(dt)

    def _course(self, ahead, content):
        raise NotImplementedError


def hermite(times, positions, velocities, at):
    """Cubic Hermite interpolation between frames.

    Parameters
    ----------
    times : ndarray, shape (T,)
        Increasing, s.
    positions, velocities : ndarray, shape (T, D)
    at : ndarray, shape (K,)
        Within ``times``.

    Returns
    -------
    positions, velocities : ndarray, shape (K, D)
        The velocities are the exact derivative of the positions.
    """
    k = np.clip(np.searchsorted(times, at, side='right') - 1, 0, len(times) - 2)
    step = (times[k + 1] - times[k])[:, None]
    u = (at - times[k])[:, None] / step
    p0, p1, m0, m1 = positions[k], positions[k + 1], velocities[k] * step, velocities[k + 1] * step
    bend, rise = 2 * (p0 - p1) + m0 + m1, 3 * (p1 - p0) - 2 * m0 - m1
    return p0 + u * (m0 + u * (rise + u * bend)), (m0 + u * (2 * rise + 3 * u * bend)) / step


def coast_to_rest(position, velocity, seconds):
    """Positions and velocities, shape (K, D) each, at ``seconds`` (K,) >= 0 after a motion ended moving."""
    c = quintic(COAST_S, position, velocity, 0.0, position + 0.5 * COAST_S * velocity, 0.0, 0.0)
    time = np.minimum(seconds, COAST_S)[:, None]
    powers = np.arange(6)
    return time**powers @ c.T, (powers * time ** np.maximum(powers - 1, 0)) @ c.T


def read_style(source, text):
    """Style coordinates of an expression over the styles of a source, shape (K,).

    Raises
    ------
    UsageError
        If it cannot be read, or the source has no styles.
    """
    if not len(source.target):
        raise UsageError('this motion has no styles')
    return evaluate_style(text, source.styles, len(source.target))
