"""Table 8: bad timing: jitter, dropped, late and shuffled samples, and rates from 30 to 1000 Hz.

Each disturbed run is compared with the clean run at 60 Hz: error of the same tests at the same horizons. Samples are
taken from the recording at the instants they are stamped with. A sample that arrives after a newer one is not used, as
in the predictor node.
"""

import numpy as np
from prediction_common import (
    SEED,
    SEED_TESTS,
    SEED_TRAINING,
    SHOWN_COLUMNS,
    others,
    page,
    parallel,
    parser,
    paths,
    predictor,
    recording,
    shown,
)

from style_core import datasets
from style_core.evaluation import disturbed_stamps, error_deg2, paper_horizons, rms_deg, roll_out

CASES = {
    'clean': {},
    **{f'jitter {share:.0%} of the period': {'jitter': share} for share in (0.1, 0.25, 0.5, 1.0)},
    **{f'{share:.0%} dropped': {'dropped': share} for share in (0.05, 0.2, 0.5)},
    **{f'{share:.0%} late by one frame': {'late': share} for share in (0.05, 0.2)},
    '5 % of places shuffled': {'reordered': 0.05},
    'jitter 50 %, 20 % dropped, 5 % late, 5 % shuffled': {
        'jitter': 0.5,
        'dropped': 0.2,
        'late': 0.05,
        'reordered': 0.05,
    },
}
RATES_HZ = (30, 60, 100, 200, 500, 1000)
#: Tests of people never seen, one a subject, beside those of Table 1.
UNSEEN = ('02_01', '07_01', '08_09', '09_03', '16_15', '35_29')


def disturbed(motion, settings, seed):
    """The motion as it arrives, and how many samples were not used."""
    order, stamps = disturbed_stamps(motion.times, seed, **settings)
    newest, used = -np.inf, []
    for frame in order:
        if stamps[frame] > newest + 1e-6:
            used.append(frame)
            newest = stamps[frame]
    return motion.at(stamps[used]), motion.n_frames - len(used)


def score(who, name, what, rate_hz, draw):
    """Squared error by horizon, E, and share of samples not used."""
    training = SEED_TRAINING if who == 'seen' else others(name.split('_')[0])
    source = datasets.trial(name, rate_hz=None).joints(recording(name).joint_names)
    motion = source.resample(rate_hz)
    lost = 0
    if what != 'clean':
        motion, lost = disturbed(motion, CASES[what], SEED + draw)
    horizons = paper_horizons()
    rollout = roll_out(predictor('ours', training, recording(name)), motion, horizons)
    # scored against the recording itself, not against its disturbed samples
    wanted = np.minimum(rollout.times[:, None] + horizons, source.times[-1])
    flat, back = np.unique(wanted.ravel(), return_inverse=True)
    actual = source.at(flat).positions[back.ravel()].reshape(wanted.shape + (-1,))
    actual[rollout.times[:, None] + horizons > source.times[-1] + 1e-6] = np.nan
    keep = rollout.times >= rollout.times[0] + 0.5
    mean, actual = rollout.mean[keep], actual[keep]
    return rms_deg(mean, actual) ** 2, error_deg2(mean, actual), lost / (lost + motion.n_frames)


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    tests = [('seen', name) for name in SEED_TESTS] + [('unseen', name) for name in UNSEEN]
    report = page('8_timing', 'Table 8: bad timing', paths(sorted({name for _, name in tests} | set(SEED_TRAINING))))
    jobs = [
        (*test, what, 60.0, draw) for test in tests for what in CASES for draw in range(1 if what == 'clean' else 3)
    ]
    rate_jobs = [(*test, 'clean', float(rate), 0) for test in tests for rate in RATES_HZ if rate != 60]
    results = dict(zip(jobs + rate_jobs, parallel(score, jobs + rate_jobs, arguments.workers, 'Table 8')))
    report.text(
        'Ours, 50 channels, five tests of people in the training set and six of people never seen (leave one '
        'subject out). E over 25 horizons up to 417 ms from half a second after the start on, three draws of each '
        "disturbance. CMU recordings have 120 Hz, subject 35's runs 30 Hz; faster rates are interpolated, so they "
        'test the arithmetic, not more information.'
    )

    def line(who, what, rate):
        chosen = [result for job, result in results.items() if (job[0], job[2], job[3]) == (who, what, float(rate))]
        return (
            float(np.mean([c[1] for c in chosen])),
            100 * float(np.mean([c[2] for c in chosen])),
            np.sqrt(np.mean([c[0] for c in chosen], axis=0)),
        )

    for who in ('seen', 'unseen'):
        clean = line(who, 'clean', 60)[0]
        rows = []
        for what in CASES:
            error, unused, rms = line(who, what, 60)
            rows.append([what, error, 100 * (error / clean - 1), unused, *shown(rms)])
        report.table(
            f'disturbed_{who}',
            ['disturbance', 'E', 'change, %', 'samples not used, %', *SHOWN_COLUMNS],
            rows,
            f'{who} people: E and RMS by horizon in degrees, at 60 Hz',
        )
        rows = []
        for rate in RATES_HZ:
            error, _, rms = line(who, 'clean', rate)
            rows.append([rate, error, 100 * (error / clean - 1), *shown(rms)])
        report.table(
            f'rate_{who}', ['Hz', 'E', 'change, %', *SHOWN_COLUMNS], rows, f'{who} people: by rate of the samples'
        )
    print(report.write(arguments.output))


if __name__ == '__main__':
    main()
