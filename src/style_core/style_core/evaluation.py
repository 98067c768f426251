"""How good a prediction is: running a predictor along a recording, and the scores of what it said.

Every protocol is a pure function of an `OnlinePredictor` and a recording; every score is a function of arrays
``mean``, ``std`` and ``actual`` with shape (T, H, D): T instants at which was predicted, H horizons, D channels.
NaN in ``actual`` (past the end of the recording, or never measured) is left out of every score.
"""
import time as clock
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from scipy.special import ndtr, ndtri

from style_core.errors import MotionError, UsageError
from style_core.text import did_you_mean

__all__ = ['FRAMES_AHEAD', 'RATE_HZ', 'Rollout', 'paper_horizons', 'future', 'roll_out', 'error_deg2', 'rms_deg',
           'coverage', 'log_score', 'crps_deg', 'phase_error_percent', 'event_phase_error_percent', 'mask_out',
           'random_sensors', 'random_bursts', 'disturbed_stamps', 'windows_clear_of', 'zero_velocity_of',
           'mean_pose_of', 'summary', 'verdict', 'bands_verdict']

#: G and the rate of Matsubara et al. 2012, section 4.1: errors are averaged over the next 25 frames at 60 Hz.
FRAMES_AHEAD = 25
RATE_HZ = 60.0


@dataclass(frozen=True, eq=False)
class Rollout:
    """What a predictor said along a recording.

    Attributes
    ----------
    joint_names : tuple of str
    times : ndarray, shape (T,)
        Instants at which was predicted, s.
    horizons : ndarray, shape (H,)
        S ahead of each instant.
    mean, std, actual : ndarray, shape (T, H, D)
        Rad; ``actual`` is NaN past the end of the recording, ``std`` where the predictor gives no band.
    filtered, filtered_std : ndarray, shape (T, D)
        Pose estimated at each instant, masked joints filled in, rad.
    present : ndarray, shape (T, D)
        Pose recorded at each instant, rad.
    observed : ndarray of bool, shape (T, D)
        What the predictor was shown.
    phase, phase_velocity, innovation, log_likelihood : ndarray, shape (T,)
    status : ndarray of int, shape (T,)
    update_s, predict_s : ndarray, shape (T,)
        Wall-clock time of each call (not reproducible, of course).
    """

    joint_names: tuple[str, ...]
    times: np.ndarray
    horizons: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    actual: np.ndarray
    filtered: np.ndarray
    filtered_std: np.ndarray
    present: np.ndarray
    observed: np.ndarray
    phase: np.ndarray
    phase_velocity: np.ndarray
    innovation: np.ndarray
    log_likelihood: np.ndarray
    status: np.ndarray
    update_s: np.ndarray
    predict_s: np.ndarray

    @property
    def complete(self):
        """Instants whose every horizon lies inside the recording (the paper's T), ndarray of bool, shape (T,)."""
        return np.isfinite(self.actual).any(axis=2).all(axis=1)

    def rows(self, keep):
        """Return the instants ``keep`` (mask or indices) as another `Rollout`."""
        per_instant = {name: getattr(self, name)[keep] for name in self.__dataclass_fields__
                       if name not in ('joint_names', 'horizons')}
        return replace(self, **per_instant)


def paper_horizons(frames=FRAMES_AHEAD, rate_hz=RATE_HZ):
    """Return the paper's horizons: 1 ... ``frames`` frames ahead, s, shape (frames,)."""
    return np.arange(1, frames + 1) / rate_hz


def future(motion, horizons):
    """What the recording holds ``horizons`` after each of its instants, linearly between frames.

    Parameters
    ----------
    motion : Motion
    horizons : ndarray, shape (H,)
        S, >= 0.

    Returns
    -------
    ndarray, shape (T, H, D)
        Rad; NaN past the end.
    """
    times, positions = motion.times, motion.positions
    wanted = times[:, None] + np.asarray(horizons, dtype=float)
    slack = 1e-6 * np.median(np.diff(times)) if len(times) > 1 else 0.0  # stamps are sums of rounded periods
    right = np.clip(np.searchsorted(times, wanted - slack), 0, len(times) - 1)
    left = np.maximum(right - 1, 0)
    gap = times[right] - times[left]
    share = np.where(gap > 0, (wanted - times[left]) / np.where(gap > 0, gap, 1.0), 1.0)
    share = np.where(np.abs(wanted - times[right]) <= slack, 1.0, share)[..., None]
    with np.errstate(invalid='ignore'):
        between = np.where(share == 1.0, positions[right], (1.0 - share) * positions[left] + share * positions[right])
    between[wanted > times[-1] + slack] = np.nan
    return between


