"""What each ingredient of the filter is worth: parts left out one at a time, models not trained again."""

import numpy as np
from prediction_common import (
    SEED_TESTS,
    SEED_TRAINING,
    SUBJECTS,
    full_predictor,
    others,
    own,
    page,
    parallel,
    parser,
    paths,
    recording,
    run,
)
from prediction_seed import joined

from style_core.evaluation import coverage, error_deg2, paper_horizons, roll_out, windows_clear_of

VARIANTS = {
    'everything': (),
    'without the slow offset': ('offset',),
    'without the fast residual': ('fast',),
    'without both (white noise carries them)': ('offset', 'fast'),
    'without the personal cycle': ('personal',),
    'without the prior on style': ('prior',),
    'without drift of the style': ('drift',),
    'without calibration by horizon': ('calibration',),
    'without the search at the start': ('search',),
    'without restart': ('restart',),
    'without standing still': ('still',),
    'without rejection of sensors that lie': ('rejection',),
}


def variant(without, subject):
    """E of each trial and coverage counts; ``subject`` None means the paper's protocol."""
    training, tests = (SEED_TRAINING, SEED_TESTS) if subject is None else (others(subject), own(subject))
    predictor = full_predictor(training, without=without)
    errors, inside, weight = {}, [], []
    for name in tests:
        rollout = roll_out(predictor, recording(name), paper_horizons())
        whole = rollout.rows(rollout.complete)
        errors[name] = error_deg2(whole.mean, whole.actual)
        inside.append(np.mean(coverage(whole.mean, whole.std, whole.actual, 0.9)))
        weight.append(len(whole.times))
    clear = float('nan')
    if subject is None:
        sequence, seams = joined()
        rollout = roll_out(predictor, sequence, paper_horizons())
        kept = rollout.rows(windows_clear_of(rollout.times, rollout.horizons, seams))
        clear = error_deg2(kept.mean, kept.actual)
    return errors, float(np.average(inside, weights=weight)), clear, sum(weight)


def paper(subject):
    """The same for the paper's method, J = 4."""
    training, tests = (SEED_TRAINING, SEED_TESTS) if subject is None else (others(subject), own(subject))
    rollouts = [run('paper, J = 4', training, recording(name)) for name in tests]
    return {name: error_deg2(r.mean, r.actual) for name, r in zip(tests, rollouts)}


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    everyone = [name for subject in SUBJECTS for name in own(subject)]
    report = page('ablation', 'Ablation: what each ingredient is worth', paths(sorted(set(everyone) | set(SEED_TESTS))))
    jobs = [(without, subject) for subject in (None, *SUBJECTS) for without in VARIANTS.values()]
    results = dict(zip(jobs, parallel(variant, jobs, arguments.workers, 'Ablation')))
    base = {subject: paper(subject) for subject in (None, *SUBJECTS)}

    def means(errors):
        people = [np.mean(list(errors[s].values())) for s in SUBJECTS]
        return (
            float(np.mean(list(errors[None].values()))),
            float(np.mean(people)),
            float(np.mean([e for s in SUBJECTS for e in errors[s].values()])),
        )

    rows = [["paper's method, J = 4", *means(base), float('nan'), float('nan')]]
    for title, without in VARIANTS.items():
        errors = {subject: results[without, subject][0] for subject in (None, *SUBJECTS)}
        cover = np.average(
            [results[without, s][1] for s in SUBJECTS], weights=[results[without, s][3] for s in SUBJECTS]
        )
        rows.append([title, *means(errors), results[without, None][2], 100 * float(cover)])
    report.text(
        'E in degrees squared over the next 25 frames at 60 Hz, 50 channels. Models are trained once with '
        'everything; a part is left out when predicting. Coverage is of the 90 % band over all horizons, unseen '
        'people.'
    )
    report.table(
        'parts',
        [
            'filter',
            "E, paper's protocol",
            'E, unseen, mean over people',
            'E, unseen, mean over trials',
            'E, joined sequence clear of seams',
            'coverage of 90 %',
        ],
        rows,
        'Parts left out',
    )
    print(report.write(arguments.output))


if __name__ == '__main__':
    main()
