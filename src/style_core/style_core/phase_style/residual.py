"""The residual model of the full filter, from what the bases cannot say about people left out of them.

Rule (nothing is set by hand): sequences are left out by person - or one by one where there are fewer than four
people - and the bases of the others are used on them.

1. *Shape over channels.* The left-out residual is split into its mean (offset), its first harmonics over phase
   (personal cycle), and the rest (fast); the white noise of the recording is read off third differences.
2. *Size and rates.* A few factors common to all channels - on these four variances, on the style prior and on the
   phase acceleration - and the four decay rates are chosen by coordinate search to minimise the mean over horizons
   (1/60 to 25/60 s) of the logarithm of the mean squared prediction error of left-out sequences, each started with
   a wrong phase and the mean speed of its gait; rhythmic motion's settings are
   drawn weakly to where they started (`PULL`).
3. *Calibration.* The criterion does not change when every variance is multiplied by the same factor; that factor
   and a correction by horizon make 90 % of the left-out errors lie within the 90 % band.
4. *People.* Predictions are checked when their time has come, on line as here (`style_core.phase_style.bands`).
   What is usual is the median check of the left-out runs. How many checks that is worth is their variance within a
   run over that of the level between runs (empirical Bayes). The correction by horizon is learned with the band
   following the checks. People have equal weight in all three.
"""
from dataclasses import dataclass, replace
from typing import Mapping

import numpy as np

from style_core.alignment import fit_cycle, harmonic_design
from style_core.phase_style.bands import LEAD_S, MOST, Level, check
from style_core.phase_style.basis_table import NODES, BasisTable, Table
from style_core.phase_style.channel import CHANNEL, LeftOut, of_kind
from style_core.phase_style.full import make_filter
from style_core.phase_style.learning import factorise, speed_statistics
from style_core.phase_style.model import Residual
from style_core.phase_style.parts import CYCLE, LEVEL, SMOOTH, SMOOTHER
from style_core.phase_style.style_prior import person_weights, style_prior, styles_in_gait, whitened
from style_core.progress import progress as progress_of

__all__ = ['HORIZONS', 'Shape', 'leave_out', 'residual_shape', 'learn_residual']

#: Horizons of the criterion, s.
HORIZONS = np.array([1, 5, 10, 15, 25]) / 60
#: Horizons of the calibration, s: the factor changes most where predictions begin.
CALIBRATED = np.array([1, 2, 3, 5, 10, 15, 25]) / 60
PERSONAL_HARMONICS = 3
#: Wrong phase at the start of every left-out sequence, rad; as a share of the motion where it is discrete.
WRONG_PHASE = 0.4
WRONG_SHARE = 0.05
FEWEST_PEOPLE = 4
#: Weight, in checks, of a level that nothing is known to move: bands do not follow the person then.
CERTAIN = 1e9


@dataclass(frozen=True, eq=False)
class Fold:
    """Bases without some sequences of one gait: ``table`` of the J bases, ``styles`` and ``groups`` of the others as if
    they were of that gait, mean and standard deviation of its phase velocity."""

    left_out: np.ndarray
    table: BasisTable
    styles: np.ndarray
    groups: tuple
    velocity: tuple


@dataclass(frozen=True, eq=False)
class Shape:
    """Mean squares of the left-out residual: of every ingredient, (D,) or (K, D) by harmonic, and of noise, (D,)."""

    squares: Mapping[str, np.ndarray]
    noise: np.ndarray


def _spline_table(grid, bases, rhythmic):
    """Tabulate sampled bases (J, C, D) by cubic splines: enough for bases that are used for one evaluation."""
    from scipy.interpolate import CubicSpline  # as in `learning`
    if rhythmic:
        grid = np.concatenate([grid, [2 * np.pi]])
        bases = np.concatenate([bases, bases[:, :1]], axis=1)
    spline = CubicSpline(grid, bases, axis=1, bc_type='periodic' if rhythmic else 'not-a-knot')
    nodes = np.linspace(0, grid[-1], NODES + 1)
    values, slopes = (np.ascontiguousarray(np.moveaxis(spline(nodes, order), 1, 0)) for order in (0, 1))
    return BasisTable(values, slopes * nodes[1], np.zeros((NODES + 1, len(bases))), rhythmic)