def roll_out(predictor, motion, horizons, observed=None, reset=True):
    """Show a recording to a predictor frame by frame and keep everything it says.

    Parameters
    ----------
    predictor : OnlinePredictor
        Its ``joint_names`` must all be in the recording; the recording's others are not used.
    motion : Motion
    horizons : ndarray, shape (H,)
        S ahead.
    observed : ndarray of bool, shape (T, D), optional
        False where the predictor is not shown the value; D in the predictor's order.
    reset : bool, default True
        Forget everything before the first frame.

    Returns
    -------
    Rollout

    Raises
    ------
    MotionError
        If a joint is missing from the recording or a shape is wrong.
    """
    names = tuple(predictor.joint_names)
    column = {name: index for index, name in enumerate(motion.joint_names)}
    missing = [name for name in names if name not in column]
    if missing:
        raise MotionError(f'recording {motion.name!r} lacks joints the predictor needs: {", ".join(missing)}')
    horizons = np.asarray(horizons, dtype=float)
    take = [column[name] for name in names]
    present = motion.positions[:, take]
    n_frames, n_joints, n_horizons = len(present), len(names), len(horizons)
    shown = np.isfinite(present) if observed is None else np.asarray(observed, dtype=bool) & np.isfinite(present)
    if shown.shape != present.shape:
        raise MotionError(f'mask has shape {shown.shape}, the recording {present.shape}')
    mean = np.empty((n_frames, n_horizons, n_joints))
    std = np.empty_like(mean)
    filtered, filtered_std = np.empty_like(present), np.empty_like(present)
    scalars = np.empty((4, n_frames))
    status = np.empty(n_frames, dtype=int)
    spent = np.empty((2, n_frames))
    if reset:
        predictor.reset()
    for frame in range(n_frames):
        begin = clock.perf_counter()
        estimate = predictor.update(motion.times[frame], present[frame], shown[frame])
        middle = clock.perf_counter()
        prediction = predictor.predict(horizons)
        spent[:, frame] = middle - begin, clock.perf_counter() - middle
        mean[frame], std[frame] = prediction.mean, prediction.std
        filtered[frame], filtered_std[frame] = estimate.mean, estimate.std
        scalars[:, frame] = (estimate.phase, estimate.phase_velocity, estimate.innovation, estimate.log_likelihood)
        status[frame] = estimate.status
    actual = future(motion, horizons)[:, :, take]
    return Rollout(names, motion.times, horizons, mean, std, actual, filtered, filtered_std, present, shown, *scalars,
                   status, *spent)


# ---------------------------------------------------------------------------------------------- scores

def error_deg2(mean, actual):
    """The paper's on-line error E in degrees squared (Matsubara et al. 2012, section 4.1.2).

    Parameters
    ----------
    mean, actual : ndarray, shape (T, H, D)
        Rad. Only instants with every horizon inside the recording count.

    Returns
    -------
    float
        Mean over instants, horizons and channels of the squared error; NaN if no instant counts.
    """
    whole = np.isfinite(actual).any(axis=2).all(axis=1)
    if not whole.any():
        return float('nan')
    return float(np.nanmean(np.degrees(mean[whole] - actual[whole]) ** 2))


def rms_deg(mean, actual):
    """Root mean square error by horizon, degrees, shape (H,)."""
    return np.sqrt(_by_horizon(np.degrees(mean - actual) ** 2))


def coverage(mean, std, actual, level):
    """Share of values inside the central band that should hold ``level`` of them, by horizon, shape (H,).

    Parameters
    ----------
    mean, std, actual : ndarray, shape (T, H, D)
    level : float
        In (0, 1), e.g. 0.9.
    """
    if not 0.0 < level < 1.0:
        raise UsageError(f'a band has a level between 0 and 1, not {level}')
    reach = ndtri(0.5 + 0.5 * level)
    inside = np.where(np.isfinite(actual) & np.isfinite(std), np.abs(actual - mean) <= reach * std, np.nan)
    return _by_horizon(inside)


def log_score(mean, std, actual):
    """Mean log density of what happened under the Gaussian predicted, nats a channel (rad), by horizon, shape (H,)."""
    return _by_horizon(-0.5 * ((actual - mean) / std) ** 2 - np.log(std) - 0.5 * np.log(2.0 * np.pi))


def crps_deg(mean, std, actual):
    """Continuous ranked probability score of the Gaussian predicted, degrees, by horizon, shape (H,).

    Where a predictor gives no band (``std`` NaN or zero) the score is that of a point, the absolute error.
    """
    error = np.abs(actual - mean)
    banded = np.isfinite(std) & (std > 0)
    scale = np.where(banded, std, 1.0)
    z = error / scale
    density = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    gaussian = scale * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * density - 1.0 / np.sqrt(np.pi))
    return np.degrees(_by_horizon(np.where(banded, gaussian, error)))


