"""The one way in which commands and nodes read a recording: whatever its format, with continuous angles."""
import warnings
from pathlib import Path

import numpy as np

from style_core.angles import continuous, matrices_of
from style_core.formats import carried, locohub, read_motion

__all__ = ['read_recording', 'read_recordings']

#: faster than any joint of a person or a robot, rad/s
FASTEST_RAD_S = 100.0
#: share of a joint's frames, and of the joints, that must be so fast before units or rate are doubted: less is a sensor
_FAST_SHARE, _FAST_JOINTS = 0.01, 0.25


def read_recording(path, skeleton=None, start_s=None, stop_s=None, as_filed=False, **options):
    """Read a recording of any known format.

    Parameters
    ----------
    path : path-like
    skeleton, start_s, stop_s, **options
        See `style_core.formats.read_motion`.
    as_filed : bool
        Leave the angles as the file has them, with its jumps between equivalent ones.

    Returns
    -------
    Motion
        Each joint takes the branch of its angles that runs on without a jump, by the order in which it turns.

    Raises
    ------
    MotionError
        See `style_core.formats.read_motion`.

    Warns
    -----
    UserWarning
        Where units or rate can hardly be right: an angle of a format without units passes a whole turn, or a joint
        is faster than any.
    """
    motion = read_motion(path, skeleton, start_s, stop_s, **options)
    if not as_filed:
        motion = continuous(motion)
    for doubt in _doubts(motion, str(path)):
        warnings.warn(f'{path}: {doubt}', stacklevel=2)
    return motion


def read_recordings(path, stride_s=None):
    """All recordings of a table of LocoHub, with continuous angles.

    Parameters
    ----------
    path : path-like
        ``.csv`` or ``.parquet``.
    stride_s : float, optional
        See `style_core.formats.locohub.read_all`.

    Returns
    -------
    list of Motion
    """
    return [continuous(motion) for motion in locohub.read_all(Path(path), stride_s)]


def _doubts(motion, path):
    angles = [column for column, unit in enumerate(motion.units) if unit == 'rad']
    if not carried(path)['has_units'] and not motion.triples and angles:
        with np.errstate(invalid='ignore'):
            beyond = [motion.joint_names[c] for c in angles if (np.abs(motion.positions[:, c]) > 2 * np.pi).any()]
        if beyond:
            yield (f'{_listed(beyond)} passes a whole turn (2 pi rad): if these are degrees, say so with [deg] after '
                   f'the name or --unit deg')
            return
    fast, count = _fast_joints(motion)
    if len(fast) > _FAST_JOINTS * count:
        yield (f'{_listed(fast)}: faster than {FASTEST_RAD_S:g} rad/s in more than {_FAST_SHARE:.0%} of the frames; '
               f'units or rate ({motion.rate_hz:g} Hz) can hardly be right')


def _fast_joints(motion):
    """Joints faster than any, by the rotation of those with three angles as near the gimbal lock angles race; and how
    many joints there are."""
    if motion.n_frames < 3:
        return [], 0
    found, in_triple = [], set()
    steps = np.diff(motion.times)
    for joint, triple in motion.triples.items():
        in_triple.update(triple)
        turns = matrices_of(motion.positions[:, triple], motion.order_of(joint))
        with np.errstate(invalid='ignore'):
            cosine = 0.5 * (np.einsum('tij,tij->t', turns[1:], turns[:-1]) - 1)
            speed = np.arccos(np.clip(cosine, -1, 1)) / steps
            if (speed > FASTEST_RAD_S).mean() > _FAST_SHARE:
                found.append(joint)
    single = [c for c, unit in enumerate(motion.units) if unit == 'rad' and c not in in_triple]
    with np.errstate(invalid='ignore'):
        speed = np.abs(np.diff(motion.positions[:, single], axis=0)) / steps[:, None]
        fast = (speed > FASTEST_RAD_S).mean(axis=0) > _FAST_SHARE
    return found + [motion.joint_names[c] for c, one in zip(single, fast) if one], len(single) + len(motion.triples)


def _listed(names):
    return ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')
