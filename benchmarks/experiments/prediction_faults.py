"""Table 9: sensors that lie: spikes, dead and frozen encoders, whole observations that are garbage.

Each run with a fault is compared with the run without at the same instants: the half second after it, or all that
follows where it lasts. Joints whose sensor lies for good are left out of the error, so what counts is what the lie does
to the rest. No method is told which sensor it is.
"""

import numpy as np
from prediction_common import (
    FRAMES_AHEAD,
    LEFT_LEG,
    SEED,
    SEED_TESTS,
    SEED_TRAINING,
    full_predictor,
    others,
    page,
    parallel,
    parser,
    paths,
    predictor,
    recording,
)
from prediction_timing import UNSEEN

from style_core.evaluation import mask_out, paper_horizons, roll_out
from style_core.predictor import Status

METHODS = ('ours', 'ours without rejection', 'paper, J = 4', '5 nearest histories')
DRAWS = 6
#: Frames over which a fault that does not last is scored.
AFTER = 30


def spike(size):
    def fault(y, at, joint, rng, names):
        y[at, joint] += size

    return fault


def several(y, at, joint, rng, names):
    y[at, rng.permutation(y.shape[1])[:5]] += rng.standard_normal(5)


def all_zero(count):
    def fault(y, at, joint, rng, names):
        y[at : at + count] = 0

    return fault


def noisy(y, at, joint, rng, names):
    for frame in at + np.flatnonzero(rng.random(len(y) - at) < 0.02):
        y[frame, rng.integers(y.shape[1])] += 2 * rng.standard_normal()


def constant(value):
    def fault(y, at, joint, rng, names):
        y[at:, joint] = y[at, joint] + value

    return fault


def leg_zero(y, at, joint, rng, names):
    y[at:, ~mask_out(names, LEFT_LEG, 1)[0]] = 0


#: Fault, whether it lasts, whether it begins with the recording.
CASES = {
    **{f'one joint off by {size} rad, one sample': (spike(size), False, False) for size in (0.1, 0.3, 1.0, 3.0)},
    'five joints off by 1 rad (normal), one sample': (several, False, False),
    'all joints 0, one sample': (all_zero(1), False, False),
    'all joints 0, three samples': (all_zero(3), False, False),
    'one joint of every fiftieth sample off by 2 rad (normal)': (noisy, True, False),
    'one encoder dead, 2 rad off': (constant(2.0), True, False),
    'one encoder dead, 0.5 rad off': (constant(0.5), True, False),
    'one encoder frozen where it is': (constant(0.0), True, False),
    'left leg reads 0': (leg_zero, True, False),
    'one encoder dead from the start, 2 rad off': (constant(2.0), True, True),
    'first sample: all joints 0': (all_zero(1), False, True),
    'first sample: one joint off by 3 rad': (spike(3.0), False, True),
}


def made(method, training, motion):
    if method == 'ours without rejection':
        return full_predictor(training, without=('rejection',))
    return predictor(method, training, motion)


def score(method, who, name):
    """By case: E without and with the fault, share of observations not TRACKING without and with it."""
    training = SEED_TRAINING if who == 'seen' else others(name.split('_')[0])
    motion = recording(name)
    horizons = paper_horizons(FRAMES_AHEAD)
    one = made(method, training, motion)
    clean = roll_out(one, motion, horizons)
    whole = clean.complete
    wrong = np.degrees(clean.mean - clean.actual) ** 2
    found = {}
    for number, (what, (fault, lasts, at_once)) in enumerate(CASES.items()):
        rows = []
        for draw in range(DRAWS):
            rng = np.random.default_rng([SEED, number, draw, int(name.replace('_', ''))])
            first = min(40, whole.sum() // 2)
            at = 0 if at_once else int(rng.integers(first, max(first + 1, whole.sum() - AFTER)))
            moving = np.flatnonzero(np.ptp(motion.positions, axis=0) > 0.2)
            joint = int(rng.choice(moving))
            y = motion.positions.copy()
            fault(y, at, joint, rng, motion.joint_names)
            faulty = roll_out(one, motion.replace(positions=y), horizons)
            frames = np.flatnonzero(whole)
            frames = frames[(frames >= at) & (lasts | (frames < at + AFTER))]
            lying = (y != motion.positions).sum(axis=0) > AFTER
            errors = [part[frames][:, :, ~lying] for part in (wrong, np.degrees(faulty.mean - clean.actual) ** 2)]
            rows.append([*(part.mean() for part in errors),
                         *(np.mean(run.status[frames] != Status.TRACKING) for run in (clean, faulty))])
        found[what] = np.mean(rows, axis=0)
    return found


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    tests = [('seen', name) for name in SEED_TESTS] + [('unseen', name) for name in UNSEEN]
    names = sorted({name for _, name in tests} | set(SEED_TRAINING))
    report = page('9_faults', 'Table 9: sensors that lie', paths(names))
    jobs = [(method, *test) for test in tests for method in METHODS]
    results = dict(zip(jobs, parallel(score, jobs, arguments.workers, 'Table 9')))
    report.text(
        '50 channels at 60 Hz, five tests of people in the training set and six of people never seen (leave one '
        f'subject out), {DRAWS} draws of instant and joint for each. E over 25 horizons up to 417 ms, the mean over '
        f'the {AFTER} instants from the fault on, or over all that follow where it lasts; the joints that lie for good '
        'are left out. "Not tracking" is the share of these instants at which our predictor says ACQUIRING or LOST.'
    )
    for who in ('seen', 'unseen'):
        rows = []
        for what in CASES:
            row = [what]
            for method in METHODS:
                before, after, calm, upset = np.mean([results[method, who, name][what]
                                                      for group, name in tests if group == who], axis=0)
                row += [before, after, after / before]
                if method.startswith('ours'):
                    row += [100 * calm, 100 * upset]
            rows.append(row)
        columns = []
        for method in METHODS:
            columns += [f'{method}: E without', 'with the fault', 'ratio']
            if method.startswith('ours'):
                columns += ['not tracking without, %', 'with, %']
        report.table(f'faults_{who}', ['fault', *columns], rows, f'{who} people: E, degrees squared')
    print(report.write(arguments.output))


if __name__ == '__main__':
    main()