def _by_horizon(values):
    count = np.isfinite(values).sum(axis=(0, 2))
    total = np.where(np.isfinite(values), values, 0.0).sum(axis=(0, 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def phase_error_percent(phase, reference, cycle=2.0 * np.pi):
    """Root mean square phase error in % of the cycle, the short way round.

    Parameters
    ----------
    phase, reference : ndarray, shape (T,)
        Both in the same units; NaN is left out.
    cycle : float
        Length of the cycle in those units.

    Returns
    -------
    float
    """
    turn = (np.asarray(phase) - np.asarray(reference)) / cycle
    turn = turn - np.round(turn)
    turn = turn[np.isfinite(turn)]
    return float(100.0 * np.sqrt(np.mean(turn ** 2))) if len(turn) else float('nan')


def event_phase_error_percent(phase_at_events, expected, cycle=2.0 * np.pi):
    """Root mean square distance of the phases found at repeated events (heel strikes) from where they belong.

    Parameters
    ----------
    phase_at_events : ndarray, shape (E,)
        Rad.
    expected : float
        Phase at which the event belongs, learned from other recordings, rad.
    """
    return phase_error_percent(phase_at_events, np.full(np.shape(phase_at_events), expected), cycle)


# ------------------------------------------------------------------------------- what a predictor is shown

def mask_out(joint_names, patterns, n_frames, first=0, last=None):
    """Mask that hides the joints matching ``patterns`` from frame ``first`` up to ``last``.

    Parameters
    ----------
    joint_names : sequence of str, length D
    patterns : sequence of str
        As in the shell, e.g. ``('rfemur.*', 'rtibia.*')``.
    n_frames : int
    first, last : int, optional

    Returns
    -------
    ndarray of bool, shape (n_frames, D)
        True where observed.

    Raises
    ------
    UsageError
        If a pattern matches no joint.
    """
    hit = np.zeros(len(joint_names), dtype=bool)
    for pattern in patterns:
        matched = np.array([fnmatchcase(name, pattern) for name in joint_names])
        if not matched.any():
            raise UsageError(f'no joint matches {pattern!r}; there are {", ".join(joint_names)}'
                             + did_you_mean(pattern.strip('!*'), joint_names))
        hit |= matched
    shown = np.ones((n_frames, len(joint_names)), dtype=bool)
    shown[first:last, hit] = False
    return shown


def random_sensors(joint_names, n_frames, n_hidden, seed):
    """Mask that hides ``n_hidden`` random channels throughout; shape (n_frames, D), True where observed."""
    rng = np.random.default_rng(seed)
    shown = np.ones((n_frames, len(joint_names)), dtype=bool)
    shown[:, rng.choice(len(joint_names), size=n_hidden, replace=False)] = False
    return shown


def random_bursts(joint_names, n_frames, share, length, seed):
    """Mask in which every channel drops out in bursts.

    Parameters
    ----------
    share : float
        Expected share of hidden values, in [0, 1).
    length : int
        Mean length of a burst, frames (geometric).
    seed : int

    Returns
    -------
    ndarray of bool, shape (n_frames, D)
        True where observed: a two-state Markov chain a channel, started from its stationary distribution.
    """
    rng = np.random.default_rng(seed)
    n_joints = len(joint_names)
    leave = 1.0 / length
    enter = leave * share / (1.0 - share)
    if not 0.0 <= share < 1.0 or enter > 1.0:
        raise UsageError(f'bursts of {length} frames cannot hide {share:.0%} of the values')
    draws = rng.random((n_frames, n_joints))
    hidden = np.empty((n_frames, n_joints), dtype=bool)
    hidden[0] = draws[0] < share
    for frame in range(1, n_frames):
        hidden[frame] = np.where(hidden[frame - 1], draws[frame] >= leave, draws[frame] < enter)
    return ~hidden


def disturbed_stamps(times, seed, jitter=0.0, dropped=0.0, late=0.0, reordered=0.0):
    """Which frames arrive, in which order, with which stamps, on a bad connection.

    Parameters
    ----------
    times : ndarray, shape (T,)
        S.
    seed : int
    jitter : float
        Sampling instants move by up to this share of the period, either way by half of it (0 ... 1).
    dropped : float
        Share of frames that never arrive.
    late : float
        Share of frames that arrive after the following frame, with their own (now past) stamp.
    reordered : float
        Share of places where two to four frames in a row arrive shuffled.

    Returns
    -------
    order : ndarray of int, shape (A,)
        Frame numbers in order of arrival.
    stamps : ndarray, shape (T,)
        The instant each frame was sampled at, s; the values must be taken at these instants (``Motion.at``).
    """
    rng = np.random.default_rng(seed)
    times = np.asarray(times, dtype=float)
    period = np.median(np.diff(times))
    stamps = times + jitter * period * (rng.random(len(times)) - 0.5)
    stamps = np.clip(stamps, times[0], times[-1])
    order = np.flatnonzero(rng.random(len(times)) >= dropped)
    place = np.arange(len(order), dtype=float)
    place[rng.random(len(order)) < late] += 1.5
    order = order[np.argsort(place, kind='stable')]
    for start in np.flatnonzero(rng.random(len(order)) < reordered):
        stop = min(start + int(rng.integers(2, 5)), len(order))
        order[start:stop] = rng.permutation(order[start:stop])
    return order, stamps


def windows_clear_of(times, horizons, seams):
    """Instants whose predictions do not reach over a seam; ndarray of bool, shape (T,).

    Parameters
    ----------
    times : ndarray, shape (T,)
        S.
    horizons : ndarray, shape (H,)
        S.
    seams : sequence of float
        Stamps of the first frame after each seam, s.
    """
    clear = np.ones(len(times), dtype=bool)
    for seam in seams:
        clear &= (times >= seam - 1e-9) | (times + np.max(horizons) < seam - 1e-9)
    return clear


# ---------------------------------------------------------------------------------------------- summary

def zero_velocity_of(rollout):
    """Predictions of 'hold still' for the same instants: the recorded pose held, shape (T, H, D)."""
    return np.broadcast_to(rollout.present[:, None, :], rollout.actual.shape)


def mean_pose_of(rollout):
    """Predictions of 'the mean pose of this very recording' for the same instants, shape (T, H, D).

    Nobody knows it beforehand; a prediction that is no better says nothing of the motion. On noise it is the best.
    """
    seen = np.isfinite(rollout.present)
    mean = np.where(seen, rollout.present, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return np.broadcast_to(mean, rollout.actual.shape)


def verdict(error, still, mean_pose):
    """What an error E (`error_deg2`) is worth beside those of holding still and of the constant mean pose, in words."""
    if not np.isfinite(error):
        return 'nothing could be scored'
    if not error < mean_pose:
        return 'no better than a constant pose'
    if not error < still:
        return 'no better than holding still'
    return f'{1 - error / min(still, mean_pose):.0%} better than either'


def bands_verdict(share, level=0.9, room=0.05):
    """What the share of values inside a band that promises ``level`` says of it, in words."""
    if not np.isfinite(share):
        return 'no band'
    return 'too narrow' if share < level - room else 'too wide' if share > level + room else 'honest'


def summary(rollout, levels=(0.5, 0.9)):
    """Report of one rollout as plain numbers, ready for JSON and for a table.

    Returns
    -------
    dict
        ``error_deg2`` (the paper's E), ``zero_velocity_error_deg2``, ``mean_pose_error_deg2``, ``horizons_s``
        and by horizon ``rms_deg``, ``zero_velocity_rms_deg``, ``crps_deg``, ``log_score``, ``coverage`` (level ->
        list);
        ``hidden_rms_deg`` (the filled-in values of what was hidden, NaN if nothing was), ``share_lost``,
        ``update_us`` and ``predict_us`` (median, 99th percentile), ``instants``.
    """
    mean, std, actual = rollout.mean, rollout.std, rollout.actual
    still = zero_velocity_of(rollout)
    hidden = ~rollout.observed & np.isfinite(rollout.present)
    wrong = np.degrees(rollout.filtered - rollout.present)[hidden]
    return {
        'instants': len(rollout.times),
        'error_deg2': error_deg2(mean, actual),
        'zero_velocity_error_deg2': error_deg2(still, actual),
        'mean_pose_error_deg2': error_deg2(mean_pose_of(rollout), actual),
        'horizons_s': rollout.horizons.tolist(),
        'rms_deg': rms_deg(mean, actual).tolist(),
        'zero_velocity_rms_deg': rms_deg(still, actual).tolist(),
        'crps_deg': crps_deg(mean, std, actual).tolist(),
        'log_score': log_score(mean, std, actual).tolist(),
        'coverage': {str(level): coverage(mean, std, actual, level).tolist() for level in levels},
        'hidden_rms_deg': float(np.sqrt(np.mean(wrong ** 2))) if wrong.size else float('nan'),
        'share_lost': float(np.mean(rollout.status == 2)),
        'update_us': [float(1e6 * np.percentile(rollout.update_s, q)) for q in (50, 99)],
        'predict_us': [float(1e6 * np.percentile(rollout.predict_s, q)) for q in (50, 99)],
    }