def leave_out(sequences, aligned, behaviour):
    """Folds of sequences: by person, or one by one where there are fewer than four people; each gait by itself.

    Alignment is kept: it makes no use of who a sequence is from.

    Returns
    -------
    list of Fold
    """
    groups = np.array([sequence.group for sequence in sequences])
    labels = groups if len(set(groups)) >= FEWEST_PEOPLE else np.arange(len(sequences)).astype(str)
    folds = []
    for label in sorted(set(labels)):
        others = np.flatnonzero(labels != label)
        if len(others) == 0:
            continue
        styles, bases, _ = factorise(aligned.cycles[others], min(behaviour.style_dimension, len(others)))
        table = _spline_table(aligned.grid, bases, behaviour.rhythmic)
        for gait in sorted(set(behaviour.gaits[labels == label])):
            shown = behaviour.gaits[others]
            if gait not in shown:  # nobody else shows it: any gait has to do
                shown = np.full(len(others), gait)
            same = others[shown == gait]
            folds.append(Fold(np.flatnonzero((labels == label) & (behaviour.gaits == gait)), table,
                              *styles_in_gait(styles, groups[others], shown, gait),
                              speed_statistics(behaviour.speeds[same], person_weights(groups[same]))))
    return folds


def _evaluate(table, phase):
    look = Table(table)
    return np.stack([look.evaluate(at)[0] for at in phase])


def residual_shape(sequences, aligned, folds, rhythmic):
    """How the left-out residual divides, by channel; people have equal weight.

    Returns
    -------
    Shape
    """
    harmonics = PERSONAL_HARMONICS if rhythmic else 0
    parts, weights = [], []
    for fold in folds:
        mean, root = style_prior(fold.styles, fold.groups, 1.0)
        prior = np.linalg.inv(root @ root.T)
        for index in fold.left_out:
            y, phase = sequences[index].y, aligned.phases[index]
            basis = _evaluate(fold.table, phase)
            # style by regression with its prior; a residual repeats itself for about twenty frames
            scale = 20 * 0.3 * np.mean(np.var(y, axis=0))
            normal = np.einsum('tjd,tkd->jk', basis, basis) / scale + prior
            style = np.linalg.solve(normal, np.einsum('tjd,td->j', basis, y) / scale + prior @ mean)
            error = y - np.einsum('tjd,j->td', basis, style)
            cycle = fit_cycle(error, phase, harmonics)
            left = LeftOut(cycle[0], cycle[1::2], cycle[2::2], error - harmonic_design(phase, harmonics)[0] @ cycle)
            parts.append((*(one.squares(left) for one in CHANNEL), np.var(np.diff(y, 3, axis=0), axis=0) / 20))
            weights.append(1 / len(fold.left_out))
    weights = np.array(weights) / np.sum(weights)
    *squares, noise = (np.tensordot(weights, np.array(part), axes=1) for part in zip(*parts))
    squares = {one.name: np.maximum(part, one.least) for one, part in zip(CHANNEL, squares)}
    return Shape(squares, np.maximum(noise, 0.1 * sum(squares[one.name] for one in of_kind(SMOOTH, SMOOTHER))))


#: Factors that may all grow together without a change of the criterion.
FACTORS = (*(one.name for one in CHANNEL), 'noise', 'style', 'acceleration')
#: Start of the coordinate search: factors on the shape, rates in 1/s.
START = {**{one.name: one.start for one in CHANNEL}, 'noise': 2.0, 'style': 1.0, 'acceleration': 1.0,
         **{f'{one.name}_decay': one.decay for one in CHANNEL}, 'style_decay': 0.005}
#: What a setting a factor two away from the start costs, in the criterion's logarithms: 0.3 % of the squared error.
#: The criterion hardly notices some settings, and without this some went where nothing but chance sent them. For
#: rhythmic motion only: the start is what suits walking.
PULL = 0.003


def _moves(shape):
    """Settings that change together, in the order they are tried.

    All variances against style prior and phase noise first; decays that matter at the shortest horizons before
    variances, those that matter at none after them. Ingredients that this shape does not have are not moved.
    """
    def decays(*kinds):
        return tuple((f'{one.name}_decay',) for one in of_kind(*kinds) if len(shape.squares[one.name]))

    names = tuple(one.name for one in CHANNEL)
    return ((*names, 'noise'), ('style',), ('noise',), *decays(SMOOTH, SMOOTHER),
            *((name,) for name in names if len(shape.squares[name])),
            *decays(LEVEL), ('acceleration',), *decays(CYCLE), ('style_decay',))


