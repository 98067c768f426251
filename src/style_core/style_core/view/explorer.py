"""Styles of a style machine to try out: content, coordinates and their ranges, the motion of both, files to save."""
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple

import numpy as np

from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.style_machine import (
    analyze,
    random_walk,
    sequence,
    synthesize,
    synthesize_visits,
    take,
)

__all__ = ['Content', 'expression', 'file_of', 'mixed', 'of_recording', 'of_sequence', 'of_walk', 'performed',
           'reach', 'same_place']

#: formats in which a motion can be saved from the page
SAVED_AS = ('.csv', '.npz', '.bvh', '.amc')


@dataclass(frozen=True, eq=False)
class Content:
    """What is done, whatever the style.

    Attributes
    ----------
    name : str
    visits : tuple of (int, float)
        States and stays in units of the style's dwell time; empty for a recording.
    gamma : ndarray, shape (T, N), optional
        Occupancies of the states over a recording.
    dwell : ndarray, shape (N,), optional
        Dwell times of the recording's own style.
    style : ndarray, shape (K,), optional
        Its own style.
    """

    name: str
    visits: Tuple = ()
    gamma: Optional[np.ndarray] = None
    dwell: Optional[np.ndarray] = None
    style: Optional[np.ndarray] = None


def of_walk(machine, seconds, seed=0):
    """A random walk that lasts ``seconds`` in the generic style."""
    visits = take(random_walk(machine, seed), machine, machine.style('generic'), seconds)
    return Content(f'random walk {seed}', tuple(visits))


def of_sequence(machine, text):
    """A choreography by names; see `style_core.style_machine.sequence`."""
    return Content(text, tuple(sequence(machine, text)))


def of_recording(machine, motion):
    """What a recording does."""
    found = analyze(machine, motion)
    return Content(motion.name, gamma=found.gamma, dwell=found.emission.dwell, style=found.v)


def performed(machine, content, v):
    """The content in style ``v``, shape (K,), as a Motion."""
    if content.gamma is not None:
        return synthesize(machine, content.gamma, v, content.dwell, name=content.name)
    return synthesize_visits(machine, content.visits, v, name=content.name)


def reach(machine, exaggeration=1.0):
    """Least and greatest value of every style coordinate, shape (K,) each.

    Those of the styles learned and of the generic one, widened on both sides by ``exaggeration`` times their range.
    """
    known = np.array([np.zeros(machine.dof), *machine.styles.values()])
    lower, upper = known.min(axis=0), known.max(axis=0)
    margin = exaggeration * np.maximum(upper - lower, 1e-3)
    return lower - margin, upper + margin


def mixed(machine, first, second, share, exaggeration, limits):
    """Coordinates ``exaggeration * ((1 - share) * first + share * second)`` of two named styles, within limits.

    Parameters
    ----------
    machine : StyleMachine
    first, second : str
        Expressions; the generic style is the origin, from which exaggeration leads away.
    share, exaggeration : float
    limits : (ndarray, ndarray)
        As of `reach`.

    Returns
    -------
    ndarray, shape (K,)
    """
    v = exaggeration * ((1 - share) * machine.style(first) + share * machine.style(second))
    return np.clip(v, *limits)


def expression(v):
    """The style expression of coordinates, as every command and the synthesizer node read it."""
    return '[' + ', '.join(f'{x + 0.0:.4g}' for x in v) + ']'


def same_place(seconds, before_s, after_s):
    """Where a motion stands that took ``before_s`` and takes ``after_s`` in another style, s."""
    return seconds * after_s / before_s if before_s > 0 else 0.0


def file_of(motion, suffix, skeleton=None):
    """The bytes of a motion file.

    Parameters
    ----------
    motion : Motion
    suffix : str
        One of `SAVED_AS`.
    skeleton : Skeleton, optional
        Its channels that the motion lacks are written at rest to BVH and AMC files, which hold whole bodies.

    Raises
    ------
    UsageError
        If the page does not save in this format.
    MotionError
        If the format cannot hold the motion.
    """
    if suffix not in SAVED_AS:
        raise UsageError(f'the page saves {", ".join(SAVED_AS)}, not {suffix!r}')
    if suffix == '.amc':    # other programs take every AMC file for 120 Hz
        motion = motion.resample(120.0)
    if suffix in ('.bvh', '.amc') and skeleton is not None:
        motion = _whole(motion, skeleton)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f'motion{suffix}'
        write_motion(motion, path, skeleton)
        return path.read_bytes()


def _whole(motion, skeleton):
    rest = {channel.name: channel.rest for body in skeleton.bodies for channel in body.channels}
    kinds = {channel.name: channel.kind for body in skeleton.bodies for channel in body.channels}
    lacking = [name for name in skeleton.channel_names if name not in motion.joint_names]
    extra = np.tile([rest.get(name, 0.0) for name in lacking], (motion.n_frames, 1))
    return motion.replace(
        joint_names=(*motion.joint_names, *lacking), positions=np.concatenate([motion.positions, extra], axis=1),
        units=(*motion.units, *('m' if kinds.get(name) == 't' else 'rad' for name in lacking)))
