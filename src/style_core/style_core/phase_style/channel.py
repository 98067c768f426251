"""What a channel is made of beside the bases: the one list from which all else derives.

A row is an ingredient: a part, or one part a harmonic (`style_core.phase_style.parts`), with a variance by channel and
a decay that are learned. The filter, the smoother, the glance, learning, standing still, the model file and the list of
what can be left out all read this list. Recipes in docs/phase_style.md change it.
"""
from dataclasses import dataclass
from typing import Callable

import numpy as np

from style_core.phase_style.parts import CYCLE, LEVEL, SMOOTH, Part

__all__ = ['CHANNEL', 'NOISE_FLOOR', 'NOTHING', 'POSTURE', 'Ingredient', 'LeftOut', 'covariances_of', 'of_kind',
           'parts_of']

#: Variance of an ingredient that is left out, rad^2. Its states stay: a level takes over what a channel insists on.
NOTHING = 1e-10
#: Channels that hardly move still get this variance, rad^2, so that no channel is trusted without bound.
NOISE_FLOOR = 1e-6


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What bases and style do not say of a sequence that they have not seen.

    Attributes
    ----------
    constant : ndarray, shape (D,)
    cosines, sines : ndarray, shape (K, D)
        By harmonic of the phase.
    rest : ndarray, shape (T, D)
    """

    constant: np.ndarray
    cosines: np.ndarray
    sines: np.ndarray
    rest: np.ndarray


@dataclass(frozen=True, eq=False)
class Ingredient:
    """One row of `CHANNEL`.

    Attributes
    ----------
    name : str
        In model files, in settings, and for leaving it out.
    kind : int
        Of its parts.
    squares : callable
        Its mean squares in a `LeftOut`, shape (D,), or (K, D) by harmonic: where the shape over channels comes from.
    start, decay : float
        Where learning starts: a factor on this shape, and 1/s.
    least : float
        Smallest variance of the shape, rad^2.
    still : float
        Share of it that somebody standing still shows.
    quick : float
        Share of it that shows as change, beside posture, over the samples of a glance.
    """

    name: str
    kind: int
    squares: Callable
    start: float
    decay: float
    least: float = 0.0
    still: float = 0.0
    quick: float = 0.0

    @property
    def turns(self):
        """Whether it follows the phase: rhythmic behaviours alone have it, one part a harmonic."""
        return self.kind == CYCLE


CHANNEL = (
    Ingredient('offset', LEVEL, lambda left: left.constant ** 2, start=1.0, decay=0.1, least=NOISE_FLOOR, still=1.0),
    Ingredient('fast', SMOOTH, lambda left: np.var(left.rest, axis=0), start=1.0, decay=20.0, least=NOISE_FLOOR,
               still=0.1, quick=1.0),
    Ingredient('personal', CYCLE, lambda left: 0.5 * (left.cosines ** 2 + left.sines ** 2), start=0.5, decay=0.1,
               quick=0.5),
)


def of_kind(*kinds):
    """Ingredients of some kinds."""
    return tuple(one for one in CHANNEL if one.kind in kinds)


#: The level that is a person's posture, and that takes over what a channel insists on.
POSTURE = of_kind(LEVEL)[0]


def parts_of(residual, rhythmic, without=()):
    """Parts of a channel with a residual model.

    Parameters
    ----------
    residual : Residual
    rhythmic : bool
    without : collection of str
        Ingredients to leave out.

    Returns
    -------
    list of (Part, ndarray of shape (D,))
        Each with its variance by channel, rad^2.
    """
    found = []
    for one in CHANNEL:
        variance = residual.variance.get(one.name)
        if variance is None:  # a model from before there was such an ingredient
            continue
        decay, left_out = residual.decay[one.name], one.name in without
        if not one.turns:
            found.append((Part(one.kind, decay), np.full_like(variance, NOTHING) if left_out else variance))
        elif rhythmic and not left_out:
            found += [(Part(one.kind, decay, k + 1), share * variance)
                      for k, share in enumerate(residual.share[one.name])]
    return found


def covariances_of(residual, rhythmic, times, phases):
    """Covariance over time of every ingredient, eq. (16) of docs/phase_style.md.

    Parameters
    ----------
    residual : Residual
    rhythmic : bool
    times, phases : ndarray, shape (T,)

    Returns
    -------
    list of (ndarray of shape (T, T), ndarray of shape (D,))
        As a multiple of the variance by channel, and that.
    """
    found = []
    for one in CHANNEL:
        if one.name not in residual.variance or (one.turns and not rhythmic):
            continue
        shares = residual.share[one.name] if one.turns else [1.0]
        parts = [share * Part(one.kind, residual.decay[one.name], k + 1 if one.turns else 0).covariance(times, phases)
                 for k, share in enumerate(shares)]
        if parts:
            found.append((sum(parts), residual.variance[one.name]))
    return found
