"""What a predictor said beforehand, laid over the recording it followed."""
from dataclasses import dataclass
from typing import Mapping, Tuple

import numpy as np

from style_core.predictor import Status
from style_core.sizes import demand

__all__ = ['Overlay', 'beforehand', 'ghost_motion', 'sensors_of', 'spread']


@dataclass(frozen=True, eq=False)
class Overlay:
    """Predictions of every frame of a recording, made ``ahead_s`` before it.

    Attributes
    ----------
    joint_names : tuple of str, length D
    ahead_s : float
    times : ndarray, shape (T,)
        Stamps of the updates, s.
    mean, std : ndarray, shape (T, D)
        For the times ``times + ahead_s``, rad.
    actual : ndarray, shape (T, D)
        What was recorded at ``times + ahead_s``, rad; NaN beyond the end and where nothing was.
    phase : ndarray, shape (T,)
        Rad, or share of a discrete motion; NaN where the model has none.
    status : tuple of Status, length T
    behaviours : tuple of mapping of str to float, length T
    observed : ndarray of bool, shape (T, D)
    """

    joint_names: Tuple[str, ...]
    ahead_s: float
    times: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    actual: np.ndarray
    phase: np.ndarray
    status: Tuple[Status, ...]
    behaviours: Tuple[Mapping[str, float], ...]
    observed: np.ndarray

    def errors(self):
        """Root mean square error over the joints of each prediction, rad, shape (T,); NaN where nothing is known."""
        squares = (self.mean - self.actual)**2
        known = np.isfinite(squares)
        count = known.sum(axis=1)
        total = np.where(known, squares, 0.0).sum(axis=1)
        return np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def beforehand(predictor, motion, ahead_s, use=None, cancelled=lambda: False):
    """Let a predictor follow a recording from its start and ask at every frame what comes.

    Parameters
    ----------
    predictor : OnlinePredictor
        It is reset first.
    motion : Motion
        The predictor's joints, in its order.
    ahead_s : float
        Horizon, s, 0 or more.
    use : ndarray of bool, shape (T, D), optional
        False where a sensor is switched off.
    cancelled : callable, optional
        Asked before every frame: True ends it.

    Returns
    -------
    Overlay or None
        None where it was cancelled.
    """
    demand(8 * motion.positions.size, f'{motion.n_frames} predictions of {motion.n_joints} joints', 'a shorter piece')
    predictor.reset()
    horizon, estimates, predictions = np.array([float(ahead_s)]), [], []
    for frame, (time, y) in enumerate(zip(motion.times, motion.positions)):
        if cancelled():
            return None
        estimates.append(predictor.update(time, y, None if use is None else use[frame]))
        predictions.append(predictor.predict(horizon))
    return Overlay(
        tuple(motion.joint_names), float(ahead_s), motion.times,
        np.array([one.mean[0] for one in predictions]), np.array([one.std[0] for one in predictions]),
        motion.at(motion.times + ahead_s).positions, np.array([one.phase for one in estimates]),
        tuple(one.status for one in estimates), tuple(dict(one.behaviours) for one in estimates),
        np.array([one.observed for one in estimates]))


def ghost_motion(overlay, recording):
    """The predictions as a motion at the times they are for, laid over the recording.

    Parameters
    ----------
    overlay : Overlay
    recording : Motion
        Its other channels (the root) are taken as recorded, for no model predicts them.

    Returns
    -------
    ghost, std : Motion and ndarray, shape (T', D')
        Frames within the recording only, with its joints; zero standard deviation where nothing was predicted.
    """
    inside = overlay.times + overlay.ahead_s <= recording.times[-1] + 1e-9
    inside[0] = True
    times = overlay.times[inside] + overlay.ahead_s
    base = recording.at(np.minimum(times, recording.times[-1])).positions.copy()
    std = np.zeros_like(base)
    for column, name in enumerate(overlay.joint_names):
        if name in recording.joint_names:
            target = recording.joint_names.index(name)
            base[:, target], std[:, target] = overlay.mean[inside, column], overlay.std[inside, column]
    return recording.replace(positions=base, times=times, name=f'{recording.name} predicted'), std


def spread(skeleton, motion, std):
    """How far the bodies of a skeleton may be from where a pose has them.

    Parameters
    ----------
    skeleton : Skeleton
    motion : Motion
        T frames of D channels of the skeleton.
    std : ndarray, shape (T, D)
        Of independent errors of the channels, rad or m.

    Returns
    -------
    ndarray, shape (T, B)
        Root of the sum over channels of |x(q + std_d e_d) - x(q - std_d e_d)|^2 / 4, m: one standard deviation of
        the place, to first order in the errors.
    """
    total = np.zeros((motion.n_frames, len(skeleton.bodies)))
    for column in np.flatnonzero((std > 0).any(axis=0)):
        ends = []
        for sign in (1.0, -1.0):
            positions = motion.positions.copy()
            positions[:, column] += sign * std[:, column]
            ends.append(skeleton.forward(motion.replace(positions=positions)))
        total += ((ends[0] - ends[1])**2).sum(axis=2) / 4
    return np.sqrt(total)


def sensors_of(joint_names):
    """Joint -> columns of its channels (``lfemur.rx``, ``lfemur.ry`` are one sensor's), in order."""
    found = {}
    for column, name in enumerate(joint_names):
        joint, dot, _ = name.rpartition('.')
        found.setdefault(joint if dot else name, []).append(column)
    return found
