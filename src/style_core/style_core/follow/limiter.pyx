"""Joint command limiter: exact position, velocity and acceleration limits against the last emitted command.

Positions live on a lattice of 2^-40 rad (about 1e-12 rad), so every sum below is an integer sum. Doubles represent
lattice points exactly: differences of emitted commands are exact as well, and the limits hold without a tolerance.

With P the last command, W its last step (both in lattice units), S the largest step and A the largest change of step
in one tick, a next step w is allowed when

* ``|w| <= S``  (velocity),
* ``|w - W| <= A``  (acceleration),
* ``w + (w - A)+ + (w - 2A)+ + ...  <=  upper - P``, and the same downwards  (the command can still stop in time).

The sum in the last line is the way travelled when braking as hard as allowed, this tick included; ``reach`` inverts it
in closed form. The set of states (P, W) from which braking ends inside the limits is invariant: ``max(W - A, 0)`` is
allowed whenever (P, W) lies in it, so the allowed interval is never empty. docs/safety.md has the proof.
"""
import numpy as np

from libc.math cimport NAN, fabs, floor, isfinite, rint, sqrt

from style_core.errors import UsageError

__all__ = ['Limiter', 'PASS', 'CLAMP', 'REJECT', 'LATTICE']

#: Bands of one joint in one tick.
PASS, CLAMP, REJECT = 0, 1, 2
#: Resolution of emitted positions, rad.
LATTICE = 2.0 ** -40

cdef double SCALE = 2.0 ** 40
cdef double MAX_POSITION = 1000.0       # rad; keeps every sum of lattice units far inside 53 bits


