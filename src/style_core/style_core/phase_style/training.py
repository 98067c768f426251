"""From recordings to a model: choosing channels, a common rate, one behaviour after the other."""
import numpy as np

from style_core.errors import MotionError
from style_core.motion import matching_names
from style_core.phase_style.learning import Sequence, align, bases_from, group_of
from style_core.phase_style.residual import learn_residual

__all__ = ['RATE_HZ', 'body_joints', 'common_joints', 'to_sequence', 'train']

#: Rate of the training sequences, Hz (that of the paper). The filters work in continuous time at any rate.
RATE_HZ = 60.0
#: Left out unless asked for: the root (no joint), and fingers and thumbs, which CMU recordings hold as noise.
EXCLUDED = ('root.*', '*fingers.*', '*thumb.*')


def body_joints(joint_names):
    """Joints to learn when nothing else is said: all but root, fingers and thumbs."""
    excluded = ['!' + pattern for pattern in EXCLUDED
                if any(_matches(joint_names, pattern))]
    return matching_names(joint_names, excluded) if excluded else list(joint_names)


def _matches(joint_names, pattern):
    try:
        return matching_names(joint_names, [pattern])
    except MotionError:
        return []


def common_joints(motions, patterns=None):
    """Joints that all recordings have, in the order of the first.

    Parameters
    ----------
    motions : list of Motion
    patterns : sequence of str, optional
        As for `Motion.select`; the body's joints when absent.

    Raises
    ------
    MotionError
        If nothing is left.
    """
    shared = set(motions[0].joint_names)
    for motion in motions[1:]:
        shared &= set(motion.joint_names)
    names = [name for name, unit in zip(motions[0].joint_names, motions[0].units)
             if name in shared and unit == 'rad']
    if not names:
        raise MotionError(f'the recordings {motions[0].name!r} ... {motions[-1].name!r} have no angle in common')
    return matching_names(names, patterns) if patterns else body_joints(names)


def to_sequence(motion, joint_names, rate_hz=RATE_HZ, group=None):
    """Bring a recording into the form that learning needs.

    Missing samples are interpolated where at most half of a channel is missing.

    Parameters
    ----------
    motion : Motion
    joint_names : sequence of str
    rate_hz : float
    group : str, optional
        Person or source; `group_of` the motion's name when absent.

    Returns
    -------
    Sequence

    Raises
    ------
    MotionError
        If a joint is absent or mostly missing, or the recording is too short.
    """
    motion = motion.joints(list(joint_names)).resample(rate_hz, max_gap_s=0.5)
    y = motion.positions.copy()
    if len(y) < 8:
        raise MotionError(f'{motion.name}: {len(y)} frames at {rate_hz:g} Hz are too few to learn from')
    for column, name in enumerate(joint_names):
        missing = np.isnan(y[:, column])
        if missing.mean() > 0.5:
            raise MotionError(f'{motion.name}: {name} is missing in {missing.mean():.0%} of the recording; leave the '
                              'joint or the recording out')
        if missing.any():
            frames = np.arange(len(y))
            y[missing, column] = np.interp(frames[missing], frames[~missing], y[~missing, column])
    return Sequence(motion.name, group_of(motion.name) if group is None else group, y, float(rate_hz))


def train(motions, name='motion', rhythmic=True, joints=None, dimension=None, rate_hz=RATE_HZ,
          residual=True, progress=False, phase_of=None, groups=None):
    """Learn one behaviour from recordings.

    Parameters
    ----------
    motions : list of Motion
    name : str
    rhythmic : bool
    joints : sequence of str, optional
        Joint names; those of the body that all recordings have when absent.
    dimension : int, optional
        J; chosen from the singular values when absent.
    rate_hz : float
    residual : bool
        Also learn the residual model that the full filter needs (the paper's method does not).
    progress : bool
        Show a bar on a terminal.
    phase_of : callable, optional
        ``motion -> times (T,), phases (T,)``: phases that another model found, common to all recordings (rhythmic
        only).
    groups : sequence of str, optional
        Person of each motion; `group_of` its name when absent.

    Returns
    -------
    Behaviour
    """
    joints = common_joints(motions) if joints is None else list(joints)
    groups = [None] * len(motions) if groups is None else groups
    sequences = [to_sequence(motion, joints, rate_hz, group) for motion, group in zip(motions, groups)]
    phases = None
    if phase_of is not None:
        phases = [np.interp(motion.times[0] + np.arange(len(sequence.y)) / rate_hz, *phase_of(motion))
                  for motion, sequence in zip(motions, sequences)]
    sequences, aligned = align(sequences, rhythmic, phases)
    behaviour = bases_from(sequences, aligned, name, rhythmic, joints, dimension)
    return learn_residual(behaviour, sequences, aligned, progress=progress) if residual else behaviour
