"""Learning a phase-style model: alignment, bases by SVD, one Gaussian process a basis (Matsubara et al. 2012)."""
import re
from dataclasses import dataclass

import numpy as np

from style_core.alignment import cycle_shift, fit_cycle, harmonic_design, period, refine_phase
from style_core.errors import MotionError
from style_core.phase_style.channel import NOISE_FLOOR
from style_core.phase_style.gaussian_process import fit_process
from style_core.phase_style.model import Behaviour

__all__ = ['Sequence', 'Aligned', 'align_rhythmic', 'align_discrete', 'factorise', 'choose_dimension', 'learn',
           'group_of', 'speeds_of', 'speed_statistics', 'split_gaits']

HARMONICS = 6
SAMPLES = 100


@dataclass(frozen=True, eq=False)
class Sequence:
    """An equidistant training sequence: ``y`` (T, D) rad without gaps, at ``rate_hz``."""

    name: str
    group: str
    y: np.ndarray
    rate_hz: float


@dataclass(frozen=True, eq=False)
class Aligned:
    """Sequences with a common phase.

    Attributes
    ----------
    phases : list of ndarray, shape (T_s,)
        Unwrapped phase of every frame.
    cycles : ndarray, shape (S, C, D)
        Each sequence's motion at the grid phases (eq. 5).
    grid : ndarray, shape (C,)
    acceleration : float
        Estimated density of the phase acceleration.
    """

    phases: list
    cycles: np.ndarray
    grid: np.ndarray
    acceleration: float


def group_of(name):
    """Person behind a sequence: the part of its file name before the first ``_`` or ``-`` (``35_01`` -> ``35``)."""
    return re.split(r'[_-]', name, maxsplit=1)[0]


def _correlation_length(residual):
    """Frames over which a residual repeats itself: 1 + 2 sum of positive auto-correlations, pooled over channels."""
    residual = residual - residual.mean(axis=0)
    power = np.sum(residual ** 2)
    if power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, len(residual) // 2):
        correlation = np.sum(residual[:-lag] * residual[lag:]) / power
        if correlation <= 0:
            break
        total += 2 * correlation
    return total


def _refine(sequences, phases, fits, acceleration, **bounds):
    """One round of refining all phases; the density of the phase acceleration moves to its best multiple.

    Parameters
    ----------
    fits : list of (callable, ndarray)
        Each sequence's cycle, as `refine_phase` takes it, and the variance of the residual.

    Returns
    -------
    phases : list of ndarray
    acceleration : float
    """
    best = None
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        refined, total = [], 0.0
        for sequence, phase, (evaluate, noise) in zip(sequences, phases, fits):
            phase, evidence = refine_phase(sequence.y, phase, evaluate, noise, acceleration * factor,
                                           1 / sequence.rate_hz, **bounds)
            refined.append(phase)
            total += evidence
        if best is None or total > best[0]:
            best = total, refined, acceleration * factor
    return best[1:]


def _noise(residual):
    """Variance of a residual, enlarged for its correlation in time: what independent frames would tell."""
    return np.maximum(np.mean(residual ** 2, axis=0), NOISE_FLOOR) * _correlation_length(residual)


def _period_of(sequence):
    try:
        return period(sequence.y, sequence.rate_hz)
    except MotionError as error:
        raise MotionError(f'{sequence.name}: {error}') from None


