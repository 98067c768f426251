"""A style machine as a source of motion: a sequence of states, or a random walk."""
from collections import deque

import numpy as np

from style_core.budgets import SEQUENCE_NUMBERS, SEQUENCE_S
from style_core.errors import ModelError, UsageError
from style_core.style_machine import StreamingSynthesizer
from style_core.synthesis.sources.source import COAST_S, TimedSource, coast_to_rest, hermite

__all__ = ['MachineSource', 'frames_of_occupancy', 'frames_of_states']


def frames_of_states(states, dwell_times, machine):
    """The state of every frame, shape (T,), for states (N,) that last ``dwell_times`` (N,), s.

    Raises
    ------
    UsageError
        If lengths differ, a state is unknown or a time is not positive.
    """
    states, dwell_times = np.asarray(states), np.asarray(dwell_times, dtype=float)
    if states.ndim != 1 or states.shape != dwell_times.shape or not len(states):
        raise UsageError(f'{states.size} states and {dwell_times.size} dwell times: as many of each, at least one')
    if not (np.isfinite(dwell_times).all() and (dwell_times > 0).all()):
        raise UsageError('dwell times must be positive')
    if dwell_times.sum() > SEQUENCE_S:
        raise UsageError(f'a sequence may last {SEQUENCE_S:g} s at most')
    wrong = [int(state) for state in states if not 0 <= state < machine.n_states]
    if wrong:
        raise UsageError(f'there is no state {wrong[0]}; states are 0 .. {machine.n_states - 1}')
    ends = np.round(np.cumsum(dwell_times) * machine.rate_hz).astype(int)
    return np.repeat(states, np.diff(ends, prepend=0))


def frames_of_occupancy(occupancy, step, machine):
    """Occupancies of every frame, shape (T, N), from rows (R, N) that are ``step`` seconds apart.

    Raises
    ------
    UsageError
        If the matrix does not fit the machine, or rows are not probabilities.
    """
    occupancy = np.asarray(occupancy, dtype=float)
    if occupancy.ndim != 2 or occupancy.shape[1] != machine.n_states or not len(occupancy):
        raise UsageError(f'occupancies of shape {occupancy.shape} for a machine of {machine.n_states} states')
    if not (np.isfinite(occupancy).all() and (occupancy >= 0).all()
            and np.allclose(occupancy.sum(axis=1), 1.0, atol=1e-3)):
        raise UsageError('every row of occupancies must be probabilities that sum to 1')
    if not (np.isfinite(step) and step > 0 and step * len(occupancy) <= SEQUENCE_S):
        raise UsageError(f'the step of occupancies must be positive, and {SEQUENCE_S:g} s at most altogether')
    if len(occupancy) * step * machine.rate_hz * machine.n_states > SEQUENCE_NUMBERS:
        raise UsageError(f'occupancies of {SEQUENCE_NUMBERS} numbers at most, at {machine.rate_hz:g} frames a second')
    times = np.arange(max(1, round(len(occupancy) * step * machine.rate_hz))) / machine.rate_hz
    row = np.clip(times / step - 0.5, 0, len(occupancy) - 1)
    low = np.minimum(row.astype(int), max(len(occupancy) - 2, 0))
    share = (row - low)[:, None]
    mixed = (1 - share) * occupancy[low] + share * occupancy[np.minimum(low + 1, len(occupancy) - 1)]
    return mixed / mixed.sum(axis=1, keepdims=True)


