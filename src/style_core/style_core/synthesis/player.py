"""Play a motion as a robot would publish it, with the faults that robots have; seeded, so every run is the same."""
from dataclasses import dataclass, field
from typing import Iterator, Optional, Tuple

import numpy as np

from style_core.errors import UsageError
from style_core.motion import matching_names

__all__ = ['STAMP_MODES', 'Faults', 'Sample', 'play', 'loop_cut']

STAMP_MODES = ('clock', 'zero', 'file')


@dataclass(frozen=True)
class Faults:
    """What goes wrong while a motion is played; nothing by default.

    Attributes
    ----------
    drop : tuple of str
        Patterns of joints whose sensors go dark (``'l*'``, ``'rfemur.*'``).
    drop_from, drop_until : float
        When, s after the start.
    drop_as_nan : bool
        Dark joints are published as NaN instead of being left out.
    drop_as_zero : bool
        Dark joints are published as 0, as an encoder does that has lost its signal.
    glitch : float
        Probability that one joint of a sample, any of them, is off by a normal number of radians.
    noise_std : float
        White noise on every joint, rad.
    jitter : float
        Share of the sample interval by which samples come late at random, stamps and all, in [0, 1).
    lose : float
        Probability that a sample is lost.
    gap_every, gap_length : float
        Every ``gap_every`` s nothing is published for ``gap_length`` s; 0 for no gaps.
    jump_at, jump_by : float
        From ``jump_at`` s on stamps are ``jump_by`` s off: a step of the robot's clock. No step where ``jump_by`` is 0.
    seed : int
    """

    drop: Tuple[str, ...] = ()
    drop_from: float = 0.0
    drop_until: float = float('inf')
    drop_as_nan: bool = False
    drop_as_zero: bool = False
    glitch: float = 0.0
    noise_std: float = 0.0
    jitter: float = 0.0
    lose: float = 0.0
    gap_every: float = 0.0
    gap_length: float = 0.0
    jump_at: float = 0.0
    jump_by: float = 0.0
    seed: int = 0

    def __post_init__(self):
        for name in ('drop_from', 'noise_std', 'gap_every', 'gap_length', 'jump_at'):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise UsageError(f'{name} must be finite and not negative, not {getattr(self, name)}')
        if not (0 <= self.jitter < 1 and 0 <= self.lose < 1 and 0 <= self.glitch < 1):
            raise UsageError('jitter, lose and glitch must lie in [0, 1)')
        if self.drop_as_nan and self.drop_as_zero:
            raise UsageError('dark joints are published as NaN or as 0, not both')
        if not self.drop_until >= self.drop_from:
            raise UsageError('drop_until must not come before drop_from')
        if not np.isfinite(self.jump_by):
            raise UsageError('jump_by must be finite')
        if self.gap_length and self.gap_length >= self.gap_every:
            raise UsageError('gap_length must be shorter than gap_every')


@dataclass(frozen=True, eq=False)
class Sample:
    """One message to publish.

    Attributes
    ----------
    due : float
        When to publish it, s after the start.
    stamp : float or None
        Its stamp, s after the start (mode ``'clock'``) or the recording's own time (``'file'``); None for a zero stamp.
    names : tuple of str
    positions : ndarray, shape (N,)
    truth : ndarray, shape (D,)
        All joints without faults.
    """

    due: float
    stamp: Optional[float]
    names: Tuple[str, ...]
    positions: np.ndarray
    truth: np.ndarray = field(repr=False)


