"""Playing joint trajectories that arrive while others still play: interpolation and replacement without a jump.

A trajectory becomes a :class:`Track`, a piecewise polynomial. A new track takes over from the one that plays: the
difference between both at that moment is added to the new one and decays to zero along a
quintic. The sum is continuous in position, velocity and acceleration at every replacement, also while an earlier
difference is still decaying.

Ramping in from a held posture is another thing, because the motion may be far away and fast: a weight s goes from 0 to
1, and the reference is base + s (motion - base), where the base is the posture, brought to rest where it still moves.
It never leaves the way between posture and motion. With s a quintic in x = t / T, a motion within the limits V and A
and an initial difference of o (rad) and w (rad/s), speeds stay below

    max(s + x s') V + max s' o / T,

and accelerations grow likewise; T is chosen so that what o and w add is a given fraction of the limits.
"""
from dataclasses import dataclass

import numpy as np

from style_core.errors import MotionError
from style_core.follow.segments import (
    PEAK_ACCELERATION,
    PEAK_SPEED,
    add_decay,
    decay_between,
    evaluate,
    fade,
    fault_of,
    join,
    quintics,
)

__all__ = ['Track', 'make_track', 'Playback', 'quintic']

# largest 2 s' + x s'' of that step s(x): acceleration of a ramp onto a motion at unit speed
PEAK_CHASE = 4.6218
# a posture so near to the motion (rad, rad/s) is on it: the ramp may be shorter than asked
NEAR, SLOW = 0.02, 0.2
# differences in velocity and acceleration beyond so many limits are left to the limiter
CONTRADICTION = 2.0
# far beyond any joint, yet small enough that no polynomial overflows; points nearer in time are none (s)
ABSURD, CLOSEST_S = 1e9, 1e-6


@dataclass(frozen=True, eq=False)
class Track:
    """A piecewise polynomial of D joints.

    Attributes
    ----------
    knots : ndarray, shape (K + 1,)
        Increasing, s on the player's clock.
    coefficients : ndarray, shape (K, D, 6)
        Powers 0..5 of the time since the segment's first knot.
    start : float
        When the track takes over, s.
    coasts : bool
        Whether the last segment was added to bring a moving end to rest.
    """

    knots: np.ndarray
    coefficients: np.ndarray
    start: float
    coasts: bool = False

    @property
    def end(self):
        """When the track comes to rest, s."""
        return self.knots[-1]

    def at(self, time):
        """Position and velocity at ``time`` (s): two arrays of shape (D,), rad and rad/s."""
        position, velocity = np.empty((2, self.coefficients.shape[1]))
        evaluate(self.knots, self.coefficients, time, 0, position, velocity)
        return position, velocity


def quintic(duration, p0, v0, a0, p1, v1, a1):
    """Coefficients (..., 6) of the quintics between two states; all arguments broadcast (s, rad, rad/s, rad/s^2)."""
    duration, *states = np.broadcast_arrays(duration, p0, v0, a0, p1, v1, a1)
    coefficients = np.empty((*duration.shape, 6))
    quintics(np.array(duration, dtype=np.float64).ravel(), np.array(states, dtype=np.float64).reshape(6, -1),
             coefficients.reshape(-1, 6))
    return coefficients


def _slopes(times, positions):
    """Velocities for points that have none: no overshoot between points, zero at turning points and at the end."""
    steps = np.diff(times)[:, None]
    slopes = np.diff(positions, axis=0) / steps
    velocities = np.zeros_like(positions)
    if len(slopes) > 1:
        before, after = slopes[:-1], slopes[1:]
        w1, w2 = 2 * steps[1:] + steps[:-1], steps[1:] + 2 * steps[:-1]
        same = before * after > 0
        # weighted harmonic mean (Fritsch and Butland 1984)
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            mean = (w1 + w2) / (w1 / before + w2 / after)
        velocities[1:-1] = np.where(same, mean, 0.0)
    return velocities


def _lead_in(wait, position, velocity, current, coast, within, shortest):
    """Times (from the track's start), positions and velocities of what comes before a track's first point."""
    if wait >= shortest:
        # a cubic that begins faster than this overshoots (Fritsch and Carlson 1980); the rest decays in taking over
        most = 3.0 * (position - current[0]) / wait
        begin = np.clip(current[1], np.minimum(most, 0.0), np.maximum(most, 0.0))
        way = np.empty((1, len(position), 6))
        join(np.array([0.0, wait]), np.array([current[0], position]), np.array([begin, velocity]), None, 0.0, way)
        way = way[0]
        bend = 2.0 * np.abs([way[:, 2], way[:, 2] + 3.0 * wait * way[:, 3]])        # linear: largest at an end
        if np.all(np.abs(position - current[0]) <= within[0] * wait) and np.all(bend.max(axis=0) <= within[1]):
            return np.zeros(1), current[0], begin
    if wait <= coast:
        return np.zeros(1), position - wait * velocity, velocity
    rest = np.tile(position - 0.5 * coast * velocity, (2, 1))
    return np.array([0.0, wait - coast]), rest, np.zeros_like(rest)


