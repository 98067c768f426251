"""Nearest-history correction: the full filter, and a memory of what training motion did next.

A filter and a memory are wrong in different ways, so that their weighted mean is better than either - most of all while
the filter still searches. Weights are learned on people left out of both. The memory is recorded motion: it is
carried along in the model file, which is why this is an option.
"""
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from style_core.histories import FRAMES, HistorySearch, RecentPast, gather
from style_core.phase_style.learning import align, bases_from
from style_core.phase_style.model import Correction
from style_core.phase_style.predictor import FullPredictor
from style_core.phase_style.residual import FEWEST_PEOPLE
from style_core.predictor import Prediction, Status

__all__ = ['HORIZONS', 'CorrectedPredictor', 'learn_correction', 'mixing_weights']

#: Horizons at which weights are learned, s.
HORIZONS = np.arange(1, 26) / 60
#: Fewer instants than this while searching say nothing of their own.
FEWEST_INSTANTS = 30
#: Share of left-out errors that must lie in the band of that level.
LEVEL, LEVEL_SIGMAS = 0.9, 1.6448536269514722


class CorrectedPredictor:
    """The weighted mean of the full filter's prediction and of what the nearest histories did next.

    Fulfils `style_core.predictor.OnlinePredictor`; estimates are the filter's. Histories are searched for when a
    prediction is asked for, not before.

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
        self._mixed = None  # horizons asked for last, and what follows from them
        self._pose = None
        self._searching = True

    def reset(self):
        """Forget everything observed."""
        self._first.reset()
        self._past.reset()
        self._pose = None
        self._searching = True

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`)."""
        estimate = self._first.update(time, y, mask)
        self._past.add(estimate.time, y, estimate.observed)
        self._pose, self._searching = estimate.mean, estimate.status != Status.TRACKING
        return estimate

    def predict(self, horizons):
        """Predict ``horizons`` s ahead (see `OnlinePredictor.predict`)."""
        filtered = self._first.predict(horizons)
        remembered = self.remember(horizons)
        if remembered is None:
            return filtered
        mean, velocity = remembered
        weight, growth, spread = self._mix(np.asarray(horizons, dtype=float))[int(self._searching)]
        mean -= filtered.mean
        velocity -= filtered.velocity
        return Prediction(times=filtered.times, mean=filtered.mean + weight * mean, std=spread * filtered.std,
                          velocity=filtered.velocity + weight * velocity + growth * mean)

    def _mix(self, horizons):
        """Weights, their growth with the horizon and spreads, each (H, 1), while tracking and while searching."""
        if self._mixed is None or not np.array_equal(self._mixed[0], horizons):
            at = np.searchsorted(self._horizons, horizons, side='right') - 1
            mixed = []
            for weight, spread in zip(self._weight, self._spread):
                slope = np.append(np.diff(weight) / np.diff(self._horizons), 0.0)
                mixed.append([part[:, None] for part in (np.interp(horizons, self._horizons, weight), slope[at],
                                                         np.interp(horizons, self._horizons, spread))])
            self._mixed = horizons.copy(), mixed
        return self._mixed[1]

    def remember(self, horizons):
        """What the nearest histories alone say: mean and velocity (H, D), or None where nothing was seen."""
        if self._pose is None or not self._search.find(self._past):
            return None
        moved, velocity = self._search.displacement(horizons)
        moved += self._pose
        return moved, velocity


def mixing_weights(one, two, groups):
    """Weight of a second prediction beside a first that minimises the squared error, by horizon.

    Parameters
    ----------
    one, two : sequence of ndarray, each (N_i, H, D)
        Errors of both on recordings that neither has seen; N_i may be zero.
    groups : sequence
        Who each recording is from; everyone counts the same, however many recordings there are.

    Returns
    -------
    ndarray, shape (H,)
        In [0, 1].
    """
    groups = np.asarray(groups)
    gain, size = 0.0, 1e-300
    for first, second, group in zip(one, two, groups):
        if len(first):
            apart = second - first
            share = 1 / np.sum(groups == group)
            gain = gain - share * np.mean(apart * first, axis=(0, 2))
            size = size + share * np.mean(apart * apart, axis=(0, 2))
    return np.clip(gain / size, 0.0, 1.0)


def learn_correction(behaviours, sequences, progress=False):
    """Histories of the training recordings, and their weights beside the filter.

    One person after the other is left out (one recording after the other where there are fewer than four people):
    bases and histories come from the rest, the residual model stays. Weights minimise the squared error, for
    everyone alike, by horizon, while tracking and while searching; the spread puts 90 % of the errors into the band.

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
    neutral = Correction(histories, HORIZONS, np.ones((2, count)), np.ones((2, count)))
    found, who = [], []
    for label in tqdm(sorted(set(labels)), desc='weights of histories', leave=False,
                      disable=None if progress else True):
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
    weight, spread = np.zeros((2, count)), np.ones((2, count))
    for row in (0, 1):
        parts = [[values[searching == row] for values in (one, two, std)] for one, two, std, searching in found]
        if sum(len(part[0]) for part in parts) < FEWEST_INSTANTS:
            if row:  # hardly ever lost: as while tracking
                weight[1], spread[1] = weight[0], spread[0]
            continue
        weight[row] = mixing_weights([part[0] for part in parts], [part[1] for part in parts], who)
        ratios = []
        for one, two, std in parts:
            if len(one):
                ratio = np.abs(one + weight[row][:, None] * (two - one)) / np.maximum(std, 1e-9)
                ratio = np.sort(ratio.transpose(1, 0, 2).reshape(count, -1))
                ratios.append(ratio[:, np.linspace(0, ratio.shape[1] - 1, 200).astype(int)])  # equal weight
        spread[row] = np.quantile(np.concatenate(ratios, axis=1), LEVEL, axis=1) / LEVEL_SIGMAS
    return Correction(histories, HORIZONS, weight, spread)


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
    """Errors of filter and memory and standard deviations, (N, H, D), and whether it searched, (N,); None if short.

    At every ``step``-th frame.
    """
    y, rate = sequence.y, sequence.rate_hz
    last = len(y) - 1 - int(np.ceil(HORIZONS[-1] * rate - 1e-9))
    if last < 1:
        return None
    frames = np.arange(len(y))
    one, two, spreads, searching = [], [], [], []
    predictor.reset()
    for frame in range(last + 1):
        estimate = predictor.update(frame / rate, y[frame])
        if frame % step:
            continue
        wanted = frame + HORIZONS * rate
        left = np.minimum((wanted + 1e-9).astype(int), len(frames) - 2)
        actual = y[left] + (wanted - left)[:, None] * (y[left + 1] - y[left])
        filtered = predictor._first.predict(HORIZONS)
        one.append(filtered.mean - actual)
        two.append(predictor.remember(HORIZONS)[0] - actual)
        spreads.append(filtered.std)
        searching.append(estimate.status != Status.TRACKING)
    return np.array(one), np.array(two), np.array(spreads), np.array(searching, dtype=int)
