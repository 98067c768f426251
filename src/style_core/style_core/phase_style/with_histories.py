"""Nearest-history correction: the full filter, and a memory of what training motion did next.

A filter and a memory are wrong in different ways, so that their weighted mean is better than either - most of all while
the filter still searches, and while it gets to know the person. Weights are learned on people left out of both. The
memory is recorded motion: it is carried along in the model file, which is why this is an option.
"""
import math
from dataclasses import replace

import numpy as np

from style_core.histories import FRAMES, HistorySearch, RecentPast, gather
from style_core.phase_style.full_predictor import FullPredictor
from style_core.phase_style.learning import align, bases_from
from style_core.phase_style.model import Correction
from style_core.phase_style.residual import FEWEST_PEOPLE
from style_core.predictor import Prediction, Status
from style_core.progress import progress as progress_of

__all__ = ['HORIZONS', 'CorrectedPredictor', 'learn_correction', 'mixing_weights']

#: Horizons at which weights are learned, s.
HORIZONS = np.arange(1, 26) / 60
#: Fewer instants than this while searching say nothing of their own.
FEWEST_INSTANTS = 30
#: Times tried in which what the memory is worth more, right after the filter has found its way, fades, s.
FADES_S = (0.125, 0.25, 0.5, 1.0, 2.0)
#: Weights below this at every horizon are not worth the search for histories.
NEGLIGIBLE = 0.01
#: Share of left-out errors that must lie in the band of that level.
LEVEL, LEVEL_SIGMAS = 0.9, 1.6448536269514722


