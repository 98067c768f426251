"""Table 6: getting lost and finding back, and how right the phase is.

Wrong starts: the predictor is shown half a second of another motion and, from one frame to the next, a recording of
somebody never seen from a random place on, while it believes itself on track. With another person's motion phase,
speed and style are wrong at once; with another place of the same recording it is the phase alone. 2,700 trials of each.
Phase errors are measured against the off-line smoothed phase and against foot contacts.
"""

import numpy as np
from prediction_common import (
    SEED,
    SUBJECTS,
    full_model,
    others,
    own,
    page,
    parallel,
    parser,
    paths,
    predictor,
    recording,
    run,
    smoothed,
)

from style_core import datasets
from style_core.contacts import foot_contacts
from style_core.evaluation import event_phase_error_percent, future, paper_horizons, phase_error_percent

#: Trials of each kind and method.
TRIALS = {'paper, J = 4': 540, 'ours': 2700, 'ours + nearest histories': 540}
METHODS = tuple(TRIALS)
#: Methods with a phase of their own.
FILTERS = METHODS[:2]
#: Predictions after a jump are made every so many frames.
EVERY = 3
#: Shown before the jump, watched after it, frames.
BEFORE, AFTER = 30, 120
#: Lost: the phase is off by more than this on average over the last quarter second of two seconds, % of the cycle.
LOST_PERCENT = 10.0
LOCK_PERCENT = 5.0
TURN = 2 * np.pi


#: Off-line smoothed phases by subject left out, {subject: {trial: (T,) rad}}; filled before the workers start.
REFERENCE = {}


def reference_phases(subject):
    """Smoothed phases by the model that leaves ``subject`` out: of its trials, and of one of each training person."""
    training = others(subject)
    model = full_model(training)
    trained = [next(n for n in own(person) if _has_contacts(n)) for person in SUBJECTS if person != subject]
    return {name: smoothed(model, recording(name)).phase for name in (*own(subject), *trained)}


def _phase_error(phase, reference):
    """Distance the short way round, % of the cycle."""
    turn = (phase - reference) / TURN
    return 100 * np.abs(turn - np.round(turn))


def jumps(method, subject, kind, count, seed):
    """Random jumps into the recordings of one subject.

    Returns
    -------
    dict of ndarray
        Of each trial: ``phase_error`` (AFTER,) in %, ``error`` (AFTER,) E of the prediction made at each frame after
        the jump, ``steady`` (AFTER,) the same for a run that was on this recording from its start, ``frames`` watched.
    """
    rng = np.random.default_rng(seed)
    training, tests = others(subject), [n for n in own(subject) if recording(n).n_frames >= BEFORE + 60]
    reference = REFERENCE[subject]
    steady = {name: run(method, training, recording(name)) for name in tests}
    filter_ = predictor(method, training, recording(tests[0]))
    horizons = paper_horizons()
    targets = {name: future(recording(name), horizons) for name in tests}
    out = {key: np.full((count, AFTER), np.nan) for key in ('phase_error', 'error', 'steady')}
    out['called'] = np.zeros((count, AFTER), dtype=bool)
    for trial in range(count):
        name = tests[rng.integers(len(tests))]
        motion = recording(name)
        start = int(rng.integers(BEFORE, motion.n_frames - 60 + 1))
        stop = min(start + AFTER, motion.n_frames)
        filter_.reset()
        other = motion if kind == 'place' else recording(training[rng.integers(len(training))])
        begin = int(rng.integers(0, other.n_frames - BEFORE + 1))
        for frame in range(BEFORE):
            filter_.update((start - BEFORE + frame) / 60, other.positions[begin + frame])
        for frame in range(start, stop):
            estimate = filter_.update(frame / 60, motion.positions[frame])
            after = frame - start
            out['phase_error'][trial, after] = _phase_error(estimate.phase, reference[name][frame])
            out['called'][trial, after] = estimate.status != 1
            target = targets[name][frame]
            if after % EVERY == 0 and np.isfinite(target[-1, 0]):
                mean = filter_.predict(horizons).mean
                out['error'][trial, after] = np.mean(np.degrees(mean - target) ** 2)
                out['steady'][trial, after] = np.mean(np.degrees(steady[name].mean[frame] - target) ** 2)
    return out