class MachineSource(TimedSource):
    """The most likely trajectory of a style machine, computed as it is needed.

    A change of style reaches the joints after what has been computed ahead: the window and ``lag`` frames.

    Parameters
    ----------
    machine : style_core.style_machine.StyleMachine
    visits : iterator, optional
        (state, stay) pairs, e.g. of `style_core.style_machine.random_walk`.
    frames : ndarray, optional
        Content of every frame instead, from `frames_of_states` or `frames_of_occupancy`.
    style : array_like, shape (K,), optional
        The generic style where left out.
    speed : float
    lag : int
        Frames of future that count.
    """

    def __init__(self, machine, visits=None, frames=None, style=None, speed=1.0, lag=20):
        super().__init__(speed)
        if (visits is None) == (frames is None):
            raise ModelError('a style machine needs either visits or frames to perform')
        self.joint_names = tuple(machine.joint_names)
        self.styles = {'generic': machine.style('generic'), **machine.styles}
        self.labels = tuple(f'style {k + 1}' for k in range(len(machine.style('generic'))))
        self._rate = machine.rate_hz
        self._target = machine.style('generic') if style is None else np.asarray(style, dtype=float)
        self._stream = StreamingSynthesizer(machine, self._target, lag=lag, source=visits)
        self._pushes = None if frames is None else iter(frames)
        self._total = np.inf if frames is None else len(frames)
        self._made = deque()
        self._first = 0      # number of the oldest frame kept
        self._tail = deque()
        self._end = None     # number of frames of the whole motion, once known
        self._fill(1)

    @property
    def style(self):
        """See `MotionSource.style`."""
        return self._made[0].v

    @property
    def target(self):
        """See `MotionSource.target`."""
        return self._target

    @property
    def state(self):
        """Most occupied state now."""
        return self._made[0].state

    @property
    def phase(self):
        """Part of a sequence that has been performed, [0, 1]; 0 on a random walk."""
        return float(min(self._content * self._rate / self._total, 1.0)) if np.isfinite(self._total) else 0.0

    @property
    def remaining(self):
        """See `MotionSource.remaining`."""
        if not np.isfinite(self._total):
            return np.inf
        left = max((self._total - 1) / self._rate + COAST_S - self._content, 0.0)
        return left / self.speed if self.speed > 0 else (np.inf if left else 0.0)

    def set_style(self, v, seconds):
        """See `MotionSource.set_style`."""
        v = np.asarray(v, dtype=float)
        if v.shape != self._target.shape or not np.isfinite(v).all():
            raise UsageError(f'a style of this model is {len(self._target)} finite numbers')
        self._stream.set_style(v, seconds)
        self._target = v

    def advance(self, dt):
        """See `MotionSource.advance`."""
        super().advance(dt)
        now = int(self._content * self._rate)
        self._fill(now)
        while self._first < now and len(self._made) > 2:
            self._made.popleft()
            self._first += 1

    def _course(self, ahead, content):
        self._fill(int(np.max(content, initial=0.0) * self._rate) + 1)
        times = (self._first + np.arange(len(self._made))) / self._rate
        positions = np.array([frame.positions for frame in self._made])
        velocities = np.array([frame.velocities for frame in self._made])
        here, slope = hermite(times, positions, velocities, np.clip(content, times[0], times[-1]))
        over = content > times[-1]
        if over.any():
            here[over], slope[over] = coast_to_rest(positions[-1], velocities[-1], content[over] - times[-1])
        return here, slope, np.zeros_like(slope)

    def _fill(self, number):
        """Compute frames up to ``number``, two at least."""
        while self._end is None and self._first + len(self._made) <= max(number, self._first + 1):
            frame = self._next()
            if frame is None:
                self._end = self._first + len(self._made)
                self._total = min(self._total, self._end)
                if not self._made:
                    raise UsageError('there is nothing to perform')
                if len(self._made) == 1:
                    self._made.append(self._made[0])
            else:
                self._made.append(frame)

    def _next(self):
        if self._pushes is None:
            return self._stream.step()
        while not self._tail:
            content = next(self._pushes, None)
            if content is None:
                self._pushes = iter(())
                self._tail.extend(self._stream.flush())
                return self._tail.popleft() if self._tail else None
            frame = self._stream.push(content)
            if frame is not None:
                return frame
        return self._tail.popleft()