class CorrectedPredictor:
    """The weighted mean of the full filter's prediction and of what the nearest histories did next.

    Fulfils `style_core.predictor.OnlinePredictor`; estimates are the filter's. Histories are searched for when a
    prediction is asked for and they have a weight in it, not before.

    Parameters
    ----------
    first : FullPredictor
    correction : Correction
    """

    def __init__(self, first, correction):
        histories = correction.histories
        if tuple(first.joint_names) != tuple(histories.joint_names):
            raise ValueError('filter and histories need the same joints in the same order')
        self.joint_names = first.joint_names
        self._first = first
        self._search = HistorySearch(histories)
        self._past = RecentPast(len(self.joint_names), FRAMES / histories.rate_hz)
        # nothing is gained at once, and beyond what was learned the memory fades
        self._horizons = np.concatenate([[0.0], correction.horizons, [2 * correction.horizons[-1]]])
        self._weight = np.pad(correction.weight, ((0, 0), (1, 1)))
        self._spread = np.pad(correction.spread, ((0, 0), (1, 1)), constant_values=1.0)
        self._fade_s = correction.fade_s
        self._mixed = None  # horizons asked for last, and what follows from them
        self._pose = None
        self._time = 0.0
        self._age = None    # how long the filter has been tracking, s; None while it searches

    def reset(self):
        """Forget everything observed."""
        self._first.reset()
        self._past.reset()
        self._pose = self._age = None

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`)."""
        estimate = self._first.update(time, y, mask)
        self._past.add(estimate.time, y, estimate.observed)
        self._pose = estimate.mean
        if estimate.status != Status.TRACKING:
            self._age = None
        else:
            self._age = 0.0 if self._age is None else self._age + estimate.time - self._time
        self._time = estimate.time
        return estimate

    def predict(self, horizons):
        """Predict ``horizons`` s ahead (see `OnlinePredictor.predict`)."""
        filtered = self._first.predict(horizons)
        (late, searching, found), (tracked, searched) = self._mix(np.asarray(horizons, dtype=float))
        if self._age is None:
            (weight, growth), spread = searching, searched
        else:
            fresh = math.exp(-self._age / self._fade_s)
            (weight, growth), spread = (one + fresh * (two - one) for one, two in zip(late, found)), tracked
        remembered = self.remember(horizons) if weight.max(initial=0.0) > NEGLIGIBLE else None
        if remembered is None:
            return Prediction(filtered.times, filtered.mean, spread * filtered.std, filtered.velocity)
        mean, velocity = remembered
        mean -= filtered.mean
        velocity -= filtered.velocity
        return Prediction(times=filtered.times, mean=filtered.mean + weight * mean, std=spread * filtered.std,
                          velocity=filtered.velocity + weight * velocity + growth * mean)

    def _mix(self, horizons):
        """Weights and their growth with the horizon, and spreads, each (H, 1), in the order of `Correction`."""
        if self._mixed is None or not np.array_equal(self._mixed[0], horizons):
            at = np.searchsorted(self._horizons, horizons, side='right') - 1
            weights = []
            for weight in self._weight:
                slope = np.append(np.diff(weight) / np.diff(self._horizons), 0.0)
                weights.append((np.interp(horizons, self._horizons, weight)[:, None], slope[at][:, None]))
            spreads = [np.interp(horizons, self._horizons, spread)[:, None] for spread in self._spread]
            self._mixed = horizons.copy(), (weights, spreads)
        return self._mixed[1]

    def remember(self, horizons):
        """What the nearest histories alone say: mean and velocity (H, D), or None where nothing was seen."""
        if self._pose is None or not self._search.find(self._past):
            return None
        moved, velocity = self._search.displacement(horizons)
        moved += self._pose
        return moved, velocity


def mixing_weights(one, two, groups, shares=None):
    """Weight of a second prediction beside a first that minimises the squared error, by horizon.

    Parameters
    ----------
    one, two : sequence of ndarray, each (N_i, H, D)
        Errors of both on recordings that neither has seen; N_i may be zero.
    groups : sequence
        Who each recording is from; everyone counts the same, however many recordings there are.
    shares : sequence of ndarray, each (N_i, K), optional
        The weight at an instant is the mean of K weights with these shares, which add up to one; a single weight by
        default.

    Returns
    -------
    weight : ndarray, shape (K, H)
        In [0, 1].
    change : float
        Of the squared error, summed over horizons, against the first prediction alone.
    """
    from scipy.optimize import lsq_linear  # as in `learning`
    groups = np.asarray(groups)
    people = len(set(groups))
    shares = [np.ones((len(first), 1)) for first in one] if shares is None else shares
    gain, size = 0.0, 0.0
    for first, second, share, group in zip(one, two, shares, groups):
        if len(first):
            apart = second - first
            each = 1 / (people * np.sum(groups == group) * apart[:, 0].size)
            gain = gain - each * np.einsum('nk,nhd,nhd->hk', share, apart, first)
            size = size + each * np.einsum('nk,nj,nhd,nhd->hkj', share, share, apart, apart, optimize=True)
    root = np.linalg.cholesky(size + 1e-12 * np.trace(size, axis1=1, axis2=2).max(initial=1e-300)
                              * np.eye(size.shape[-1]))
    weight = np.array([lsq_linear(one.T, np.linalg.solve(one, two), bounds=(0.0, 1.0), method='bvls').x
                       for one, two in zip(root, gain)])
    change = np.einsum('hk,hkj,hj->', weight, size, weight) - 2 * np.sum(weight * gain)
    return weight.T, float(change)


def learn_correction(behaviours, sequences, progress=False):
    """Histories of the training recordings, and their weights beside the filter.

    One person after the other is left out (one recording after the other where there are fewer than four people):
    bases and histories come from the rest, the residual model stays. Weights minimise the squared error, for
    everyone alike, by horizon: one while searching; while tracking one that fades into another, in the time that suits
    best. The spread puts 90 % of the errors into the band.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models.
    sequences : list of list of Sequence
        Whole training recordings of every behaviour.
    progress : bool
        Show a bar on a terminal.

    Returns
    -------
    Correction
    """
    joint_names, rate_hz = behaviours[0].joint_names, behaviours[0].rate_hz
    every = [(sequence, behaviour) for behaviour, some in zip(behaviours, sequences) for sequence in some]
    histories = gather([(sequence.name, sequence.y) for sequence, _ in every], joint_names, rate_hz,
                       [not behaviour.rhythmic for _, behaviour in every])
    people = [sequence.group for sequence, _ in every]
    labels = np.array(people if len(set(people)) >= FEWEST_PEOPLE else [str(k) for k in range(len(every))])
    count = len(HORIZONS)
    step = 1 if len(histories.positions) < 3000 else 3  # errors of successive frames say much the same
    neutral = Correction(histories, HORIZONS, np.ones((3, count)), np.ones((2, count)), 1.0)
    found, who = [], []
    for label in progress_of(sorted(set(labels)), 'weights of histories', shown=progress):
        left_out = np.flatnonzero(labels == label)
        rest = histories.without(left_out)
        reduced = [_without(behaviour, [sequence for k, (sequence, of) in enumerate(every)
                                        if of is behaviour and k not in left_out]) for behaviour in behaviours]
        reduced = [behaviour for behaviour in reduced if behaviour is not None]
        if rest is None or not reduced:
            continue
        predictor = CorrectedPredictor(FullPredictor(reduced), replace(neutral, histories=rest))
        for index in left_out:
            errors = _errors(predictor, every[index][0], step)
            if errors is not None:
                found.append(errors)
                who.append(people[index])
    weight, spread, fade_s = np.zeros((3, count)), np.ones((2, count)), FADES_S[0]
    tracking, searching = ([[values[np.isnan(age) == lost] for values in (one, two, std, age)]
                            for one, two, std, age in found] for lost in (False, True))
    if sum(len(part[0]) for part in tracking) >= FEWEST_INSTANTS:
        tried = []
        for fade_s in FADES_S:
            fresh = [np.exp(-part[3] / fade_s) for part in tracking]
            shares = [np.column_stack([1 - one, one]) for one in fresh]
            tried.append((*mixing_weights(*zip(*(part[:2] for part in tracking)), who, shares), fade_s, shares))
        weight[[0, 2]], _, fade_s, shares = min(tried, key=lambda one: one[1])
        spread[0] = _spread(tracking, [share @ weight[[0, 2]] for share in shares])
    weight[1], spread[1] = weight[2], spread[0]  # hardly ever lost: as when it has just found its way
    if sum(len(part[0]) for part in searching) >= FEWEST_INSTANTS:
        weight[1] = mixing_weights(*zip(*(part[:2] for part in searching)), who)[0][0]
        spread[1] = _spread(searching, [np.broadcast_to(weight[1], (len(part[0]), count)) for part in searching])
    return Correction(histories, HORIZONS, weight, spread, fade_s)


def _spread(parts, weights):
    """Factor on the standard deviation that puts the wanted share of errors into the band, by horizon, shape (H,)."""
    ratios = []
    for (one, two, std, _), weight in zip(parts, weights):
        if len(one):
            ratio = np.abs(one + weight[..., None] * (two - one)) / np.maximum(std, 1e-9)
            ratio = np.sort(ratio.transpose(1, 0, 2).reshape(ratio.shape[1], -1))
            ratios.append(ratio[:, np.linspace(0, ratio.shape[1] - 1, 200).astype(int)])  # equal weight
    return np.quantile(np.concatenate(ratios, axis=1), LEVEL, axis=1) / LEVEL_SIGMAS


def _without(behaviour, sequences):
    """The behaviour with bases of ``sequences`` only; None where none is left."""
    if not sequences:
        return None
    dimension = min(behaviour.style_dimension, len(sequences))
    bases = bases_from(*align(sequences, behaviour.rhythmic), behaviour.name, behaviour.rhythmic,
                       behaviour.joint_names, dimension)
    return replace(bases, residual=behaviour.residual, acceleration=behaviour.acceleration,
                   velocity=behaviour.velocity)


def _errors(predictor, sequence, step):
    """Errors of filter and memory and standard deviations, (N, H, D), and how long it tracked, (N,), NaN while it
    searched; None if short.

    At every ``step``-th frame.
    """
    y, rate = sequence.y, sequence.rate_hz
    last = len(y) - 1 - int(np.ceil(HORIZONS[-1] * rate - 1e-9))
    if last < 1:
        return None
    frames = np.arange(len(y))
    one, two, spreads, ages = [], [], [], []
    predictor.reset()
    for frame in range(last + 1):
        predictor.update(frame / rate, y[frame])
        if frame % step:
            continue
        wanted = frame + HORIZONS * rate
        left = np.minimum((wanted + 1e-9).astype(int), len(frames) - 2)
        actual = y[left] + (wanted - left)[:, None] * (y[left + 1] - y[left])
        filtered = predictor._first.predict(HORIZONS)
        one.append(filtered.mean - actual)
        two.append(predictor.remember(HORIZONS)[0] - actual)
        spreads.append(filtered.std)
        ages.append(np.nan if predictor._age is None else predictor._age)
    return np.array(one), np.array(two), np.array(spreads), np.array(ages)
