"""The protocol that every on-line predictor fulfils, and the values it returns."""
import enum
from dataclasses import dataclass, field
from typing import Mapping, Optional, Protocol, Tuple

import numpy as np

__all__ = ['Status', 'Estimate', 'Prediction', 'OnlinePredictor']


class Status(enum.IntEnum):
    """How far the estimate can be trusted; UNKNOWN: the motion is none that the model knows (`style_core.unknown`)."""

    ACQUIRING = 0
    TRACKING = 1
    LOST = 2
    UNKNOWN = 3


@dataclass(frozen=True, eq=False, init=False)
class Estimate:
    """What a predictor believes after one update.

    Attributes
    ----------
    time : float
        Stamp of the update, s.
    phase : float
        Rad in [0, 2 pi) for rhythmic behaviour, [0, 1] for discrete; with its velocity NaN where the model has none.
    phase_velocity : float
        Rad/s, or 1/s for discrete behaviour.
    phase_covariance : ndarray, shape (2, 2)
        Of phase and phase velocity.
    style : ndarray, shape (J,)
    style_covariance : ndarray, shape (J, J)
    mean, std : ndarray, shape (D,)
        Filtered pose, rad: observed joints smoothed, masked joints filled in.
    observed : ndarray of bool, shape (D,)
        Which joints entered this update: measured, and believed where the predictor doubts.
    innovation : float
        Squared Mahalanobis innovation divided by the number of observed joints; about 1 when the model fits,
        NaN when nothing was observed.
    log_likelihood : float
        Of this update's observation, nats.
    status : Status
    behaviours : mapping of str to float
        Probability of each behaviour; empty where the model has one only.
    """

    time: float
    phase: float
    phase_velocity: float
    phase_covariance: np.ndarray
    style: np.ndarray
    style_covariance: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    observed: np.ndarray
    innovation: float
    log_likelihood: float
    status: Status
    behaviours: Mapping[str, float] = field(default_factory=dict)

    def __init__(self, time, phase, phase_velocity, phase_covariance, style, style_covariance, mean, std, observed,
                 innovation, log_likelihood, status, behaviours=None):
        # all at once: one after the other takes as long as half a filter's update
        self.__dict__.update(
            time=time, phase=phase, phase_velocity=phase_velocity, phase_covariance=phase_covariance, style=style,
            style_covariance=style_covariance, mean=mean, std=std, observed=observed, innovation=innovation,
            log_likelihood=log_likelihood, status=status, behaviours={} if behaviours is None else behaviours)


@dataclass(frozen=True, eq=False, init=False)
class Prediction:
    """Future poses.

    Attributes
    ----------
    times : ndarray, shape (H,)
        Absolute stamps, s.
    mean, std, velocity : ndarray, shape (H, D)
        Rad, rad, rad/s.
    """

    times: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    velocity: np.ndarray

    def __init__(self, times, mean, std, velocity):
        self.__dict__.update(times=times, mean=mean, std=std, velocity=velocity)


class OnlinePredictor(Protocol):
    """Update with each observation, predict at any time ahead.

    ``joint_names`` gives the order of the D channels of every array.

    Notes
    -----
    Every predictor keeps these rules; ``test_predictor_contract.py`` puts each kind of model through them.

    - Not observed is what is NaN, masked, or beyond 10,000 rad, which no joint can be: it has no influence at all.
      What is infinite is an error of the caller, like a wrong shape, a mask that is not boolean, or a time that does
      not increase: ValueError, and nothing has changed.
    - Not believed is what is observed but contradicts what is known by far (20 standard deviations): a joint of few,
      or, while tracking, a whole observation. It is left out, and False in `Estimate.observed`. A joint that is out
      by the same again and again has moved and is believed after 0.05 s. A predictor that believed nothing for a while
      searches anew.
    - So one wild sample, of one joint or all, does no harm that is still there a second later.
    - ``std`` is finite and above 0 for every joint, observed ones included, and at every horizon, 0 included.
      (Baselines, which give no band, say NaN.)
    - Before the first update `predict` says what may be expected of anyone, at times counted from 0.
    - After `reset` everything is as in a new predictor, bit for bit.
    """

    joint_names: Tuple[str, ...]

    def reset(self) -> None:
        """Forget everything observed; the next update starts a search."""

    def update(self, time: float, y: np.ndarray, mask: Optional[np.ndarray] = None) -> Estimate:
        """Take one observation.

        Parameters
        ----------
        time : float
            Stamp, s; must increase strictly from call to call.
        y : ndarray, shape (D,)
            Rad; NaN means not observed, and so does what no joint can be, beyond 10,000.
        mask : ndarray of bool, shape (D,), optional
            False where a joint is not to be used.

        Raises
        ------
        ValueError
            If a shape is wrong, a value is infinite, the mask is not boolean, or time is not finite or does not
            increase.
        """

    def predict(self, horizons: np.ndarray) -> Prediction:
        """Predict at ``horizons`` (shape (H,), s after the last update, finite and >= 0).

        The arrays are the caller's own: nobody else writes or reads them.

        Raises
        ------
        ValueError
            If a horizon is negative or not finite, or the shape is wrong.
        """
