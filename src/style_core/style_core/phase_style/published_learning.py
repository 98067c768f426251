"""Learning as published: a cycle a sequence, aligned by whole frames (Matsubara et al. 2012, section 2.2.1, eq. 5)."""
import numpy as np

from style_core.alignment import period
from style_core.errors import MotionError
from style_core.phase_style.learning import Aligned, Sequence, active_span, bases_from
from style_core.phase_style.training import RATE_HZ, common_joints, to_sequence

__all__ = ['align_published', 'train_published']

#: Density of the phase acceleration of rhythmic motion, rad^2/s^3: the paper sets Q by hand.
ACCELERATION = 1.0


def align_published(sequences, rhythmic):
    """One cycle of each sequence at the phases of the shortest, by nearest frames (eq. 5); phases are linear.

    Parameters
    ----------
    sequences : list of Sequence
    rhythmic : bool
        Discrete sequences go from start to goal: eq. (5) with the duration in place of the period and shift 0.

    Returns
    -------
    sequences : list of Sequence
        Cut to the cycle, or to the movement.
    aligned : Aligned

    Raises
    ------
    MotionError
        If a sequence has no period.
    """
    if rhythmic:
        starts, lengths = _shifts(sequences)
    else:
        spans = [active_span(sequence) for sequence in sequences]
        starts, lengths = [first for first, _ in spans], [stop - first for first, stop in spans]
    cut = [Sequence(one.name, one.group, one.y[start:start + length], one.rate_hz)
           for one, start, length in zip(sequences, starts, lengths)]
    count = min(lengths)
    last = 0 if rhythmic else 1    # a cycle ends one frame before it begins anew, a movement at its last frame
    cycles = np.array([one.y[_rounded(np.arange(count) * (len(one.y) - last) / (count - last))] for one in cut])
    whole = 2 * np.pi if rhythmic else 1.0
    phases = [whole * np.arange(len(one.y)) / (len(one.y) - last) for one in cut]
    grid = whole * np.arange(count) / (count - last)
    acceleration = ACCELERATION if rhythmic else float(np.mean([(one.rate_hz / len(one.y)) ** 3 for one in cut]))
    return cut, Aligned(phases, cycles, grid, acceleration)


def _shifts(sequences):
    """First frame h and period T, in frames, of each sequence's cycle: the largest cross-correlation C(j)."""
    lengths = []
    for one in sequences:
        try:
            lengths.append(round(period(one.y, one.rate_hz) * one.rate_hz))
        except MotionError as error:
            raise MotionError(f'{one.name}: {error}') from None
    base = int(np.argmin(lengths))
    cycle = sequences[base].y[:lengths[base]]
    shifts = []
    for one, length in zip(sequences, lengths):
        rows = _rounded(np.arange(len(cycle)) * length / len(cycle))
        correlations = [np.sum(cycle * one.y[shift + rows]) for shift in range(len(one.y) - length + 1)]
        shifts.append(int(np.argmax(correlations)))
    return shifts, lengths


def _rounded(places):
    return np.floor(places + 0.5).astype(int)


def train_published(motions, name='motion', rhythmic=True, joints=None, dimension=None, rate_hz=RATE_HZ, groups=None):
    """Learn one behaviour as published; without the residual model, so for the published method only.

    Parameters
    ----------
    motions : list of Motion
    name, rhythmic, joints, dimension, rate_hz, groups
        As for `style_core.phase_style.training.train`.

    Returns
    -------
    Behaviour
    """
    joints = common_joints(motions) if joints is None else list(joints)
    groups = [None] * len(motions) if groups is None else groups
    sequences = [to_sequence(motion, joints, rate_hz, group) for motion, group in zip(motions, groups)]
    sequences, aligned = align_published(sequences, rhythmic)
    return bases_from(sequences, aligned, name, rhythmic, joints, dimension)