def align_rhythmic(sequences, rounds=6, phases=None):
    """Common phase of rhythmic sequences (eq. 5), to a fraction of a frame, using all their cycles.

    Periods by auto-correlation give a first linear phase; cycle and phase of each sequence are then refined in
    turn; shifts against the sequence of the shortest period (then against the mean cycle) by
    cross-correlation.

    Parameters
    ----------
    sequences : list of Sequence
    rounds : int
        Alternations of cycle and phase.
    phases : list of ndarray, shape (T_s,), optional
        Unwrapped phases common to all sequences, where another model has aligned them; they are refined only.

    Returns
    -------
    Aligned
    """
    grid = np.arange(SAMPLES) * 2 * np.pi / SAMPLES
    design = harmonic_design(grid, HARMONICS)[0]
    aligned = phases is not None
    periods = [] if aligned else [_period_of(sequence) for sequence in sequences]
    phases = phases if aligned else [2 * np.pi * np.arange(len(sequence.y)) / (sequence.rate_hz * length)
              for sequence, length in zip(sequences, periods)]
    acceleration = 1.0
    for _ in range(rounds):
        fits = []
        for sequence, phase in zip(sequences, phases):
            cycle = fit_cycle(sequence.y, phase, HARMONICS)

            def evaluate(at, cycle=cycle):
                value, slope = harmonic_design(at, HARMONICS)
                return value @ cycle, slope @ cycle

            fits.append((evaluate, _noise(sequence.y - evaluate(phase)[0])))
        phases, acceleration = _refine(sequences, phases, fits, acceleration)
    cycles = [design @ fit_cycle(sequence.y, phase, HARMONICS) for sequence, phase in zip(sequences, phases)]
    if aligned:
        return Aligned(list(phases), np.array(cycles), grid, acceleration)
    reference = cycles[int(np.argmin(periods))]
    for _ in range(4):
        for index, (sequence, phase) in enumerate(zip(sequences, phases)):
            phases[index] = phase - cycle_shift(reference, cycles[index])
            cycles[index] = design @ fit_cycle(sequence.y, phases[index], HARMONICS)
        reference = np.mean(cycles, axis=0)
    return Aligned(phases, np.array(cycles), grid, acceleration)


def active_span(sequence, share=0.1):
    """First and last frame (exclusive) of the movement: where joint speed exceeds ``share`` of its peak."""
    if len(sequence.y) < 4:
        raise MotionError(f'{sequence.name}: {len(sequence.y)} frames are too few for a discrete motion')
    speed = np.sqrt(np.sum(np.diff(sequence.y, axis=0) ** 2, axis=1))
    if speed.max() <= 1e-9:
        raise MotionError(f'{sequence.name}: nothing moves in this recording')
    moving = np.flatnonzero(speed > share * speed.max())
    return int(moving[0]), int(moving[-1]) + 2


def align_discrete(sequences, rounds=6):
    """Common phase of discrete sequences, 0 at the start and 1 at the goal (eq. 5 with shift 0).

    Starts from dynamic time warping onto the recording that all others resemble most, whose own phase is linear; then
    refines each phase against the mean motion.

    Parameters
    ----------
    sequences : list of Sequence
        Only their active spans are used.
    rounds : int

    Returns
    -------
    Aligned
    """
    from scipy.interpolate import CubicSpline  # nodes, which do not learn, start half a second earlier without
    grid = np.linspace(0, 1, SAMPLES)
    phases = _warped(sequences)
    acceleration = float(np.mean([(sequence.rate_hz / len(sequence.y)) ** 3 for sequence in sequences]))
    cycles = np.array([_on_grid(sequence.y, phase, grid) for sequence, phase in zip(sequences, phases)])
    for _ in range(rounds if len(sequences) > 1 else 0):
        spline = CubicSpline(grid, cycles.mean(axis=0))
        fits = []
        for sequence, phase in zip(sequences, phases):
            shift = np.mean(sequence.y - spline(phase), axis=0)

            def evaluate(at, shift=shift, spline=spline):
                return spline(at) + shift, spline(at, 1)

            fits.append((evaluate, _noise(sequence.y - evaluate(phase)[0])))
        phases, acceleration = _refine(sequences, phases, fits, acceleration, lower=0.0, upper=1.0)
        phases = [_start_to_goal(phase) for phase in phases]
        cycles = np.array([_on_grid(sequence.y, phase, grid) for sequence, phase in zip(sequences, phases)])
    return Aligned(phases, cycles, grid, acceleration)


def _warped(sequences):
    """Phases by time warping of the postures (each recording's mean set aside) onto the most central recording."""
    from style_core.effort.warping import warp  # and without this another second
    centred = [sequence.y - sequence.y.mean(axis=0) for sequence in sequences]
    paths = [[warp(y, reference) for y in centred] for reference in centred]
    central = int(np.argmin([sum(path.mean_cost for path in row) for row in paths]))
    phases = []
    for y, path in zip(centred, paths[central]):
        frames = np.bincount(path.rows, path.columns, len(y)) / np.bincount(path.rows, minlength=len(y))
        phases.append(_start_to_goal(frames))
    return phases


