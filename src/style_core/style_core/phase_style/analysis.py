"""What a phase-style model finds in a recording: the course of phase, style and behaviour, on line or in batch."""
from dataclasses import dataclass
from typing import Mapping, Tuple

import numpy as np

from style_core.errors import MotionError
from style_core.predictor import Status

__all__ = ['Course', 'Event', 'follow', 'course_of_batch', 'events']


@dataclass(frozen=True, eq=False)
class Course:
    """What was believed at every frame.

    Attributes
    ----------
    times : ndarray, shape (T,)
        s.
    behaviour : tuple of str, length T
        The likeliest one.
    probability : ndarray, shape (T,)
        Of that behaviour.
    phase, phase_velocity : ndarray, shape (T,)
        Rad and rad/s where rhythmic, else from 0 (start) to 1 (goal) and 1/s; NaN where there is none.
    style : ndarray, shape (T, J)
        NaN beyond the styles of the frame's behaviour.
    status : tuple of Status, length T
        Empty in batch, which knows none.
    innovation : ndarray, shape (T,)
        As in `style_core.predictor.Estimate`; NaN in batch.
    mean, std : ndarray, shape (T, D)
        Filtered pose and its standard deviation, rad; empty in batch.
    """

    times: np.ndarray
    behaviour: Tuple[str, ...]
    probability: np.ndarray
    phase: np.ndarray
    phase_velocity: np.ndarray
    style: np.ndarray
    status: Tuple[Status, ...]
    innovation: np.ndarray
    mean: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class Event:
    """Attributes
    ----------
    time : float
        s.
    kind : {'status', 'behaviour', 'cycle'}
        What is new from this frame on: a status, a likeliest behaviour, a cycle of a rhythmic behaviour that is
        being tracked.
    value : str
        Name of the status or the behaviour.
    """

    time: float
    kind: str
    value: str


def follow(predictor, motion, progress=lambda frames: frames):
    """Follow a recording on line.

    Parameters
    ----------
    predictor : OnlinePredictor
        Is reset first.
    motion : Motion
        With the predictor's joints in its order; NaN where missing.
    progress : callable, optional
        Wraps the frames, as a progress bar does.

    Returns
    -------
    Course
    """
    if not motion.n_frames:
        raise MotionError(f'{motion.name} has no frames')
    predictor.reset()
    found = [predictor.update(time, y) for time, y in progress(list(zip(motion.times, motion.positions)))]
    names = [max(one.behaviours, key=one.behaviours.get, default='') for one in found]
    style = np.full((len(found), max(len(one.style) for one in found)), np.nan)
    for row, one in zip(style, found):
        row[:len(one.style)] = one.style
    return Course(motion.times, tuple(names), np.array([one.behaviours.get(name, np.nan)
                                                        for one, name in zip(found, names)]),
                  *(np.array([getattr(one, what) for one in found]) for what in ('phase', 'phase_velocity')), style,
                  tuple(one.status for one in found),
                  *(np.array([getattr(one, what) for one in found]) for what in ('innovation', 'mean', 'std')))


def course_of_batch(behaviour, times, result):
    """The course that batch EM found: one behaviour and one style for all frames."""
    count = len(times)
    nothing = np.empty((count, 0))
    return Course(times, (behaviour.name,) * count, np.ones(count), result.phase, result.phase_velocity,
                  np.tile(result.style, (count, 1)), (), np.full(count, np.nan), nothing, nothing)


def events(course, rhythmic: Mapping[str, bool]):
    """What changes over a course, in order of time.

    Parameters
    ----------
    course : Course
    rhythmic : mapping of str to bool
        Of every behaviour of the model.

    Returns
    -------
    list of Event
    """
    found = []
    for frame, time in enumerate(course.times):
        same = frame > 0 and course.behaviour[frame] == course.behaviour[frame - 1]
        if course.status and (frame == 0 or course.status[frame] != course.status[frame - 1]):
            found.append(Event(float(time), 'status', course.status[frame].name))
        if not same:
            found.append(Event(float(time), 'behaviour', course.behaviour[frame]))
        elif rhythmic.get(course.behaviour[frame], False) and _tracked(course, frame) \
                and course.phase[frame] - course.phase[frame - 1] < -np.pi:
            found.append(Event(float(time), 'cycle', course.behaviour[frame]))
    return found


def _tracked(course, frame):
    return not course.status or course.status[frame] is course.status[frame - 1] is Status.TRACKING