def _residual(shape, values):
    variance, share = {}, {}
    for one in CHANNEL:
        squares = shape.squares[one.name]
        if one.turns:
            pooled = squares.sum(axis=1)
            share[one.name] = pooled / pooled.sum() if len(pooled) and pooled.sum() > 0 else np.zeros(0)
            squares = squares.sum(axis=0) if len(squares) else np.zeros_like(shape.noise)
        variance[one.name] = values[one.name] * squares
    return Residual(
        variance=variance, decay={one.name: values[f'{one.name}_decay'] for one in CHANNEL}, share=share,
        noise=values['noise'] * shape.noise, style_decay=values['style_decay'], style_scale=values['style'],
        calibration_horizon=CALIBRATED, calibration_scale=np.ones(len(CALIBRATED)), check_median=1.0,
        check_weight=CERTAIN)


def _roll_out(behaviour, fold, sequences, aligned, every, horizons):
    """Number of each left-out sequence of a fold, errors and standard deviations of predictions, both (N, H, D)."""
    table = Table(whitened(fold.table, *style_prior(fold.styles, fold.groups, behaviour.residual.style_scale)))
    one = make_filter(behaviour, table)
    channels = len(behaviour.joint_names)
    observed = np.ones(channels, dtype=np.uint8)
    mean, std, velocity = (np.empty((len(horizons), channels)) for _ in range(3))
    wrong = WRONG_PHASE if behaviour.rhythmic else WRONG_SHARE
    for index in fold.left_out:
        y, rate = sequences[index].y, sequences[index].rate_hz
        ahead = np.maximum(np.rint(horizons * rate).astype(int), 1)
        last = len(y) - ahead[-1]
        if last <= 3:
            continue
        sign = 1 if index % 2 else -1
        speed, spread = fold.velocity
        one.start(aligned.phases[index][0] + sign * wrong, speed, wrong ** 2, spread ** 2)
        errors, spreads = [], []
        for frame in range(last):
            one.update(y[frame], observed, 1 / rate if frame else 0.0)
            if frame >= 3 and frame % every == 0:
                one.forecast_into(ahead / rate, mean, std, velocity)
                errors.append(mean - y[frame + ahead])
                spreads.append(std.copy())
        if errors:
            yield index, np.array(errors), np.array(spreads)


def _criterion(behaviour, folds, sequences, aligned, every):
    total, weight = 0.0, 0.0
    for fold in folds:
        try:
            squares = [np.mean(errors ** 2, axis=(0, 2))
                       for _, errors, _ in _roll_out(behaviour, fold, sequences, aligned, every, HORIZONS)]
        except ArithmeticError:
            return np.inf
        if squares:
            total = total + np.mean(squares, axis=0)
            weight += 1
    return float(np.mean(np.log(total / weight))) if weight else np.inf


def _distance(values):
    """Squared distance of settings from the start, in factors of two; a common factor on all `FACTORS` is free."""
    away = {name: np.log2(value / START[name]) for name, value in values.items()}
    common = np.mean([away[name] for name in FACTORS])
    return float(sum((one - common * (name in FACTORS)) ** 2 for name, one in away.items()))


def learn_residual(behaviour, sequences, aligned, rounds=2, progress=False):
    """Add the residual model to a behaviour by the rule at the top of this module.

    Parameters
    ----------
    behaviour : Behaviour
    sequences : list of Sequence
        As aligned.
    aligned : Aligned
    rounds : int
        Rounds of the coordinate search, with steps of a factor 4, then 2, then sqrt(2), ...
    progress : bool
        Show a bar on a terminal.

    Returns
    -------
    Behaviour
        With its ``residual``, and ``acceleration`` moved by the search.
    """
    folds = leave_out(sequences, aligned, behaviour)
    if not folds:  # a single sequence: nothing can be left out; its own residual has to do
        shape = Shape({one.name: np.zeros((0, len(behaviour.noise))) if one.turns else behaviour.noise
                       for one in CHANNEL}, 0.1 * behaviour.noise)
        return replace(behaviour, residual=_residual(shape, START))
    shape = residual_shape(sequences, aligned, folds, behaviour.rhythmic)
    every = 5 if sum(len(sequence.y) for sequence in sequences) < 5000 else 10

    def candidate(values):
        return replace(behaviour, residual=_residual(shape, values),
                       acceleration=behaviour.acceleration * values['acceleration'])

    pull = PULL if behaviour.rhythmic else 0.0

    def cost(values):
        return _criterion(candidate(values), folds, sequences, aligned, every) + pull * _distance(values)

    values = dict(START)
    best = cost(values)
    moves = _moves(shape)
    for step, names in progress_of([(4.0 ** (0.5 ** round_), move) for round_ in range(rounds) for move in moves],
                                   f'residual of {behaviour.name}', shown=progress):
        for factor in (step, 1 / step):
            moved = False
            for _ in range(5):
                trial = dict(values, **{name: values[name] * factor for name in names})
                score = cost(trial)
                if not score < best - 1e-4:
                    break
                values, best, moved = trial, score, True
            if moved:
                break
    plain = _runs(candidate(values), folds, sequences, aligned)
    size = np.median(_calibration(plain)) ** 2
    # the same factor on every variance, prior and noise changes no gain, but makes likelihoods honest
    honest = candidate({**values, **{name: values[name] * size for name in FACTORS}})
    runs = _runs(honest, folds, sequences, aligned)
    median, weight = _usual_checks(runs)
    return replace(honest, residual=replace(
        honest.residual, calibration_scale=_calibration([_levelled(run, median, weight) for run in runs]),
        check_median=median, check_weight=weight))