def _start_to_goal(phase):
    """Never back, 0 at the first frame, 1 at the last."""
    phase = np.maximum.accumulate(phase)
    return (phase - phase[0]) / max(phase[-1] - phase[0], 1e-9)


def _on_grid(y, phase, grid):
    phase = phase + np.arange(len(phase)) * 1e-9  # strictly increasing, for interpolation
    return np.stack([np.interp(grid, phase, channel) for channel in y.T], axis=1)


def choose_dimension(singular_values, share=0.95, largest=8):
    """J from the singular values: the fewest styles that hold ``share`` of the variation after the first.

    The first singular value is the mean motion; the energy of the others is the variation between styles.
    """
    energy = np.asarray(singular_values[1:]) ** 2
    if energy.sum() <= 0:
        return 1
    needed = 2 + int(np.searchsorted(np.cumsum(energy) / energy.sum(), share))
    return min(needed, largest, len(singular_values))


def factorise(cycles, dimension=None):
    """Observation bases and styles by singular value decomposition (eq. 6).

    Parameters
    ----------
    cycles : ndarray, shape (S, C, D)
    dimension : int, optional
        J <= S; chosen from the singular values when absent.

    Returns
    -------
    styles : ndarray, shape (S, J)
        First J columns of U; a sign is chosen so that each column's sum is not negative.
    bases : ndarray, shape (J, C, D)
        First J rows of S V^T: ``cycles[s] ~ sum_j styles[s, j] bases[j]``.
    singular_values : ndarray, shape (S,)

    Raises
    ------
    MotionError
        If J is larger than the number of sequences.
    """
    count = len(cycles)
    u, values, v = np.linalg.svd(cycles.reshape(count, -1), full_matrices=False)
    if dimension is None:
        dimension = choose_dimension(values)
    if not 1 <= dimension <= count:
        raise MotionError(f'style dimension {dimension} needs at least as many training sequences, got {count}')
    sign = np.where(u.sum(axis=0) < 0, -1.0, 1.0)
    styles = np.ascontiguousarray((u * sign)[:, :dimension])
    bases = ((values * sign)[:, None] * v)[:dimension].reshape((dimension,) + cycles.shape[1:])
    return styles, bases, values


def speeds_of(sequences, aligned):
    """Mean phase velocity of every sequence and its variance within the sequence, shape (S, 2)."""
    return np.array([((phase[-1] - phase[0]) * sequence.rate_hz / (len(phase) - 1),
                      np.var(np.diff(phase) * sequence.rate_hz))
                     for sequence, phase in zip(sequences, aligned.phases)])


def speed_statistics(speeds, weight=None):
    """Mean and standard deviation of the phase velocity, between and within sequences; at least 5 % of the mean."""
    mean, within = np.average(speeds, axis=0, weights=weight)
    between = np.average((speeds[:, 0] - mean) ** 2, weights=weight)
    return float(mean), float(np.sqrt(between + within + (0.05 * mean) ** 2))


#: Fewest sequences of a gait: fewer say nothing about how its style varies.
FEWEST_OF_A_GAIT = 3