def phases(method, subject):
    """Phase errors of clean runs over one subject: against the smoothed phase, and at heel strikes."""
    training, tests = others(subject), own(subject)
    reference = REFERENCE[subject]
    per_trial = {}
    found, at_training = {'left': [], 'right': []}, {'left': [], 'right': []}
    for name in tests:
        rollout = run(method, training, recording(name))
        settled = rollout.times >= rollout.times[0] + 0.5
        per_trial[name] = phase_error_percent(rollout.phase[settled], reference[name][settled])
        for foot, times in heel_strikes(name).items():
            times = times[times >= rollout.times[0] + 0.5]
            found[foot].append(np.interp(times, rollout.times, np.unwrap(rollout.phase)))
    for name, phase in ((n, p) for n, p in reference.items() if n not in tests):
        for foot, times in heel_strikes(name).items():
            at_training[foot].append(np.interp(times, recording(name).times, np.unwrap(phase)))
    strikes = []
    for foot in found:
        belongs = np.angle(np.mean(np.exp(1j * np.concatenate(at_training[foot]))))
        here = np.concatenate(found[foot]) if found[foot] else np.empty(0)
        own_mean = np.angle(np.mean(np.exp(1j * here))) if len(here) else np.nan
        strikes.append((event_phase_error_percent(here, belongs), event_phase_error_percent(here, own_mean), len(here)))
    return per_trial, strikes


def _has_contacts(name):
    return 'cmu_30hz' not in str(datasets.trial_path(name))


