"""What hangs on the constants of search, loss and bands, seen inside the paper's training list alone.

Every constant that no rule learns is halved and doubled (or moved by a step) with all others held. Judge are the ten
training recordings, each left out of the model that is tried on it - once alone, once with everything of its person:
error of undisturbed runs; error, share lost and time to lock after jumps from other people of the training list and
from other places of the same recording; searches that began without a jump. No test recording is read. Changes are
paired (same recordings, same jumps); the standard error is that over recordings.

python benchmarks/experiments/prediction_constants.py                  about ten minutes on one core
python benchmarks/experiments/prediction_constants.py --only REPLAY    some constants
"""

from contextlib import contextmanager
from functools import cache

import numpy as np
from prediction_common import (
    LEFT_LEG,
    SEED,
    SEED_TRAINING,
    full_model,
    parallel,
    parser,
    paths,
    recording,
    recordings,
    smoothed,
    trained,
)

from style_core.evaluation import coverage, error_deg2, future, mask_out, paper_horizons, roll_out
from style_core.phase_style import (
    bands,
    candidates,
    full,
    full_predictor,
    glance,
    group_of,
    hypothesis,
    loss,
    make_predictor,
    recent_samples,
    residual,
    search,
)
from style_core.report import Report

#: constant -> values tried beside the shipped one; names in lower case are arguments of `loss.InnovationMonitor`.
SEARCH = {
    'PHASES': (16, 64),
    'SPEEDS': ((0.0, -1.2, 1.2), (0.0, -0.6, 0.6, 1.2), (0.0, -2.4, 2.4, 4.8), (0.0, -1.2, 1.2, 2.4, -2.4, 3.6)),
    'GLANCE': (3, 10),
    'WINDOW': (6, 20),
    'LIVE': (2, 6),
    'BUDGET': (4.2, 7.0, 10.0),
    'REPLAY': (2, 8),
    'PEAKS': (2, 6),
    'STALE_S': (0.075, 0.3),
    'MEMORY': (0.7, 0.925),
    'CORRELATED': (2.5, 10.0),
    'TAKE_OVER': (0.5, 2.0),
    'GIVE_UP': (1.5, 6.0),
    'PATIENCE': (6, 24),
    'SEARCH_S': (0.2, 0.8),
    'EXPLAINS': (1.5, 2.0, 4.5, 6.0),
    'LIMIT': (6.0, 8.0, 16.0, 24.0),
    'FEW': (0.075, 0.3),
    'ANEW': (1, 4),
    'window_s': (0.05, 0.2),
    'factor': (2.0, 4.5, 6.0),
    'usual': ((0.3, 1.0), (0.5, 1.0), (1.0, 2.0)),
}
#: Bands alone hang on these; the first two are also used in learning, which is done anew.
BANDS = {'MOST': (2.5, 10.0), 'MEMORY_S': (5.0, 20.0), 'FAR_S': (25 / 60, 100 / 60)}
SILENCE = {'GAP_S': (1.0, 4.0)}
RELEARNED = ('MOST', 'MEMORY_S')
MODULES = (search, hypothesis, candidates, recent_samples, glance, full_predictor, bands, residual, full)

#: Shown of another person before a jump, watched after it at most, left after it at least, frames.
BEFORE, AFTER, LEAST = 30, 120, 55
#: Predictions after a jump are made every so many frames.
EVERY = 5
LOST_PERCENT = 10.0
LOCK_PERCENT = 5.0
#: Silences, s, and the time after them over which errors count.
SILENT_S = (0.7, 1.5)
AFTER_SILENCE = 30
PROTOCOLS = ('recording', 'person')


def shipped(name):
    """The value a constant has in the code."""
    if name.islower():
        monitor = make_predictor(full_model(left_in(SEED_TRAINING[0], 'recording')))._monitor
        return getattr(monitor, name)
    return next(getattr(module, name) for module in MODULES if hasattr(module, name))