@dataclass(frozen=True, eq=False)
class _Run:
    """Predictions of a left-out sequence, one a lead of the checks: weight of the run, errors and deviations."""

    weight: float
    errors: np.ndarray
    spreads: np.ndarray
    checks: np.ndarray


def _runs(behaviour, folds, sequences, aligned):
    """Left-out runs, people with equal weight; list of _Run."""
    found = []
    lead = int(np.argmin(np.abs(CALIBRATED - LEAD_S)))
    for fold in folds:
        every = max(round(LEAD_S * sequences[fold.left_out[0]].rate_hz), 1)
        for index, errors, spreads in _roll_out(behaviour, fold, sequences, aligned, every, CALIBRATED):
            spreads = np.maximum(spreads, 1e-9)
            found.append((sequences[index].group, errors, spreads,
                          np.array([check(*pair) for pair in zip(errors[:, lead], spreads[:, lead])])))
    people = [group for group, *_ in found]
    return [_Run(1 / people.count(group), *rest) for group, *rest in found]


def _usual_checks(runs):
    """Median check, and the number of checks it is worth as a start: variance within a run over that between."""
    if len(runs) < 2:
        return 1.0, CERTAIN
    median = float(_weighted_quantile(np.concatenate([run.checks for run in runs]),
                                      np.concatenate([np.full(len(run.checks), run.weight / len(run.checks))
                                                      for run in runs]), 0.5))
    median = max(median, 1e-9)
    weight = np.array([run.weight for run in runs])
    weight /= weight.sum()
    clipped = [np.clip(run.checks / median, 1 / MOST, MOST) for run in runs]
    mean = np.array([np.mean(checks) for checks in clipped])
    within = float(weight @ [np.var(checks) for checks in clipped])
    between = float(weight @ (mean - weight @ mean) ** 2) - within * float(weight @ [1 / len(c) for c in clipped])
    return median, min(max(within, 1e-9) / max(between, 1e-9), CERTAIN)


def _levelled(run, median, weight):
    """The run with standard deviations as the checks up to each prediction leave them."""
    level, spreads = Level(median, weight), run.spreads.copy()
    for row, value in enumerate(run.checks):
        spreads[row] *= level.factor
        level.add(value)  # it is due when the next prediction is made
    return replace(run, spreads=spreads)


def _calibration(runs):
    """Factor on the standard deviation, by horizon, that puts 90 % of left-out errors into the 90 % band."""
    if not runs:
        return np.ones(len(CALIBRATED))
    ratios, weights = [], []
    for run in runs:
        ratio = np.sort(np.abs(run.errors / run.spreads).transpose(1, 0, 2).reshape(len(CALIBRATED), -1))
        ratios.append(ratio[:, np.linspace(0, ratio.shape[1] - 1, 200).astype(int)])
        weights.append(np.full(200, run.weight))
    weights = np.concatenate(weights)
    return np.array([_weighted_quantile(ratio, weights, 0.9) for ratio in np.concatenate(ratios, axis=1)]) \
        / 1.6448536269514722


def _weighted_quantile(values, weights, share):
    """Smallest value with at least ``share`` of the weight at or below it."""
    order = np.argsort(values, kind='stable')
    heap = np.cumsum(weights[order])
    return values[order][np.searchsorted(heap, share * heap[-1])]
