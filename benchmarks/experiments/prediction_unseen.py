"""Table 4: people never seen: leave one subject out over all locomotion.

Each of six subjects is predicted by methods trained on the walking and running of the five others. Beside them: the
start-walk-stop recordings of subject 131, which no method was trained for.
"""

import numpy as np
from prediction_common import (
    SHOWN_COLUMNS,
    STARTS,
    SUBJECTS,
    by_start,
    others,
    own,
    page,
    parallel,
    parser,
    paths,
    recording,
    run,
    shown,
)

from style_core import datasets
from style_core.evaluation import error_deg2, rms_deg

COMPARED = ('zero velocity', '5 nearest histories', 'paper, J = 4', 'ours', 'ours + nearest histories')
STOPPING = ('131_01', '131_02', '131_09', '131_12')


def fold(method, subject):
    """Per trial of ``subject``: E, squared error by horizon, instants, share of instants called LOST."""
    return _scores(method, others(subject), own(subject))


def _scores(method, training, tests):
    scores = {}
    for name in tests:
        rollout = run(method, training, recording(name))
        whole = rollout.rows(rollout.complete)
        scores[name] = (
            error_deg2(whole.mean, whole.actual),
            rms_deg(whole.mean, whole.actual) ** 2,
            len(whole.times),
            float(np.mean(rollout.status == 2)),
        )
    return scores


def outside(method):
    """Recordings that start, walk and stop, by methods trained on all locomotion."""
    everyone = tuple(name for subject in SUBJECTS for name in own(subject))
    return _scores(method, everyone, STOPPING)


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    everyone = [name for subject in SUBJECTS for name in own(subject)]
    report = page('4_unseen', 'Table 4: people never seen (leave one subject out)', paths(everyone + list(STOPPING)))
    jobs = [(method, subject) for method in reversed(COMPARED) for subject in SUBJECTS]
    folds = dict(zip(jobs, parallel(fold, jobs, arguments.workers, 'Table 4')))
    errors = {
        method: {name: score[0] for subject in SUBJECTS for name, score in folds[method, subject].items()}
        for method in COMPARED
    }
    by_subject = {
        method: {
            subject: float(np.mean([score[0] for score in folds[method, subject].values()])) for subject in SUBJECTS
        }
        for method in COMPARED
    }
    report.text(
        f'{len(everyone)} walking, slow walking and running trials of {len(SUBJECTS)} subjects, 50 channels, '
        'E in degrees squared over the next 25 frames at 60 Hz. The mean over people gives each subject the '
        'same weight; subject 35 alone has 33 of the trials.'
    )
    rows = []
    for method in COMPARED:
        worst = max(by_subject[method], key=by_subject[method].get)
        rows.append(
            [
                method,
                float(np.mean(list(by_subject[method].values()))),
                float(np.mean(list(errors[method].values()))),
                *by_subject[method].values(),
                f'{worst} ({by_subject[method][worst]:.1f})',
            ]
        )
    report.table(
        'error',
        ['method', 'mean over people', 'mean over trials', *(f'subject {s}' for s in SUBJECTS), 'worst subject'],
        rows,
        'E by subject',
    )
    later = [(method, others(subject), own(subject)) for method in COMPARED[1:] for subject in SUBJECTS]
    by_person = np.array(
        [errors.mean(axis=0) for errors in parallel(by_start, later, arguments.workers, 'Table 4, later starts')]
    ).reshape(len(COMPARED) - 1, len(SUBJECTS), -1)
    report.table(
        'starts',
        ['method', 'mean', *STARTS],
        [[m, float(one.mean()), *one.mean(axis=0)] for m, one in zip(COMPARED[1:], by_person)],
        'E, mean over people, where the recordings begin so many frames later: how much chance there is in it',
    )
    rows = []
    for method in COMPARED:
        squares = [
            np.average(
                [score[1] for score in folds[method, s].values()],
                axis=0,
                weights=[score[2] for score in folds[method, s].values()],
            )
            for s in SUBJECTS
        ]
        rows.append([method, *shown(np.sqrt(np.mean(squares, axis=0)))])
    report.table('rms', ['method', *SHOWN_COLUMNS], rows, 'RMS error by horizon, degrees, mean over people')
    names = list(errors['ours'])
    near, still = errors['5 nearest histories'], errors['zero velocity']
    rows = [
        [
            method,
            100 * float(np.mean([errors[method][n] < near[n] for n in names])),
            100 * float(np.mean([errors[method][n] > still[n] for n in names])),
            ', '.join(n for n in names if errors[method][n] > still[n]) or '-',
        ]
        for method in COMPARED
    ]
    report.table(
        'shares',
        ['method', '% of trials better than nearest histories', '% worse than zero velocity', 'which'],
        rows,
        'Trial by trial',
    )
    worst = sorted(names, key=lambda n: errors['ours'][n] / near[n], reverse=True)[:10]
    descriptions = {row.name: row.description for row in datasets.labels()}
    lost = {n: score[3] for s in SUBJECTS for n, score in folds['ours', s].items()}
    report.table(
        'worst',
        ['trial', 'what', *COMPARED, 'ours / nearest', '% of time LOST'],
        [
            [n, descriptions[n], *(errors[m][n] for m in COMPARED), errors['ours'][n] / near[n], 100 * lost[n]]
            for n in worst
        ],
        'The ten trials where ours gains least over nearest histories',
    )
    report.table(
        'trials', ['trial', *COMPARED], [[n, *(errors[m][n] for m in COMPARED)] for n in names], 'All trials, E'
    )
    extra = [('ours',), ('5 nearest histories',), ('zero velocity',)]
    stopping = dict(zip(extra, parallel(outside, extra, arguments.workers, 'Table 4, stops')))
    report.table(
        'stopping',
        ['trial', 'what', *(m for (m,) in extra), '% of time LOST (ours)'],
        [[n, descriptions[n], *(stopping[m][n][0] for m in extra), 100 * stopping[('ours',)][n][3]] for n in STOPPING],
        'Not locomotion throughout: people who start, turn, stop. Trained on all '
        'locomotion trials; nothing of these people or of standing still was in the training',
    )
    report.figure(
        _figure(errors, names),
        'trials',
        'Each point is a trial of somebody never seen. Below the diagonal ours is better.',
    )
    print(report.write(arguments.output))


def _figure(errors, names):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4.8))
    for ax, other in zip(axes, ('5 nearest histories', 'zero velocity')):
        for colour, subject in zip(plt.cm.tab10.colors, SUBJECTS):
            mine = [n for n in names if n.startswith(subject + '_')]
            ax.loglog(
                [errors[other][n] for n in mine],
                [errors['ours'][n] for n in mine],
                'o',
                color=colour,
                ms=5,
                alpha=0.8,
                label=f'subject {subject}',
            )
        span = [min(errors['ours'].values()) * 0.8, max(errors[other].values()) * 1.2]
        ax.plot(span, span, 'k-', lw=0.8)
        ax.set_xlabel(f'E of {other}, degrees squared')
        ax.set_ylabel('E of ours')
        ax.spines[['top', 'right']].set_visible(False)
    axes[0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    return figure


if __name__ == '__main__':
    main()