@contextmanager
def changed(name, value):
    """Set a constant wherever it is used, for a while."""
    if name is None:
        yield
        return
    if name.islower():
        before = [(full_predictor, 'InnovationMonitor', full_predictor.InnovationMonitor)]
        full_predictor.InnovationMonitor = lambda **given: loss.InnovationMonitor(**{**given, name: value})
    else:
        before = [(module, name, getattr(module, name)) for module in MODULES if hasattr(module, name)]
        for module, *_ in before:
            setattr(module, name, value)
    try:
        yield
    finally:
        for module, key, old in before:
            setattr(module, key, old)


def left_in(name, protocol):
    """Training list without a recording, or without all of its person."""
    return tuple(
        other
        for other in SEED_TRAINING
        if (other != name if protocol == 'recording' else group_of(other) != group_of(name))
    )


def model(name, protocol, constant=None, value=None):
    """Behaviours for the recording ``name``, which they have not seen."""
    training = left_in(name, protocol)
    if constant not in RELEARNED:
        return full_model(training)
    with changed(constant, value):
        motions = recordings(training)
        return trained(motions, f'locomotion, {constant} {value}', motions[0].joint_names)


@cache
def reference(name, protocol):
    """Off-line smoothed phase of a left-out recording."""
    return smoothed(full_model(left_in(name, protocol)), recording(name)).phase


def undisturbed(one, name):
    """Rollout of a run from its start, and how often a search began after the first had ended."""
    rollout = roll_out(one, recording(name), paper_horizons())
    searching = rollout.status != 1
    return rollout, int(np.sum(searching[1:] & ~searching[:-1]))


def jump(one, name, protocol, steady, draws, seed):
    """What happens after jumps from other people and from other places, ``draws`` of each.

    Returns sums over them: squared error over 0.5 to 1 s, the same undisturbed, lost from another person and from
    another place, seconds until the phase is right for good, jumps made.
    """
    rng = np.random.default_rng(seed)
    motion, horizons = recording(name), paper_horizons()
    targets, phase = future(motion, horizons), reference(name, protocol)
    people = [other for other in SEED_TRAINING if group_of(other) != group_of(name)]
    error = undisturbed_error = lock = made = 0.0
    lost = {'person': 0, 'place': 0}
    for kind in sorted(lost) * draws:
        other = recording(people[rng.integers(len(people))]) if kind == 'person' else motion
        begin = int(rng.integers(0, other.n_frames - BEFORE + 1))
        start = int(rng.integers(10, max(motion.n_frames - LEAST, 10) + 1))
        stop = min(start + AFTER, motion.n_frames)
        one.reset()
        for frame in range(BEFORE):
            one.update((start - BEFORE + frame) / 60, other.positions[begin + frame])
        off = []
        for frame in range(start, stop):
            estimate = one.update(frame / 60, motion.positions[frame])
            turn = (estimate.phase - phase[frame]) / (2 * np.pi)
            off.append(100 * abs(turn - round(turn)))
            if 30 <= frame - start < 60 and (frame - start) % EVERY == 0 and np.isfinite(targets[frame][-1, 0]):
                error += np.mean(np.degrees(one.predict(horizons).mean - targets[frame]) ** 2)
                undisturbed_error += np.mean(np.degrees(steady.mean[frame] - targets[frame]) ** 2)
        lost[kind] += np.mean(off[-15:]) > LOST_PERCENT
        lock += max((row + 1 for row, value in enumerate(off) if value > LOCK_PERCENT), default=0) / 60
        made += 1
    return error, undisturbed_error, lost['person'], lost['place'], lock, made


def search_job(constant, value, name, protocol, draws):
    """E, seconds, searches begun, and what `jump` returns, of one recording with one constant changed."""
    behaviours = model(name, protocol)
    seed = SEED + SEED_TRAINING.index(name)
    steady, _ = undisturbed(make_predictor(behaviours), name)
    reference(name, protocol)
    with changed(constant, value):
        one = make_predictor(behaviours)
        rollout, searches = undisturbed(one, name)
        return (
            error_deg2(rollout.mean, rollout.actual),
            recording(name).duration_s,
            searches,
            *jump(one, name, protocol, steady, draws, seed),
        )