def heel_strikes(name):
    """Stamps of the heel strikes of each foot, s (none where the recording has no complete root)."""
    if not _has_contacts(name):
        return {}
    contacts = foot_contacts(datasets.trial(name), datasets.skeleton(name))
    return {foot: contact.heel_strikes for foot, contact in contacts.items()}


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    everyone = [name for subject in SUBJECTS for name in own(subject)]
    report = page('6_recovery', 'Table 6: recovery, and the error of the phase', paths(everyone))
    REFERENCE.update(
        zip(SUBJECTS, parallel(reference_phases, [(s,) for s in SUBJECTS], arguments.workers, 'Table 6, phases'))
    )
    walkers = [s for s in SUBJECTS if any(recording(n).n_frames >= BEFORE + 60 for n in own(s))]
    count = {method: trials // len(walkers) for method, trials in TRIALS.items()}
    kinds = {'person': 'another person', 'place': 'another place'}
    jobs = [
        (method, subject, kind, count[method], SEED + number)
        for kind in kinds
        for method in METHODS
        for number, subject in enumerate(walkers)
    ]
    results = dict(zip(jobs, parallel(jumps, jobs, arguments.workers, 'Table 6')))
    report.text(
        f"{count['ours'] * len(walkers)} trials of each kind ({count[METHODS[0]] * len(walkers)}, the first of"
        f' them, for the other methods), on people never seen (leave one subject out; {len(walkers)} '
        f'subjects with recordings of 1.5 s and more). Lost: mean phase error above {LOST_PERCENT:g} % of the '
        'cycle over the last quarter second of the two seconds watched, or of the recording where it ends '
        f'before. Lock: the phase error stays below {LOCK_PERCENT:g} % from then on. Back: E of the predictions '
        'made in the half second after the jump and in the half second from then on, against E of a run that '
        'was never disturbed, at the same instants.'
    )
    rows, curves = [], {}
    for kind, title in kinds.items():
        for method in METHODS:
            parts = [results[job] for job in jobs if job[0] == method and job[2] == kind]
            phase, error, steady = (
                np.concatenate([p[key] for p in parts]) for key in ('phase_error', 'error', 'steady')
            )
            lost, lock = _lost(phase), _lock(phase)
            curves[kind, method] = np.nanmean(error[:, ::EVERY], axis=0), np.nanmean(steady[:, ::EVERY], axis=0)
            ratio = curves[kind, method][0] / curves[kind, method][1]
            above = np.flatnonzero(ratio > 1.5)
            back = EVERY * (above[-1] + 1) if len(above) else 0
            rows.append(
                [
                    title,
                    method,
                    100 * float(lost.mean()),
                    1e3 * float(np.median(lock)) / 60,
                    1e3 * float(np.percentile(lock, 95)) / 60,
                    float(np.nanmean(error[:, :30])),
                    float(np.nanmean(error[:, 30:60])),
                    float(np.nanmean(steady[:, 30:60])),
                    float(np.nanmean(error[:, 30:60]) / np.nanmean(steady[:, 30:60])),
                    1e3 * float(back) / 60 if back < AFTER - EVERY else float('nan'),
                ]
            )
    report.table(
        'jumps',
        [
            'jump from',
            'method',
            'lost, %',
            'lock, median ms',
            'lock, 95th percentile',
            'E, first 0.5 s',
            'E, 0.5-1 s',
            'undisturbed, 0.5-1 s',
            'ratio',
            'back to 1.5 x, ms',
        ],
        rows,
        'After a jump',
    )
    rows = []
    for number, subject in enumerate(walkers):
        row = [subject]
        for kind in kinds:
            part = results['ours', subject, kind, count['ours'], SEED + number]
            row += [
                100 * float(_lost(part['phase_error']).mean()),
                float(np.nanmean(part['error'][:, 30:60]) / np.nanmean(part['steady'][:, 30:60])),
            ]
        rows.append(row)
    report.table(
        'by_subject',
        ['subject', *(f'{t}: {c}' for t in kinds.values() for c in ('lost, %', 'E ratio 0.5-1 s'))],
        rows,
        'Ours by subject',
    )
    phase_jobs = [(method, subject) for method in FILTERS for subject in SUBJECTS]
    measured = dict(zip(phase_jobs, parallel(phases, phase_jobs, arguments.workers, 'Table 6, phase')))
    rows, trials = [], {}
    for method in FILTERS:
        for subject in SUBJECTS:
            per_trial, strikes = measured[method, subject]
            trials.update({(method, name): value for name, value in per_trial.items()})
            counts = sum(s[2] for s in strikes)

            def pooled(index, strikes=strikes, counts=counts):
                squares = [s[index] ** 2 * s[2] for s in strikes if s[2]]
                return float(np.sqrt(sum(squares) / max(counts, 1))) if counts else float('nan')

            rows.append(
                [
                    method,
                    subject,
                    float(np.sqrt(np.mean(np.square(list(per_trial.values()))))),
                    float(np.median(list(per_trial.values()))),
                    pooled(0),
                    pooled(1),
                    counts,
                ]
            )
    report.table(
        'phase',
        [
            'method',
            'subject never seen',
            'RMSE against smoothed, % of cycle',
            'median trial',
            'RMSE at heel strikes',
            "the same, about the person's own mean",
            'heel strikes',
        ],
        rows,
        'Phase error of undisturbed runs from half a second on',
    )
    report.text(
        "At heel strikes the phase is compared with where heel strikes lie on the training people's smoothed phase; "
        "about the person's own mean, with where they lie for this person. Published for comparison (other data, "
        'ankle exosuits): EKF 4.8 %, CNN 5.0 %, transformer 2.7 %; recovery 99 % of 2,700 perturbed trials.'
    )
    worst = sorted((n for m, n in trials if m == 'ours'), key=lambda n: -trials['ours', n])[:8]
    descriptions = {row.name: row.description for row in datasets.labels()}
    report.table(
        'worst_phase',
        ['trial', 'what', *FILTERS],
        [[n, descriptions[n], *(trials[m, n] for m in FILTERS)] for n in worst],
        'Largest phase errors of ours, RMSE in % of the cycle',
    )
    report.figure(_figure(curves), 'jumps', 'E of the predictions made after a jump (solid) and without one (dashed)')
    print(report.write(arguments.output))


def _watched(phase_error):
    return np.isfinite(phase_error).sum(axis=1)


def _lost(phase_error):
    """Whether the last 15 frames watched are off; shape (trials,)."""
    stop = _watched(phase_error)
    return np.array([row[max(end - 15, 0) : end].mean() > LOST_PERCENT for row, end in zip(phase_error, stop)])


def _lock(phase_error):
    """Frames until the phase is right and stays so (all frames watched if never); shape (trials,)."""
    frames = []
    for row, end in zip(phase_error, _watched(phase_error)):
        wrong = np.flatnonzero(row[:end] > LOCK_PERCENT)
        frames.append(wrong[-1] + 1 if len(wrong) else 0)
    return np.array(frames)


def _figure(curves):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    for ax, kind in zip(axes, ('person', 'place')):
        for colour, method in zip(('0.4', '#c44e52', '#4c72b0'), METHODS):
            error, steady = curves[kind, method]
            ax.semilogy(np.arange(0, AFTER, EVERY) / 60, error, color=colour, label=method)
            ax.semilogy(np.arange(0, AFTER, EVERY) / 60, steady, '--', color=colour)
        ax.axvline(0.5, color='0.8', lw=0.8, zorder=0)
        ax.set_title(f'from another {kind}')
        ax.set_xlabel('s after the jump')
        ax.spines[['top', 'right']].set_visible(False)
    axes[0].set_ylabel('E, degrees squared')
    axes[0].legend(frameon=False)
    figure.tight_layout()
    return figure


if __name__ == '__main__':
    main()
