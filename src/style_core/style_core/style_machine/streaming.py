"""Synthesis one frame at a time: the batch system eliminated as frames come, looked back on with a fixed lag."""
from collections import deque
from dataclasses import dataclass

import numpy as np

from style_core.errors import ModelError, UsageError
from style_core.style_machine import _trajectory
from style_core.style_machine.emission import Emission, interpolate
from style_core.style_machine.trajectory import Information, information, mix

__all__ = ['Frame', 'StreamingSynthesizer']


@dataclass(frozen=True, eq=False)
class Frame:
    """One synthesised frame.

    Attributes
    ----------
    time : float
        Since the first frame, s.
    positions : ndarray, shape (D,)
        Rad, in the order of the machine's ``joint_names``.
    velocities : ndarray, shape (D,)
        Rad/s.
    state : int
        The most occupied state.
    v : ndarray, shape (K,)
        Style coordinates in force.
    """

    time: float
    positions: np.ndarray
    velocities: np.ndarray
    state: int
    v: np.ndarray


class StreamingSynthesizer:
    """Yield the most likely trajectory one frame at a time, ``lag`` frames behind the newest content.

    All past frames count exactly; of the future only the next ``lag`` frames do. The difference from the batch
    solution falls exponentially with the lag.

    Parameters
    ----------
    machine : StyleMachine
    style : str or ndarray, optional
    lag : int
        Frames, at least 1.
    source : iterator of (int, float), optional
        Visits (state, stay in units of the style's dwell time), e.g. `choreography.random_walk` or
        ``iter(choreography.sequence(...))``; drawn on by `step`.

    Examples
    --------
    >>> stream = StreamingSynthesizer(machine, 'walk', source=random_walk(machine, seed=1))  # doctest: +SKIP
    >>> for _ in range(600):                                                                 # doctest: +SKIP
    ...     frame = stream.step()
    >>> stream.set_style('1.5*walk - 0.5*run', seconds=1.0)                                  # doctest: +SKIP
    """

    def __init__(self, machine, style='generic', lag=40, source=None):
        if lag < 1:
            raise UsageError(f'the lag must be at least 1 frame, got {lag}')
        self.machine, self.lag = machine, int(lag)
        self._v_from = self._v_to = machine.style(style)
        self._from = self._to = machine.at(self._v_to)
        self._table = information(self._to)
        self._ramp, self._ramp_frames = 0, 0
        c = machine.coordinates
        self._to_joints = c.basis.T / c.weights
        self._q, self._m = c.leading, len(c.joint_names) - c.leading
        size = self.lag + 2
        q, m = self._q, self._m
        self._w, self._h = np.zeros((size, q, q)), np.zeros((size, q))
        self._w_tail, self._h_tail = np.zeros((size, m)), np.zeros((size, m))
        self._s, self._r, self._s_tail, self._r_tail = np.zeros((q, q)), np.zeros(q), np.zeros(m), np.zeros(m)
        self._low, self._x, self._out = np.empty((q, q)), np.empty(q), np.empty((2, q + m))
        self._last_output = None
        self.source = source
        self.reset()

    def reset(self):
        """Forget all content; the style stays. The next frame starts a new motion at time 0."""
        self._pushed, self._yielded = 0, 0
        self._labels = deque()
        self._visit, self._left, self._carry = None, 0, 0.0
        self._last_output = self._near = None

    @property
    def v(self):
        """Style coordinates in force for the newest frame."""
        share = self._share()
        return (1 - share) * self._v_from + share * self._v_to

    def _share(self):
        return min(self._ramp / self._ramp_frames, 1.0) if self._ramp_frames else 1.0

    def set_style(self, style, seconds=0.5):
        """Go over to another style within ``seconds``; the motion stays continuous.

        Computes the new style's tables at once (some milliseconds); frames cost the same as before.

        Raises
        ------
        UsageError
            If the style cannot be read; the old one stays then.
        """
        v = self.machine.style(style)
        if seconds < 0:
            raise UsageError(f'a change of style takes 0 s or more, got {seconds}')
        emission = self.machine.at(v)
        share = self._share()  # below 1 when changing again on the way: leave from where the blend stands
        self._from = interpolate(self._from, self._to, share) if share < 1.0 else self._to
        self._v_from, self._v_to, self._to = self.v, v, emission
        self._table = information(emission)
        self._ramp, self._ramp_frames = 0, round(seconds * self.machine.rate_hz)

    def _coefficients(self, content):
        """Coefficients of one frame for a state or occupancies.

        While the style changes, means and covariances are interpolated; weighted sums of two styles' coefficients
        would meet where their flat Gaussians intersect, which may be far from both.
        """
        share, table = self._share(), self._table
        used = np.array([content]) if np.ndim(content) == 0 else np.flatnonzero(content > 1e-6)
        if share < 1.0:
            table = information(interpolate(_states(self._from, used), _states(self._to, used), share))
            place = np.arange(len(used))
        else:
            place = used
        if np.ndim(content) == 0:
            return table, int(place[0])
        weights = content[used] / content[used].sum()
        return mix(Information(*(array[place] for array in vars(table).values())), weights[None]), 0

    def push(self, content):
        """Take the content of one more frame.

        Parameters
        ----------
        content : int or ndarray, shape (N,)
            A state, or occupancies that sum to 1.

        Returns
        -------
        Frame or None
            The frame ``lag`` frames back; None until there is one.
        """
        content = np.asarray(content)
        if content.ndim == 0:
            if not 0 <= content < self.machine.n_states:
                raise ModelError(f'there is no state {content}; states are 0 .. {self.machine.n_states - 1}')
            content, label = int(content), int(content)
        else:
            if content.shape != (self.machine.n_states,) or not np.isfinite(content).all() or (content < 0).any() \
                    or abs(content.sum() - 1) > 1e-6:
                raise ModelError(f'occupancies must be {self.machine.n_states} numbers >= 0 that sum to 1')
            label = int(content.argmax())
        k, i = self._coefficients(content)
        if self._pushed == 0:
            self._s[:], self._r[:] = k.first[i], k.first_ahead[i]
            self._s_tail[:], self._r_tail[:] = k.first_tail[i], k.first_ahead_tail[i]
        elif _trajectory.push_frame(
                self._s, self._r, self._s_tail, self._r_tail, k.own[i], k.cross[i], k.previous[i], k.ahead[i],
                k.behind[i], k.own_tail[i], k.cross_tail[i], k.previous_tail[i], k.ahead_tail[i], k.behind_tail[i],
                self._w, self._h, self._w_tail, self._h_tail, self._pushed % len(self._h), self._low):
            raise ModelError('the trajectory is not determined: a covariance is singular')
        self._labels.append((label, self.v))
        self._pushed += 1
        if self._ramp < self._ramp_frames:
            self._ramp += 1
        return self._look_back(self.lag) if self._pushed > self.lag else None

    def flush(self):
        """The frames still behind, as the motion ends here; then `reset`."""
        frames = []
        while self._yielded < self._pushed:
            frames.append(self._look_back(self._pushed - 1 - self._yielded))
        self.reset()
        return frames

    def _look_back(self, steps):
        _trajectory.look_back(self._s, self._r, self._s_tail, self._r_tail, self._w, self._h, self._w_tail,
                              self._h_tail, (self._pushed - 1) % len(self._h), steps, self._low, self._x, self._out)
        here, after = self._out
        c = self.machine.coordinates
        positions = here @ self._to_joints + c.reference
        if steps and self._last_output is not None:
            change = 0.5 * (after - self._last_output)
        elif steps:
            change = after - here
        else:
            change = here - self._last_output if self._last_output is not None else np.zeros_like(here)
        velocities = change @ self._to_joints * c.rate_hz
        if self.machine.space is not None:
            positions, velocities = self.machine.space.decode(positions, self._near, velocity=velocities)
            self._near = positions
        self._last_output = here.copy()
        label, v = self._labels.popleft()
        frame = Frame(self._yielded / c.rate_hz, positions, velocities, label, v)
        self._yielded += 1
        return frame

    def step(self):
        """Draw content from ``source`` until one more frame is ready; None when the source has ended and all is out."""
        while True:
            while self._left == 0:
                visit = None if self.source is None else next(self.source, None)
                if visit is None:
                    if self._yielded < self._pushed:
                        return self._look_back(self._pushed - 1 - self._yielded)
                    return None
                state, stay = visit
                share = self._share()
                dwell = (1 - share) * self._from.dwell[state] + share * self._to.dwell[state]
                exact = stay * dwell + self._carry
                self._left = max(round(exact), 0)
                self._carry = exact - self._left
                self._visit = int(state)
            self._left -= 1
            frame = self.push(self._visit)
            if frame is not None:
                return frame


def _states(emission, used):
    """An emission of some states only."""
    return Emission(emission.pose, *(getattr(emission, name)[used] for name in
                                     ('positions', 'velocities', 'covs', 'tails', 'dwell')))
