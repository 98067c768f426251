"""Computed effort: how strong, sudden and free a motion is, measured from its kinematics.

The quantities are those of the computational Laban literature (reviewed by Larboulette and Gibet, "A review of
computable expressive descriptors of human motion", MOCO 2015; Hachimura, Takashina and Yoshimura, "Analysis and
evaluation of dancing movement based on LMA", RO-MAN 2005): Weight from the peak kinetic energy, Time from the mean
acceleration, Flow from jerk. Plain jerk says nearly the same as acceleration, so Flow takes it without dimension
(Hogan and Sternad, "Sensitivity of smoothness measures to movement duration, amplitude, and arrests", Journal of Motor
Behavior 2009): how unevenly a path is gone, not how fast. They are descriptors, not a movement analyst's judgement, and
are called computed wherever they appear.
"""
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import savgol_coeffs

from style_core.errors import MotionError

__all__ = ['EFFORTS', 'raw_descriptors', 'EffortScale', 'effort_scale']

#: order of the effort factors everywhere
EFFORTS = ('flow', 'weight', 'time')

#: labels spend 1.5 units a standard deviation: +-3 is two standard deviations
_UNITS_A_DEVIATION = 1.5
#: the derivative filter spans this long, s; shorter ones measure marker noise
_WINDOW_S = 0.15


def raw_descriptors(joints, rate_hz, scale=None):
    """Logarithms of dimensionless jerk, kinetic energy and acceleration.

    Parameters
    ----------
    joints : ndarray, shape (T, D)
        Poses in a `PoseSpace`, rad.
    rate_hz : float
    scale : ndarray, shape (D,), optional
        How far a joint moves the body, m/rad; 1 where not given.

    Returns
    -------
    ndarray, shape (3,)
        In the order of `EFFORTS`: log of the dimensionless squared jerk, of the peak kinetic energy, of the mean
        acceleration, for unit masses.

    Raises
    ------
    MotionError
        If the motion is shorter than the filter of 0.15 s (7 frames at least) or nothing moves.
    """
    frames = len(joints)
    window = max(7, 2 * round(0.5 * _WINDOW_S * rate_hz) + 1)
    if frames < window:
        raise MotionError(f'effort needs at least {window} frames at {rate_hz:g} Hz, got {frames}')
    values = joints if scale is None else joints * scale
    velocity, acceleration, jerk = _derivatives(values, window, rate_hz)
    speed = np.sum(velocity**2, axis=1)
    peak = speed.max()
    if not peak > 1e-12:
        raise MotionError('nothing moves here: effort is not defined for a still pose')
    duration = (frames - 1) / rate_hz
    roughness = np.sum(jerk**2, axis=1).mean() * duration**4 / peak
    return np.log([roughness, 0.5 * peak, np.linalg.norm(acceleration, axis=1).mean()])


@cache
def _filters(window):
    """Savitzky-Golay filters of fifth degree: (3, window, window), derivatives 1 to 3 at each place in the window."""
    return np.stack([[savgol_coeffs(window, 5, deriv=order, pos=place, use='dot') for place in range(window)]
                     for order in (1, 2, 3)])


def _derivatives(values, window, rate_hz):
    """First three derivatives (3, T, D) of values (T, D); near the ends those of the outermost window's polynomial."""
    filters, half = _filters(window), window // 2
    inner = sliding_window_view(values, window, axis=0) @ filters[:, half].T        # (T - window + 1, D, 3)
    every = np.concatenate([filters[:, :half] @ values[:window], np.moveaxis(inner, 2, 0),
                            filters[:, half + 1:] @ values[-window:]], axis=1)
    return every * rate_hz ** np.arange(1, 4)[:, None, None]


class EffortScale:
    """Turns raw descriptors into labels in [-3, 3], relative to fragments of the same content.

    Effort is how an action is done, not which action it is; so mean and deviation are those of the content group.

    Parameters
    ----------
    means, deviations : ndarray, shape (G, 3)
    """

    def __init__(self, means, deviations):
        self.means = np.asarray(means, dtype=float)
        self.deviations = np.asarray(deviations, dtype=float)

    def labels(self, raw, group):
        """Flow (free positive), Weight (strong positive) and Time (sudden positive); shape (3,) or (N, 3)."""
        labels = _UNITS_A_DEVIATION * (np.asarray(raw) - self.means[group]) / self.deviations[group]
        labels = labels * np.array([-1.0, 1.0, 1.0])  # much jerk is bound, little is free
        return np.clip(labels, -3.0, 3.0)


def effort_scale(raw, groups):
    """Fit an `EffortScale`.

    Parameters
    ----------
    raw : ndarray, shape (N, 3)
        Of the recorded fragments.
    groups : ndarray of int, shape (N,)
        Content group of each, 0 to G - 1.

    Returns
    -------
    EffortScale
        A group of fewer than three fragments takes the deviation within the other groups.
    """
    raw, groups = np.asarray(raw, dtype=float), np.asarray(groups)
    count = int(groups.max()) + 1
    means = np.array([raw[groups == g].mean(axis=0) for g in range(count)])
    within = np.sqrt(np.mean((raw - means[groups])**2, axis=0))
    deviations = np.array([raw[groups == g].std(axis=0) if np.sum(groups == g) >= 3 else within
                           for g in range(count)])
    floor = np.where(within > 1e-6, 0.1 * within, 1.0)
    return EffortScale(means, np.maximum(deviations, floor))