def make_track(times, positions, velocities=None, accelerations=None, *, start, now, current, coast=0.1,
               within=(np.inf, np.inf), shortest=0.0):
    """Turn trajectory points into a track.

    Parameters
    ----------
    times : array_like, shape (K,)
        Strictly increasing, s on the player's clock.
    positions : array_like, shape (K, D)
        Rad.
    velocities, accelerations : array_like, shape (K, D), optional
        With velocities the segments are cubics, with accelerations as well quintics. Without velocities they are
        cubics that do not overshoot between points.
    start : float
        When the track takes over; before the first point it moves there from ``current``.
    now : float
    current : pair of ndarray, shape (D,)
        Position and velocity when the track takes over.
    coast : float
        A track that ends moving comes to rest in this time, s.
    within : pair of array_like, shape (D,)
        Mean speed and acceleration that the way from ``current`` to the first point may need. Where it needs more, the
        track comes instead as if it had been at the speed of its first point before, or, where that lies more
        than ``coast`` ahead, from rest: what takes over then has to bridge the difference.
    shortest : float
        The same where the first point is closer than this, s.

    Raises
    ------
    MotionError
        If a shape is wrong, a value is not finite, times do not increase, or everything lies in the past.
    """
    times, positions, velocities, accelerations = (
        None if array is None else np.ascontiguousarray(array, dtype=np.float64)
        for array in (times, positions, velocities, accelerations))
    if positions.ndim != 2 or times.shape != positions.shape[:1] or not times.size:
        raise MotionError(f'times {times.shape} and positions {positions.shape} do not fit together')
    for name, array in (('velocities', velocities), ('accelerations', accelerations)):
        if array is not None and array.shape != positions.shape:
            raise MotionError(f'{name} {array.shape} do not fit positions {positions.shape}')
    fault = fault_of(times, positions, velocities, accelerations, ABSURD, CLOSEST_S)
    if fault == 'order':
        raise MotionError('times of the points do not increase (at least 1 microsecond apart)')
    if fault:
        raise MotionError(f'{fault} contain a value that is not finite or absurdly large')
    if times[-1] <= now:
        raise MotionError(f'the trajectory ended {now - times[-1]:.3f} s ago')
    if velocities is None:
        accelerations = None
        velocities = None if len(times) == 1 else _slopes(times, positions)
    velocities = np.zeros_like(positions) if velocities is None else velocities
    if times[0] > start + 1e-6:
        lead = _lead_in(times[0] - start, positions[0], velocities[0], current, coast, within, shortest)
        times = np.concatenate([start + lead[0], times])
        positions, velocities = np.vstack([lead[1], positions]), np.vstack([lead[2], velocities])
        if accelerations is not None:
            accelerations = np.vstack([np.zeros_like(lead[1]), accelerations])
    if len(times) == 1:
        # one point that lies at the start itself
        times, positions = np.array([times[0] - 1e-3, times[0]]), np.vstack([positions, positions])
        velocities, accelerations = np.vstack([np.zeros_like(velocities), velocities]), None
    coasts = bool(velocities[-1].any())
    coefficients = np.empty((len(times) - 1 + coasts, positions.shape[1], 6))
    join(times, positions, velocities, accelerations, coast, coefficients)
    if coasts:
        knots = np.empty(len(times) + 1)
        knots[:-1], knots[-1] = times, times[-1] + coast
        times = knots
    return Track(times, coefficients, float(start), coasts)