def split_gaits(cycles, speeds, groups):
    """Gaits of the sequences: do they fall apart into two, as walking and running do?

    Cycles are projected on their first principal direction and cut where the variance within the two parts is
    smallest. The cut is kept where two Gaussians explain the projections better than one in spite of having to tell
    which sequence belongs to which (classification likelihood with Schwarz's penalty: a uniform spread, and anything
    rounder, stays whole), and where somebody shows both: otherwise it is people that differ, not gaits.

    Parameters
    ----------
    cycles : ndarray, shape (S, C, D)
    speeds : ndarray, shape (S, 2)
        See `speeds_of`.
    groups : sequence of str, length S

    Returns
    -------
    ndarray of int, shape (S,)
        0 for the slower gait, 1 for the faster; all 0 where there is one.
    """
    count = len(cycles)
    gaits = np.zeros(count, dtype=int)
    if count < 2 * FEWEST_OF_A_GAIT:
        return gaits
    centred = cycles.reshape(count, -1) - cycles.reshape(count, -1).mean(axis=0)
    place = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    order = np.argsort(place)
    total = np.sum(place ** 2)
    if not total > 0:
        return gaits
    sizes = np.arange(FEWEST_OF_A_GAIT, count - FEWEST_OF_A_GAIT + 1)
    between = np.cumsum(place[order])[sizes - 1] ** 2 * count / (sizes * (count - sizes))
    best = int(np.argmax(between))
    share = sizes[best] / count
    entropy = -share * np.log(share) - (1 - share) * np.log(1 - share)
    gain = -count * np.log(max(1 - between[best] / total, 1e-12)) - 2 * count * entropy - 2 * np.log(count)
    first, second = order[:sizes[best]], order[sizes[best]:]
    if gain <= 0 or not {groups[k] for k in first} & {groups[k] for k in second}:
        return gaits
    gaits[max(first, second, key=lambda part: speeds[part, 0].mean())] = 1
    return gaits


def style_of(y, phase, processes):
    """Least-squares style of a sequence with known phase, (J,), and the pose it gives, (T, D)."""
    basis = np.stack([process.evaluate(phase)[0] for process in processes])
    style, *_ = np.linalg.lstsq(basis.reshape(len(basis), -1).T, y.reshape(-1), rcond=None)
    return style, np.tensordot(style, basis, axes=1)


def align(sequences, rhythmic, phases=None):
    """Align sequences and return them with their `Aligned` phases (discrete ones cut to their active span)."""
    if rhythmic:
        return list(sequences), align_rhythmic(sequences, phases=phases)
    cut = []
    for sequence in sequences:
        start, stop = active_span(sequence)
        cut.append(Sequence(sequence.name, sequence.group, sequence.y[start:stop], sequence.rate_hz))
    return cut, align_discrete(cut)


def bases_from(sequences, aligned, name, rhythmic, joint_names, dimension=None):
    """Bases, processes, noise and velocity statistics of aligned sequences, as a `Behaviour` without residual."""
    styles, bases, values = factorise(aligned.cycles, dimension)
    processes = [fit_process(aligned.grid, basis, rhythmic) for basis in bases]
    residuals = [sequence.y - style_of(sequence.y, phase, processes)[1]
                 for sequence, phase in zip(sequences, aligned.phases)]
    noise = np.maximum(np.mean(np.concatenate(residuals) ** 2, axis=0), NOISE_FLOOR)
    speeds = speeds_of(sequences, aligned)
    velocity = np.array([*speed_statistics(speeds), 0.4 * speeds[:, 0].min(), 1.6 * speeds[:, 0].max()])
    return Behaviour(
        name=name, rhythmic=rhythmic, joint_names=tuple(joint_names), rate_hz=sequences[0].rate_hz,
        sequences=tuple(sequence.name for sequence in sequences),
        groups=tuple(sequence.group for sequence in sequences), styles=styles, singular_values=values,
        phase_grid=aligned.grid, bases=np.stack([process.outputs for process in processes]),
        beta=np.stack([process.beta for process in processes]), noise=noise,
        acceleration=float(aligned.acceleration), velocity=velocity, speeds=speeds,
        gaits=split_gaits(aligned.cycles, speeds, [sequence.group for sequence in sequences])
        if rhythmic else np.zeros(len(sequences), dtype=int))


def learn(sequences, joint_names, name='motion', rhythmic=True, dimension=None):
    """Learn the phase-style model of one behaviour (without the residual part of the full filter).

    Parameters
    ----------
    sequences : list of Sequence
    joint_names : sequence of str
    name : str
    rhythmic : bool
    dimension : int, optional
        J; chosen from the singular values when absent.

    Returns
    -------
    Behaviour
    """
    sequences, aligned = align(sequences, rhythmic)
    return bases_from(sequences, aligned, name, rhythmic, joint_names, dimension)
