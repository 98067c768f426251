"""What motors cannot do is left out before it is sent: windows of trajectory within velocity and acceleration limits.

A joint that is asked for more than its motor gives is sent the nearest motion that it can perform: constant
acceleration between the points of the window, beginning where the window before says that the joint is by now and as
fast as it moves, and among these the one with the least

    sum over the points of  d^2 + RETURN_S^4 d''^2,        d = what is sent - what is asked for,

within the limits of velocity and acceleration. It looks ahead: a swing that is too fast begins early and stays
smaller. The quadratic programme is solved by alternating directions (Boyd et al. 2011, section 5.2), beginning from
the solution of the window before; a last pass from point to point makes the limits exact. Joints whose motors can do
what is asked for are left as they are.
"""
import numpy as np

from style_core.synthesis.nearest import obey, plan

__all__ = ['MotorLimits']

#: time in which a deviation is given up, s
RETURN_S = 0.04
#: fraction of the limits used: the rest is for a receiver that blends windows
SHARE = 0.97
_ITERATIONS, _TOLERANCE = 60, 3e-3
#: a deviation this small (rad; rad/s) is let fade where what is asked for can be done again
_NEAR, _NEAR_RATE = 3e-3, 0.06
#: and is nothing from here (rad)
_NOTHING = 1e-7
#: in place of no limit
_NO_LIMIT = 1e6


class _Grid:
    """Everything that depends only on the times of a window's points, shape (K,)."""

    def __init__(self, times):
        self.times, self.steps = times, np.diff(times)
        count = len(times)
        bend = (np.eye(count)[1:] - np.eye(count)[:-1]) / self.steps[:, None]
        self.way = np.zeros((count, count))     # way travelled, of the velocities at the points
        for k, step in enumerate(self.steps):
            self.way[k + 1] = self.way[k]
            self.way[k + 1, k:k + 2] += 0.5 * step
        self.stiff = RETURN_S**4 * bend.T @ bend
        own = (self.way.T @ self.way + self.stiff)[1:, 1:]
        rows = np.concatenate([np.eye(count)[1:], RETURN_S * bend])[:, 1:]
        inner = rows.T @ rows
        # the geometric mean of the extreme curvatures: the usual penalty for quadratic programmes
        curvature = np.linalg.eigvals(np.linalg.solve(inner, own)).real
        self.rho = float(np.sqrt(curvature.max() * max(curvature.min(), 1e-12 * curvature.max())))
        self.solve = np.ascontiguousarray(np.linalg.inv(own + self.rho * inner))

    def pull(self, positions, velocities, here, rate):
        """Gradient at zero velocity, shape (J, K - 1), of what is asked for, (J, K), from position and rate (J,)."""
        first = np.zeros_like(velocities)
        first[:, 0] = rate
        gap = here[:, None] + first @ self.way.T - positions
        return np.ascontiguousarray((gap @ self.way + (first - velocities) @ self.stiff)[:, 1:])