def _score(rollout, rows, columns=slice(None)):
    """Coverage of the 90 % band and negative log likelihood a value, both over complete rows."""
    mean, std, actual = (part[rows][..., columns] for part in (rollout.mean, rollout.std, rollout.actual))
    return (
        100 * float(np.mean(coverage(mean, std, actual, 0.9))),
        float(np.mean(0.5 * ((mean - actual) / std) ** 2 + np.log(std))),
    )


def band_job(constant, value, name, protocol):
    """Coverage and log score: everything seen; a leg unseen from half a second on, its joints."""
    behaviours = model(name, protocol, constant, value)
    motion = recording(name)
    observed = mask_out(motion.joint_names, LEFT_LEG, motion.n_frames, first=30)
    hidden = ~observed[-1]
    with changed(constant, value):
        one = make_predictor(behaviours)
        seen = roll_out(one, motion, paper_horizons())
        dark = roll_out(one, motion, paper_horizons(), observed=observed)
    late = dark.complete & (np.arange(len(dark.complete)) >= 30)
    return (*_score(seen, seen.complete), *_score(dark, late, hidden))


def silence_job(constant, value, name, protocol):
    """E over half a second after silences that begin half a second after the start (nan: recording too short)."""
    motion, horizons = recording(name), paper_horizons()
    errors = []
    with changed(constant, value):
        one = make_predictor(model(name, protocol))
        for silent in SILENT_S:
            again = 30 + round(60 * silent)
            frames = [*range(30), *range(again, motion.n_frames)]
            errors.append(np.nan)
            if again + AFTER_SILENCE + len(horizons) <= motion.n_frames:
                part = motion.replace(positions=motion.positions[frames], times=motion.times[frames])
                one.reset()
                wrong = []
                targets = future(motion, horizons)
                for row, frame in enumerate(frames):
                    one.update(part.times[row], part.positions[row])
                    if again <= frame < again + AFTER_SILENCE:
                        wrong.append(np.mean(np.degrees(one.predict(horizons).mean - targets[frame]) ** 2))
                errors[-1] = float(np.mean(wrong))
    return errors


def _paired(values, base):
    """Mean change, %, and its standard error over recordings, of positive figures with their base."""
    change = 100 * np.log(np.asarray(values) / np.asarray(base))
    change = change[np.isfinite(change)]
    if not len(change):
        return float('nan'), float('nan')
    return float(change.mean()), float(change.std(ddof=1) / np.sqrt(len(change))) if len(change) > 1 else float('nan')


def _text(value):
    return ', '.join(f'{part:g}' for part in value) if isinstance(value, tuple) else f'{value:.4g}'