class Playback:
    """The reference position and velocity at each tick.

    Parameters
    ----------
    n_joints : int
    velocity, acceleration : array_like, shape (D,)
        Limits of the joints; a difference between two tracks decays within them where it can.

    Attributes
    ----------
    position, velocity : ndarray, shape (D,)
        The reference of the last ``sample``; the same arrays every call.
    """

    def __init__(self, n_joints, velocity, acceleration):
        self.position, self.velocity = np.zeros((2, n_joints))
        self._limits = np.asarray(velocity, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
        self._track = None
        self._hint = 0
        self._decay = self._standing = None
        self._decay_start = self._decay_end = self._ramp_start = self._ramp_end = -np.inf

    @property
    def end(self):
        """When the playing track comes to rest, s; -inf when none plays."""
        return -np.inf if self._track is None else max(self._track.end, self._decay_end, self._ramp_end)

    @property
    def ends_moving(self):
        """Whether the points of the playing track end moving, so that it wants a successor."""
        return self._track is not None and self._track.coasts

    def hold(self, position):
        """Forget every track and stand at ``position`` (shape (D,), rad)."""
        self._track = None
        self._decay_end = self._ramp_end = -np.inf
        self.position[:] = position
        self.velocity[:] = 0.0

    def jump(self, track, time):
        """Difference in position and velocity (shape (D,) each) between what plays and ``track`` at ``time``.

        Without what is still decaying: this is by how much one sender contradicts the one before.
        """
        before = (self.position, self.velocity) if self._track is None else self._track.at(time)
        after = track.at(time)
        return before[0] - after[0], before[1] - after[1]

    def ramp_in(self, track, time, shortest, speed, position, velocity, rest):
        """Play ``track`` from now on, ramping in from a posture instead of from what played.

        Parameters
        ----------
        track : Track
        time : float
            Now, s.
        shortest : float
            Of the ramp, s, unless the posture is on the track already.
        speed : float
            Fraction of the velocity and acceleration limits that the difference may add.
        position, velocity : ndarray, shape (D,)
            The posture, rad, and the rad/s at which it still moves.
        rest : ndarray, shape (D,)
            Where it would come to rest, rad.

        Returns
        -------
        duration : float
            Of the ramp, s.
        """
        self.hold(position)
        offset, drift = (np.abs(here - there) for here, there in zip((position, velocity), track.at(time)))
        limit_v, limit_a = (speed * limit for limit in self._limits)
        # a motion faster than the limits is not followed at its speed anyway
        chase = PEAK_CHASE * np.minimum(drift, self._limits[0]) / limit_a
        duration = float(np.max(np.maximum(
            PEAK_SPEED * offset / limit_v,
            0.5 * (chase + np.sqrt(chase**2 + 4.0 * PEAK_ACCELERATION * offset / limit_a)))))
        if np.any(offset > NEAR) or np.any(drift > SLOW):
            duration = max(duration, shortest)
        way = rest - position
        with np.errstate(divide='ignore', invalid='ignore'):
            braking = np.where(way * velocity > 0, 2.0 * way / velocity, 0.0)
        self._standing = np.array([position, velocity, braking])
        self._ramp_start, self._ramp_end = time, time + duration
        self._track, self._hint = track, 0
        return duration

    def take_over(self, track, time, shortest):
        """Play ``track`` from now on; what differs from what played decays.

        Parameters
        ----------
        track : Track
        time : float
            Now, s.
        shortest : float
            A difference takes at least this long to decay, s.

        Returns
        -------
        duration : float
            Of the decay, s.
        """
        decay = np.empty((len(self.position), 6))
        old = None if self._track is None else (self._track.knots, self._track.coefficients)
        fading = self._decay if time < self._decay_end else None
        duration = decay_between(old, (track.knots, track.coefficients), time, fading, time - self._decay_start,
                                 self._decay_end - time, self.position, self.velocity, *self._limits, CONTRADICTION,
                                 shortest, decay)
        self._decay = decay
        self._decay_start, self._decay_end = time, time + duration
        self._track, self._hint = track, 0
        return duration

    def source(self, time):
        """What is played at ``time`` (s) before ramping in: the attributes position and velocity, rewritten."""
        if self._track is not None:
            self._hint = evaluate(self._track.knots, self._track.coefficients, time, self._hint,
                                  self.position, self.velocity)
            if time < self._decay_end:
                add_decay(self._decay, time - self._decay_start, self.position, self.velocity)
        return self.position, self.velocity

    def sample(self, time):
        """Position and velocity of the reference at ``time`` (s): the attributes of these names, rewritten."""
        self.source(time)
        if time < self._ramp_end:
            fade(self._standing, time - self._ramp_start, self._ramp_end - self._ramp_start,
                 self.position, self.velocity)
        return self.position, self.velocity

    def preview(self, times):
        """Positions and velocities of the reference at later times (N,), s, if nothing new comes: (N, D) each."""
        found = np.empty((2, len(times), len(self.position)))
        for k, time in enumerate(times):
            found[:, k] = self.sample(time)
        return found
