"""What training says of recordings and fits that are nothing to learn from."""
import warnings

import numpy as np

from style_core.alignment import repetition
from style_core.errors import MotionError

__all__ = ['doubt_recordings', 'doubt_repetition', 'doubt_fit']

#: correlation of successive frames, likeness of a motion to itself a period later, and share of the motion explained
#: by a model, below which it is said that there may be nothing to learn
_NOISE, _UNLIKE, _UNEXPLAINED = 0.5, 0.3, 0.5


def doubt_recordings(motions):
    """Warn of recordings whose successive frames have hardly anything to do with each other: noise."""
    for motion in motions:
        seen = np.isfinite(motion.positions)
        mean = np.where(seen, motion.positions, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        y = motion.positions - mean
        both = np.isfinite(y[1:]) & np.isfinite(y[:-1])
        before, after = np.where(both, y[:-1], 0.0), np.where(both, y[1:], 0.0)
        size = np.sqrt((before**2).sum() * (after**2).sum())
        if size > 0 and (before * after).sum() < _NOISE * size:
            warnings.warn(f'{motion.name}: successive frames have a correlation of '
                          f'{(before * after).sum() / size:.2f}; this looks like noise, not like motion', stacklevel=2)


def doubt_repetition(motions):
    """Warn of recordings that no period shows in."""
    for motion in motions:
        angles = [column for column, unit in zip(motion.positions.T, motion.units) if unit == 'rad']
        frames = np.arange(motion.n_frames)
        y = np.array([np.interp(frames, frames[there], column[there]) for column in angles
                      if (there := np.isfinite(column)).any()]).T
        try:
            period_s, likeness = repetition(y, motion.rate_hz)
        except (MotionError, ValueError) as error:
            warnings.warn(f'{motion.name} shows no period: {error}', stacklevel=2)
            continue
        if likeness < _UNLIKE:
            warnings.warn(f'{motion.name} shows no period: the likeliest, {period_s:.2f} s, leaves a likeness of '
                          f'{likeness:.2f} to itself (1 is the same again, 0 nothing)', stacklevel=2)


def doubt_fit(name, noise, motion):
    """Warn of a model that leaves most of the recordings' motion unexplained.

    Parameters
    ----------
    name : str
        Of the behaviour or style.
    noise, motion : float
        Mean variance about the model, and of the recordings about their own mean poses.
    """
    explained = 1 - noise / motion if motion > 0 else 0.0
    if not explained > _UNEXPLAINED:
        warnings.warn(f'{name} explains {max(explained, 0.0):.0%} of how its recordings move: they have no course in '
                      'common that could be learned', stacklevel=2)