def main(argv=None):
    arguments = parser(__doc__)
    arguments.add_argument('--draws', type=int, default=6, help='jumps of each kind into each recording (default 6)')
    arguments.add_argument('--only', nargs='+', metavar='NAME', help='only these constants')
    arguments.set_defaults(workers=1)
    arguments = arguments.parse_args(argv)
    known = {**SEARCH, **BANDS, **SILENCE}
    unknown = set(arguments.only or ()) - set(known)
    if unknown:
        raise SystemExit(f'{", ".join(sorted(unknown))}: no such constant; there are {", ".join(known)}')

    def variants(group):
        names = [name for name in group if not arguments.only or name in arguments.only]
        return [(name, value) for name in names for value in group[name]]

    units = [(name, protocol) for protocol in PROTOCOLS for name in SEED_TRAINING]
    report = Report(
        'prediction_constants',
        'Constants of search, loss and bands, inside the training list',
        'python benchmarks/experiments/prediction_constants.py',
        SEED,
        paths(SEED_TRAINING),
    )
    report.text(
        f'The ten training recordings of the paper ({", ".join(SEED_TRAINING)}), each left out of the model that is '
        'tried on it: alone, and with everything of its person; means over both. No test recording is read. One '
        'constant is changed, the others held. Changes are means over recordings of the logarithm of the ratio to '
        'the shipped value, same recordings and same jumps, with the standard error over recordings. With so many '
        'rows, a few lie two standard errors out by chance.'
    )

    def measured(job, group, *more):
        jobs = [(*variant, *unit, *more) for variant in [(None, None), *variants(group)] for unit in units]
        found = iter(parallel(job, jobs, arguments.workers, 'constants'))
        return {variant: np.array([next(found) for _ in units]) for variant in [(None, None), *variants(group)]}

    if variants(SEARCH):
        _search_table(report, measured(search_job, SEARCH, arguments.draws), arguments.draws)
    if variants(SILENCE):
        found = measured(silence_job, SILENCE)
        base = found[None, None]
        rows = [
            [name or 'as shipped', _text(shipped(name or 'GAP_S')), _text(value if name else shipped('GAP_S'))]
            + [figure for column in range(len(SILENT_S)) for figure in (
                float(np.nanmean(part[:, column])), *_paired(part[:, column], base[:, column]))]
            for (name, value), part in found.items()
        ]
        report.table(
            'silence',
            ['constant', 'shipped', 'tried',
             *(f'{silent} s silent: {what}' for silent in SILENT_S for what in ('E, next 0.5 s', 'change, %', '±'))],
            rows,
            f'After a silence ({np.sum(np.isfinite(base), axis=0).tolist()} runs are long enough)',
        )
    if variants(BANDS):
        found = measured(band_job, BANDS)
        base = found[None, None]
        rows = []
        for (name, value), part in found.items():
            row = [name or 'as shipped', _text(shipped(name)) if name else '', _text(value) if name else '']
            for column in (0, 2):
                change = part[:, column + 1] - base[:, column + 1]
                row += [part[:, column].mean(), part[:, column].std(), change.mean(),
                        change.std(ddof=1) / np.sqrt(len(change))]
            rows.append([float(cell) if isinstance(cell, np.floating) else cell for cell in row])
        report.table(
            'bands',
            ['constant', 'shipped', 'tried',
             *(f'{what}: {figure}' for what in ('all seen', 'hidden leg') for figure in (
                 'in the 90 % band, %', 'spread over runs', 'change of -log likelihood a value', '±'))],
            rows,
            'Bands (models learned anew for MOST and MEMORY_S); less -log likelihood is better',
        )
    print(report.write(arguments.output))


def _search_table(report, found, draws):
    base = found[None, None]
    rows, better = [], []
    for (name, value), part in found.items():
        error, error_se = _paired(part[:, 0], base[:, 0])
        after, after_se = _paired(part[:, 3], base[:, 3])
        total = part.sum(axis=0)
        rows.append([
            name or 'as shipped', _text(shipped(name)) if name else '', _text(value) if name else '',
            float(part[:, 0].mean()), error, error_se, float(total[3] / total[4]), after, after_se,
            200 * float(total[5] / total[8]), 200 * float(total[6] / total[8]), 1e3 * float(total[7] / total[8]),
            60 * float(total[2] / total[1]),
        ])
        for change, se, other, other_se, what in (
            (error, error_se, after, after_se, 'undisturbed'), (after, after_se, error, error_se, 'after a jump'),
        ):
            if name and change < -1 and change < -2 * se and other < 2 * other_se:
                better.append(f'{name} = {_text(value)} ({what} {change:.1f} ± {se:.1f} %)')
    report.table(
        'search',
        ['constant', 'shipped', 'tried', 'E undisturbed', 'change, %', '±', 'ratio 0.5-1 s after a jump',
         'change of E after a jump, %', '±', 'lost after another person, %', 'after another place, %',
         'time to lock, ms', 'searches without need a minute'],
        rows,
        f'Search and loss; {2 * draws} jumps into each recording and protocol',
    )
    report.text(
        'Better than as shipped by more than 1 % and two standard errors in one figure, not worse by two in the other: '
        + ('; '.join(better) if better else 'none') + '.'
    )


if __name__ == '__main__':
    main()