def play(motion, faults=None, loop=False, speed=1.0, stamps='clock') -> Iterator[Sample]:
    """Samples of a motion in the order they are due.

    Parameters
    ----------
    motion : Motion
    faults : Faults, optional
    loop : bool
        Start again after the last sample, one sample interval later; for ever. Joints that turn on and on go on turning
        (see `loop_cut` for a cut at which nothing jumps).
    speed : float
        2 plays twice as fast.
    stamps : {'clock', 'zero', 'file'}
        Stamps count on while looping, are left zero, or are the recording's own (and jump back at every loop).

    Raises
    ------
    UsageError
        For an unknown stamp mode, a speed that is not positive or a motion of a single frame.
    MotionError
        For a pattern that names no joint.
    """
    faults = faults or Faults()
    if stamps not in STAMP_MODES:
        raise UsageError(f'stamps must be one of {", ".join(STAMP_MODES)}, not {stamps!r}')
    if not (np.isfinite(speed) and speed > 0):
        raise UsageError(f'speed must be positive, not {speed}')
    if motion.n_frames < 2:
        raise UsageError('a motion of fewer than two frames cannot be played')
    dropped = matching_names(motion.joint_names, faults.drop) if faults.drop else ()
    dark = np.array([name in dropped for name in motion.joint_names])
    return _samples(motion, faults, loop, speed, stamps, dark)


def _samples(motion, faults, loop, speed, stamps, dark):
    rng = np.random.default_rng(faults.seed)
    glitches = np.random.default_rng([faults.seed, 1])
    names = tuple(motion.joint_names)
    lit_names = tuple(name for name, out in zip(names, dark) if not out)
    times = (motion.times - motion.times[0]) / speed
    interval = float(np.median(np.diff(times)))
    round_trip = times[-1] + interval
    lap = 0
    while True:
        for frame in range(motion.n_frames):
            on_time = lap * round_trip + times[frame]
            # drawn for every sample, lost or not, so that one fault does not change another
            late, luck = rng.random(2)
            noise = rng.standard_normal(len(names))
            wrong, off = glitches.random(2), glitches.standard_normal()
            if faults.gap_every and on_time % faults.gap_every >= faults.gap_every - faults.gap_length:
                continue
            if luck < faults.lose:
                continue
            due = on_time + late * faults.jitter * interval
            truth = motion.positions[frame]
            positions = truth + faults.noise_std * noise
            if wrong[0] < faults.glitch:
                positions[int(wrong[1] * len(names))] += off
            own_names = names
            if faults.drop_from <= on_time < faults.drop_until and dark.any():
                if faults.drop_as_nan or faults.drop_as_zero:
                    positions[dark] = np.nan if faults.drop_as_nan else 0.0
                else:
                    own_names, positions = lit_names, positions[~dark]
            stamp = {'clock': due, 'zero': None, 'file': motion.times[frame]}[stamps]
            if stamp is not None and on_time >= faults.jump_at:
                stamp += faults.jump_by
            yield Sample(due, stamp, own_names, positions, truth)
        if not loop:
            return
        lap += 1


def loop_cut(motion, shortest_s=1.0, weight_s=0.1):
    """Cut a cyclic motion where its end meets its start best, so that it can be looped.

    The cut minimises the mean squared difference of pose and velocity (the latter times ``weight_s``) between the first
    frame and the frame after the last, over all cuts at least ``shortest_s`` long and at least half as long as the
    longest possible. Nothing is blended: what remains is a seam, and its size is returned.

    Parameters
    ----------
    motion : Motion
        Evenly sampled, no missing values.

    Returns
    -------
    cut : Motion
    seam : float
        RMS difference of the joints between the first frame and the one that would have followed the last, rad.

    Raises
    ------
    UsageError
        If the motion is too short or has missing values.
    """
    poses = motion.positions
    shortest = max(2, round(max(shortest_s, motion.duration_s / 2) * motion.rate_hz))
    if motion.n_frames < shortest + 2 or np.isnan(poses).any():
        raise UsageError(f'a motion of {motion.duration_s:.2f} s cannot be cut to a loop of at least {shortest_s} s '
                         f'(or it has missing values)')
    velocities = np.gradient(poses, axis=0) * motion.rate_hz
    features = np.concatenate([poses, weight_s * velocities], axis=1)
    features = features - features.mean(axis=0)
    squares = np.sum(features**2, axis=1)
    distance = squares[:, None] + squares[None, :] - 2 * features @ features.T
    start, stop = np.triu_indices(len(poses), k=shortest)
    best = np.argmin(distance[start, stop])
    start, stop = int(start[best]), int(stop[best])
    return (motion.slice(motion.times[start], motion.times[stop]),
            float(np.sqrt(np.mean((poses[stop] - poses[start])**2))))