cdef inline long long reach(long long gap, long long change) noexcept nogil:
    """Largest step z >= 0 after which braking by ``change`` a tick ends within ``gap`` (z itself included)."""
    cdef long long n
    if gap <= 0:
        return 0
    n = <long long>((sqrt(1.0 + 8.0 * (<double>gap / <double>change)) - 1.0) * 0.5)
    # the estimate may be off by one; change * n * (n + 1) / 2 <= gap < change * (n + 1) * (n + 2) / 2
    while change * ((n * (n + 1)) // 2) > gap:
        n -= 1
    while change * (((n + 1) * (n + 2)) // 2) <= gap:
        n += 1
    return (gap + change * ((n * (n + 1)) // 2)) // (n + 1)


cdef class Limiter:
    """Limit a stream of joint targets, one call a tick.

    Parameters
    ----------
    lower, upper : array_like, shape (D,)
        Position limits, rad.
    velocity, acceleration : array_like, shape (D,)
        Limits, rad/s and rad/s^2, of the emitted command: steps and changes of step over one tick.
    discontinuity : array_like, shape (D,)
        A target (brought inside the position limits) that jumps by more than this (rad) from one call to the next is
        rejected until it is back within this distance of the last command. A target that moves away faster than the
        limits allow, but without a jump, is followed as fast as they allow.
    period : float
        Time between two calls, s.

    Attributes
    ----------
    bands : ndarray of uint8, shape (D,)
        PASS where the last command is the target itself, CLAMP where a limit changed it, REJECT where the target was
        not finite or a discontinuity (the joint brakes).
    position, velocity : ndarray, shape (D,)
        The last command, rad and rad/s.

    Raises
    ------
    UsageError
        If a limit is not finite, not positive, empty, or too small for the period to resolve.
    """

    cdef readonly object bands, position, velocity, counts
    cdef readonly double period
    cdef long long[::1] _lower, _upper, _step, _change, _p, _w
    cdef double[::1] _jump, _position, _velocity, _target
    cdef unsigned char[::1] _bands
    cdef long long[::1] _counts
    cdef Py_ssize_t _n

    def __init__(self, lower, upper, velocity, acceleration, discontinuity, double period):
        arrays = [np.array(value, dtype=np.float64, ndmin=1)
                  for value in (lower, upper, velocity, acceleration, discontinuity)]
        lower, upper, velocity, acceleration, discontinuity = arrays
        if len({array.shape for array in arrays}) != 1 or lower.ndim != 1:
            raise UsageError(f'limits must have one value a joint, got shapes {[a.shape for a in arrays]}')
        if not (isfinite(period) and period > 0):
            raise UsageError(f'period must be positive, got {period}')
        for name, array in zip(('lower', 'upper'), (lower, upper)):
            if not np.all(np.abs(array) <= MAX_POSITION):      # also false for NaN
                raise UsageError(f'{name} position limits must lie within +-{MAX_POSITION:g} rad, got {array}')
        if not np.all(lower < upper):
            raise UsageError(f'lower limits must be below upper limits, got {lower} and {upper}')
        for name, array in zip(('velocity', 'acceleration', 'discontinuity'), arrays[2:]):
            if not (np.all(np.isfinite(array)) and np.all(array > 0)):
                raise UsageError(f'{name} limits must be finite and positive, got {array}')
        step = np.floor(np.minimum(velocity * period, MAX_POSITION) * SCALE)
        change = np.floor(np.minimum(acceleration * period * period, MAX_POSITION) * SCALE)
        if step.min() < 1 or change.min() < 1:
            raise UsageError(f'velocity and acceleration limits are too small for a period of {period} s')
        self.period = period
        self._n = lower.shape[0]
        self._lower = np.ceil(lower * SCALE).astype(np.int64)
        self._upper = np.floor(upper * SCALE).astype(np.int64)
        self._step = step.astype(np.int64)
        self._change = change.astype(np.int64)
        self._jump = discontinuity
        self._p = np.zeros(self._n, np.int64)
        self._w = np.zeros(self._n, np.int64)
        self.position = np.full(self._n, np.nan)
        self.velocity = np.zeros(self._n)
        self.bands = np.zeros(self._n, np.uint8)
        self.counts = np.zeros(3, np.int64)
        self._target = np.full(self._n, np.nan)      # of the last tick; NaN after a rejection
        self._position, self._velocity = self.position, self.velocity
        self._bands, self._counts = self.bands, self.counts

    def reset(self, position):
        """Start at rest from ``position`` (shape (D,), rad), for example the measured posture.

        A posture outside the limits is taken as it is: the joint may then only move inwards.
        """
        position = np.array(position, dtype=np.float64, ndmin=1)
        if position.shape != (self._n,) or not np.all(np.abs(position) <= MAX_POSITION):
            raise UsageError(f'the limiter needs {self._n} finite positions to start from, got {position}')
        lattice = np.rint(position * SCALE)
        self._p = lattice.astype(np.int64)
        self._w = np.zeros(self._n, np.int64)
        self.position[:] = lattice / SCALE
        self.velocity[:] = 0.0
        self._target[:] = self._position
        self.bands[:] = PASS

    def expect(self, double[::1] target):
        """Take it that the target (shape (D,), rad) has moved to here without a jump while no tick was made."""
        cdef Py_ssize_t i
        for i in range(self._n):
            self._target[i] = min(max(target[i], <double>self._lower[i] / SCALE), <double>self._upper[i] / SCALE)

    def step(self, double[::1] target, double[::1] target_velocity):
        """Move one tick towards a target that itself moves at ``target_velocity``.

        Parameters
        ----------
        target, target_velocity : ndarray of float64, shape (D,), contiguous
            Rad and rad/s at this tick.

        Returns
        -------
        position : ndarray, shape (D,)
            The command; the same array every call.
        """
        if target.shape[0] != self._n or target_velocity.shape[0] != self._n:
            raise UsageError(f'expected {self._n} joints, got {target.shape[0]} and {target_velocity.shape[0]}')
        self._advance(&target[0], &target_velocity[0])
        return self.position

    def brake(self):
        """Move one tick, every joint stopping as fast as its limits allow; returns the command as ``step`` does."""
        self._advance(NULL, NULL)
        return self.position

    def stop(self):
        """Where and when every joint would stand if it braked from now on.

        Returns
        -------
        position : ndarray, shape (D,)
            Rad, inside the limits like every command.
        duration : float
            S.
        """
        steps, change = np.asarray(self._w), np.asarray(self._change)
        n = np.abs(steps) // change
        way = n * np.abs(steps) - change * (n * (n + 1) // 2)
        return (np.asarray(self._p) + np.sign(steps) * way) / SCALE, float((n.max() + 1) * self.period)

    def foresee(self, targets, rates, Py_ssize_t least):
        """The commands that would come next: towards targets, then braking to a stand. Nothing of the limiter changes.

        Parameters
        ----------
        targets, rates : ndarray of float64, shape (N, D), contiguous
            As ``step`` would be given them, rad and rad/s; N may be 0.
        least : int
            So many commands at least, of which the last then stand still.

        Returns
        -------
        positions : ndarray, shape (K, D)
            Rad; every joint stands with the last of them.
        """
        cdef double[:, ::1] target = targets, rate = rates
        cdef Py_ssize_t k = 0, n = target.shape[0]
        if target.shape[1] != self._n or rate.shape[0] != n or rate.shape[1] != self._n:
            raise UsageError(f'expected {self._n} joints, got {targets.shape} and {rates.shape}')
        views = [np.asarray(self._p), np.asarray(self._w), np.asarray(self._target), self.position, self.velocity,
                 self.bands, self.counts]
        kept = [view.copy() for view in views]
        found = []
        while k < max(n, least, 1) or not self.stopped:
            if k < n:
                self._advance(&target[k, 0], &rate[k, 0])
            else:
                self._advance(NULL, NULL)
            found.append(self.position.copy())
            k += 1
        for view, was in zip(views, kept):
            view[:] = was
        return np.array(found)

    @property
    def stopped(self):
        """Whether every joint stands still."""
        cdef Py_ssize_t i
        for i in range(self._n):
            if self._w[i] != 0:
                return False
        return True

    cdef void _advance(self, double* target, double* rate) noexcept nogil:
        cdef Py_ssize_t i
        cdef long long p, w, up, down, wanted, gap, flow, r
        cdef double moved, inside
        cdef unsigned char band
        for i in range(self._n):
            p = self._p[i]
            w = self._w[i]
            up = min(min(w + self._change[i], self._step[i]), reach(self._upper[i] - p, self._change[i]))
            down = max(max(w - self._change[i], -self._step[i]), -reach(p - self._lower[i], self._change[i]))
            r = 0
            wanted = 0
            inside = 0.0
            band = 0
            if target != NULL:
                inside = min(max(target[i], <double>self._lower[i] / SCALE), <double>self._upper[i] / SCALE)
                # the distances are written so that NaN fails them (before the first reset, after a rejection)
                if isfinite(target[i]) and isfinite(rate[i]) and (
                        fabs(inside - self._position[i]) <= self._jump[i]
                        or fabs(inside - self._target[i]) <= self._jump[i]):
                    r = <long long>rint(inside * SCALE)
                    moved = rint(rate[i] * self.period * SCALE)
                    flow = <long long>max(min(moved, <double>self._step[i]), -<double>self._step[i])
                    gap = r - flow - p      # how far behind the moving target before this tick
                    wanted = flow + reach(gap, self._change[i]) - reach(-gap, self._change[i])
                else:
                    band = 2
            wanted = max(min(wanted, up), down)
            self._p[i] = p + wanted
            self._w[i] = wanted
            self._position[i] = <double>(p + wanted) / SCALE
            self._velocity[i] = <double>wanted / SCALE / self.period
            if band == 0 and target != NULL and (p + wanted != r or inside != target[i]):
                band = 1
            self._target[i] = self._position[i] if target == NULL else inside if band < 2 else NAN
            self._bands[i] = band
            self._counts[band] += 1
