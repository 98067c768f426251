"""Values that change smoothly to wherever they are told to go, at any moment, also on the way."""
import numpy as np

from style_core.follow.playback import quintic

__all__ = ['Glide']

_POWERS = np.arange(6)


class Glide:
    """A number or vector on a quintic to its target; afterwards it stays there.

    Value, rate and acceleration are continuous, also where a new target comes before the old one is reached: the new
    quintic leaves from where the old one stands.

    Parameters
    ----------
    value : float or array_like, shape (N,)
    """

    def __init__(self, value):
        self._value = np.atleast_1d(np.asarray(value, dtype=np.float64)).copy()
        self._scalar = np.ndim(value) == 0
        self.target = self._value
        self._coefficients = None
        self._age = self._duration = 0.0

    @property
    def moving(self):
        """Whether the target is not reached yet."""
        return self._coefficients is not None

    def go(self, target, seconds):
        """Head for another target and reach it after ``seconds`` (at least a millisecond)."""
        seconds = max(float(seconds), 1e-3)
        state = [self._derivative(0.0, order) for order in range(3)]
        self.target = np.broadcast_to(np.asarray(target, dtype=np.float64), self._value.shape).copy()
        self._coefficients = quintic(seconds, *state, self.target, 0.0, 0.0)
        self._age, self._duration = 0.0, seconds

    def advance(self, dt):
        """Let ``dt`` seconds pass."""
        if self._coefficients is None:
            return
        self._age += dt
        if self._age >= self._duration:
            self._value, self._coefficients = self.target.copy(), None

    def at(self, ahead=0.0):
        """Values ``ahead`` seconds from now: shape of ``ahead`` (numbers), or that plus (N,)."""
        return self._shaped(ahead, self._derivative(np.asarray(ahead, dtype=float), 0))

    def rate(self, ahead=0.0):
        """Time derivative, per second; see `at`."""
        return self._shaped(ahead, self._derivative(np.asarray(ahead, dtype=float), 1))

    def integral(self, ahead):
        """Integral of the value from now to ``ahead`` seconds from now; see `at`."""
        ahead = np.asarray(ahead, dtype=float)
        if self._coefficients is None:
            return self._shaped(ahead, ahead[..., None] * self._value)
        within = np.minimum(self._age + ahead, self._duration)
        rest = (self._age + ahead - within)[..., None] * self.target
        return self._shaped(ahead, self._area(within) - self._area(np.float64(self._age)) + rest)

    def _area(self, time):
        return (time[..., None] ** (_POWERS + 1) / (_POWERS + 1)) @ self._coefficients.T

    def _derivative(self, ahead, order):
        ahead = np.asarray(ahead, dtype=float)
        if self._coefficients is None:
            return np.broadcast_to(self._value if order == 0 else np.zeros_like(self._value),
                                   ahead.shape + self._value.shape)
        time = (np.minimum(self._age + ahead, self._duration))[..., None]
        factor = np.ones(6)
        for k in range(order):
            factor = factor * np.maximum(_POWERS - k, 0)
        return (factor * time ** np.maximum(_POWERS - order, 0)) @ self._coefficients.T

    def _shaped(self, ahead, values):
        if not self._scalar:
            return values
        return float(values[0]) if np.ndim(ahead) == 0 else values[..., 0]
