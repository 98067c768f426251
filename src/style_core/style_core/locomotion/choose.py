"""How many styles: by the likelihood of recordings that were left out of learning."""
import warnings
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.errors import UsageError
from style_core.locomotion.infer import emission_of, smooth
from style_core.locomotion.learn import learn

__all__ = ['Row', 'Choice', 'choose_styles']


@dataclass(frozen=True)
class Row:
    """One candidate.

    Attributes
    ----------
    n_styles : int
    held_out : float
        Median over recordings of their log likelihood when left out, nats an observed value. (The median, because a
        recording unlike all others says nothing about the number of styles, only how far off it is.)
    error : float
        Standard error of the median difference to the best candidate (0 for the best).
    bound : float
        Variational bound with all recordings, nats. (It grows with every style that finds a recording of its own.)
    """

    n_styles: int
    held_out: float
    error: float
    bound: float


@dataclass(frozen=True)
class Choice:
    """Candidates, and the number of styles chosen."""

    rows: Tuple[Row, ...]
    best: int


def choose_styles(motions, counts, *, seed=0, folds=4, **options):
    """Cross-validate the number of styles.

    The smallest number whose held-out likelihood lies within a standard error of the best is chosen; recordings are
    compared pairwise, so that easy and hard ones do not add to the error.

    Parameters
    ----------
    motions : sequence of Motion
    counts : sequence of int
    seed : int
        Of the split and of learning.
    folds : int
    **options
        Of `style_core.locomotion.learn.learn`.

    Returns
    -------
    Choice

    Raises
    ------
    UsageError
        If there are fewer recordings than folds.
    """
    motions = list(motions)
    if len(motions) < folds:
        raise UsageError(f'{len(motions)} recordings are too few to choose the number of styles: at least {folds} are '
                         'needed, or say the number')
    part = np.random.default_rng(seed).permutation(len(motions)) % folds
    options.setdefault('rate_hz', None)
    if options['rate_hz'] is None:
        options['rate_hz'] = min(motion.rate_hz for motion in motions)
    score = np.empty((len(counts), len(motions)))
    bounds = []
    for row, count in enumerate(counts):
        for fold in range(folds):
            model = _learned([motions[k] for k in np.flatnonzero(part != fold)], count, seed, options)
            emission = emission_of(model)
            for k in np.flatnonzero(part == fold):
                x = model.features.encode(motions[k].resample(model.rate_hz))
                score[row, k] = (smooth(model, x, n_rounds=0, emission=emission).log_likelihood
                                 / max(1, np.isfinite(x).sum()))
        bounds.append(_learned(motions, count, seed, options).bounds[-1])
    middle = np.median(score, axis=1)
    top = int(middle.argmax())
    gap = score[top] - score
    typical = np.median(gap, axis=1)
    # of a median, for normal scatter: 1.2533 sigma / sqrt(n), sigma from the median absolute deviation
    error = 1.2533 * 1.4826 * np.median(np.abs(gap - typical[:, None]), axis=1) / np.sqrt(len(motions))
    best = next(c for c, d, e in zip(counts, typical, error) if d <= e)
    return Choice(tuple(Row(int(c), float(m), float(e), float(b)) for c, m, e, b in zip(counts, middle, error, bounds)),
                  int(best))


def _learned(motions, count, seed, options):
    """A candidate; that some of its styles found no recording is what the choice is about, and not said of each."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return learn(motions, count, seed=seed, restarts=1, **options)