class MotorLimits:
    """Windows of one robot, kept within the limits of its motors; continuous from window to window.

    Parameters
    ----------
    lower, upper, velocity, acceleration : ndarray, shape (R,)
        Rad, rad/s, rad/s^2; infinite where there is no limit.
    """

    def __init__(self, lower, upper, velocity, acceleration):
        self._unlimited = not np.isfinite([velocity, acceleration]).any()
        self._velocity, self._acceleration = (np.minimum(SHARE * limit, _NO_LIMIT)
                                              for limit in (velocity, acceleration))
        self._lower, self._upper = (np.clip(limit, -_NO_LIMIT, _NO_LIMIT) for limit in (lower, upper))
        count = len(lower)
        self._grid, self._since = None, 0.0
        self._busy = np.zeros(0, dtype=int)                     # joints that cannot do what is asked for
        self._sent = self._rates = self._multipliers = np.zeros((0, 0))     # their plans
        self._gap, self._closing = np.zeros((2, count))         # of the others: a deviation that fades
        self._most = np.zeros(count)

    def advance(self, dt):
        """Let ``dt`` seconds pass."""
        self._since += dt

    @property
    def settled(self):
        """Whether what is sent is what is asked for, now."""
        return not len(self._busy) and not self._gap.any()

    def take_most(self):
        """The largest deviation of every joint since this was asked last, rad, shape (R,)."""
        most, self._most = self._most, np.zeros_like(self._most)
        return most

    def at(self, ahead, positions, velocities):
        """What the last window says for the times ``ahead`` (K,), s from now, where this is asked for, (K, R) each."""
        time = np.asarray(ahead) + self._since
        positions, velocities = self._faded(time, positions, velocities)
        if len(self._busy):
            positions, velocities = positions.copy(), velocities.copy()
            grid, time = self._grid, np.minimum(time + self._grid.times[0], self._grid.times[-1])
            k = np.clip(np.searchsorted(grid.times, time, side='right') - 1, 0, len(grid.steps) - 1)
            time = (time - grid.times[k])[:, None]
            before, after = self._rates[:, k].T, self._rates[:, k + 1].T
            rate = before + time / grid.steps[k][:, None] * (after - before)
            positions[:, self._busy] = self._sent[:, k].T + 0.5 * time * (before + rate)
            velocities[:, self._busy] = rate
        return positions, velocities

    def _faded(self, time, positions, velocities):
        """What is asked for, and what is left of earlier deviations ``time`` (K,) s after the last window."""
        if not (self._gap.any() or self._closing.any()):
            return positions, velocities
        fade, slope = np.exp(-time / RETURN_S)[:, None], self._closing + self._gap / RETURN_S
        value = self._gap + slope * time[:, None]
        return positions + value * fade, velocities + (slope - value / RETURN_S) * fade

    def window(self, ahead, positions, velocities):
        """The nearest window that the motors can perform.

        Parameters
        ----------
        ahead : ndarray, shape (K,)
            Times from now of the points, increasing, s; the first is as good as now.
        positions, velocities : ndarray, shape (K, R)
            What is asked for, within the limits of position.

        Returns
        -------
        positions, velocities : ndarray, shape (K, R)
        """
        if self._unlimited or len(ahead) < 2:
            return positions, velocities
        if self._grid is None:
            rate = np.clip(velocities[0], -self._velocity, self._velocity)
            here = positions[0]
        else:
            here, rate = (part[0] for part in self.at(np.zeros(1), positions[:1], velocities[:1]))
        grid, guess, multipliers = self._prepared(ahead, positions, velocities)
        gap, closing = here - positions[0], rate - velocities[0]
        bend = np.abs(np.diff(velocities, axis=0)) / grid.steps[:, None]
        busy = ((np.abs(velocities).max(axis=0) > self._velocity) | (bend.max(axis=0) > self._acceleration)
                | (np.abs(gap) > _NEAR) | (np.abs(closing) > _NEAR_RATE))
        self._since = 0.0
        self._most = np.maximum(self._most, np.abs(gap))
        nothing = busy | ((np.abs(gap) < _NOTHING) & (np.abs(closing) < _NOTHING / RETURN_S))
        self._gap, self._closing = np.where(nothing, 0.0, gap), np.where(nothing, 0.0, closing)
        self._busy = busy = np.flatnonzero(busy)
        sent, rates = self._faded(grid.times - grid.times[0], positions, velocities)
        if len(busy):
            self._plan(grid, positions[:, busy].T, velocities[:, busy].T, here[busy], rate[busy], guess[busy],
                       multipliers[busy])
            sent, rates = sent.copy(), rates.copy()
            sent[:, busy], rates[:, busy] = self._sent.T, self._rates.T
        return np.clip(sent, self._lower, self._upper), rates

    def _prepared(self, ahead, positions, velocities):
        """The grid of a window, and what the plans of the window before make of it."""
        count = len(self._lower)
        multipliers = np.zeros((count, 2 * len(ahead) - 2))
        guess = velocities[1:].T.copy()
        if self._grid is None or not np.array_equal(self._grid.times, ahead):
            self._grid, self._busy = _Grid(np.array(ahead, dtype=float)), np.zeros(0, dtype=int)
        elif len(self._busy):
            multipliers[self._busy] = self._multipliers
            time = np.minimum(ahead[1:] + self._since, ahead[-1])
            k = np.clip(np.searchsorted(ahead, time, side='right') - 1, 0, len(ahead) - 2)
            share = (time - ahead[k]) / self._grid.steps[k]
            guess[self._busy] = (1 - share) * self._rates[:, k] + share * self._rates[:, k + 1]
        return self._grid, guess, multipliers

    def _plan(self, grid, positions, velocities, here, rate, guess, multipliers):
        busy = self._busy
        limit_v, limit_a, lower, upper = (limit[busy] for limit in (self._velocity, self._acceleration, self._lower,
                                                                    self._upper))
        plan(grid.solve, grid.pull(positions, velocities, here, rate), grid.steps, rate, limit_v, limit_a, RETURN_S,
             grid.rho, _ITERATIONS, _TOLERANCE, guess, multipliers)
        self._sent, self._rates = np.zeros((2, *positions.shape))
        self._sent[:, 0], self._rates[:, 0], self._multipliers = here, rate, multipliers
        obey(grid.steps, guess, limit_v, limit_a, lower, upper, self._sent, self._rates)
