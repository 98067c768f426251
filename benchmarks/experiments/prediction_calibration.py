"""Table 5: does the predictor know how wrong it is? Coverage of 50 % and 90 % bands, log score, CRPS.

Unseen: leave one subject out over all locomotion. Seen: other recordings of people in the training set (the tests of
Table 1). Masked: the left leg hidden from half a second on; scored on the hidden channels alone.
"""

import numpy as np
from prediction_common import (
    LEFT_LEG,
    SEED_TESTS,
    SEED_TRAINING,
    SHOWN_COLUMNS,
    SUBJECTS,
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
from scipy.special import ndtr, ndtri

from style_core.evaluation import mask_out

LEVELS = (0.5, 0.9)
GROUPS = {
    'legs': ('femur', 'tibia', 'foot', 'toes'),
    'trunk': ('lowerback', 'upperback', 'thorax'),
    'neck and head': ('neck', 'head'),
    'arms': ('clavicle', 'humerus', 'radius', 'wrist', 'hand'),
}
FIRST_HIDDEN = 30


def group_index(joint_names):
    """Number of the group of each channel, shape (D,)."""
    return np.array(
        [
            next(index for index, parts in enumerate(GROUPS.values()) if any(part in name for part in parts))
            for name in joint_names
        ]
    )


def tally(kind, subject, method='ours'):
    """Counts and sums over one subject's trials: arrays over (25 horizons, channel groups)."""
    training, tests = (SEED_TRAINING, _seen(subject)) if kind.startswith('seen') else (others(subject), own(subject))
    total = None
    for name in tests:
        motion = recording(name)
        hidden = np.zeros((motion.n_frames, motion.n_joints), dtype=bool)
        if kind.endswith('masked'):
            hidden = ~mask_out(motion.joint_names, LEFT_LEG, motion.n_frames, first=FIRST_HIDDEN)
        rollout = run(method, training, motion, observed=~hidden)
        counted = hidden if kind.endswith('masked') else np.ones_like(hidden)
        counted = counted[:, None, :] & np.isfinite(rollout.actual) & rollout.complete[:, None, None]
        sums = _sums(rollout, counted, group_index(motion.joint_names))
        total = sums if total is None else {key: total[key] + sums[key] for key in sums}
    return total


def _seen(subject):
    trained = {name.split('_')[0] for name in SEED_TRAINING}
    return [name for name in SEED_TESTS if name.startswith(subject + '_') and subject in trained]


def _sums(rollout, counted, groups):
    error = rollout.actual - rollout.mean
    z = np.abs(error) / rollout.std
    with np.errstate(invalid='ignore'):
        density = np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
        parts = {
            'n': np.ones(z.shape),
            'square': np.degrees(error) ** 2,
            'spread': np.degrees(rollout.std) ** 2,
            'log': -0.5 * z * z - np.log(rollout.std) - 0.5 * np.log(2 * np.pi),
            'crps': np.degrees(rollout.std * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))),
            **{level: z <= ndtri(0.5 + 0.5 * level) for level in LEVELS},
        }

    def by_group(values):
        per_channel = np.where(counted, values, 0.0).sum(axis=0)  # (H, D)
        return np.stack([per_channel[:, groups == index].sum(axis=1) for index in range(len(GROUPS))], axis=1)

    return {key: by_group(values) for key, values in parts.items()}


def pooled(tallies, key, axis):
    """Mean of ``key`` over everything but the horizon (``axis=1``) or also over horizons (``axis=None``)."""
    return sum(t[key] for t in tallies).sum(axis=axis) / sum(t['n'] for t in tallies).sum(axis=axis)


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    everyone = [name for subject in SUBJECTS for name in own(subject)]
    report = page('5_calibration', 'Table 5: calibration of the bands', paths(everyone))
    kinds = ('unseen', 'unseen, masked', 'seen', 'seen, masked')
    jobs = [(kind, subject) for kind in kinds for subject in SUBJECTS if kind.startswith('unseen') or _seen(subject)]
    tallies = dict(zip(jobs, parallel(tally, jobs, arguments.workers, 'Table 5')))
    by_kind = {kind: [tallies[job] for job in jobs if job[0] == kind] for kind in kinds}
    report.text(
        'Share of what happened that lay inside the band that should hold 50 % or 90 % of it. Pooled over all '
        'trials, so long trials count more; by subject in the second table. Log score in nats a channel (of '
        'the density per rad, higher is better), CRPS in degrees (lower is better).'
    )
    for level in LEVELS:
        rows = [
            [
                kind,
                *(100 * np.array(shown(pooled(by_kind[kind], level, 1)))).tolist(),
                100 * float(np.min(pooled(by_kind[kind], level, 1))),
                100 * float(np.max(pooled(by_kind[kind], level, 1))),
            ]
            for kind in kinds
        ]
        report.table(
            f'coverage_{100 * level:.0f}',
            ['who', *SHOWN_COLUMNS, 'lowest of 25 horizons', 'highest'],
            rows,
            f'Coverage of the {100 * level:.0f} % band, %',
        )
    rows = [
        [
            subject,
            *(100 * np.array(shown(pooled([tallies['unseen', subject]], 0.9, 1)))).tolist(),
            100 * float(pooled([tallies['unseen', subject]], 0.9, None)),
            100 * float(pooled([tallies['unseen', subject]], 0.5, None)),
        ]
        for subject in SUBJECTS
    ]
    report.table(
        'by_subject',
        ['subject', *SHOWN_COLUMNS, 'all horizons', '50 % band, all horizons'],
        rows,
        'Coverage of the 90 % band by unseen subject, %',
    )
    rows = []
    for kind in kinds:
        total = {key: sum(t[key] for t in by_kind[kind]) for key in by_kind[kind][0]}
        for index, group in enumerate(GROUPS):
            if total['n'][:, index].any():
                rows.append([kind, group, *shown(100 * total[0.9][:, index] / total['n'][:, index])])
    report.table('by_group', ['who', 'channels', *SHOWN_COLUMNS], rows, 'Coverage of the 90 % band by channel group, %')
    for key, title in (('log', 'Log score, nats a channel'), ('crps', 'CRPS, degrees')):
        report.table(
            key, ['who', *SHOWN_COLUMNS], [[kind, *shown(pooled(by_kind[kind], key, 1))] for kind in kinds], title
        )
    rows = [
        [kind, *shown(np.sqrt(pooled(by_kind[kind], 'square', 1))), *shown(np.sqrt(pooled(by_kind[kind], 'spread', 1)))]
        for kind in kinds
    ]
    report.table(
        'spread',
        ['who', *(f'error {c}' for c in SHOWN_COLUMNS), *(f'std {c}' for c in SHOWN_COLUMNS)],
        rows,
        'RMS error and RMS predicted standard deviation, degrees',
    )
    report.figure(_figure(tallies, by_kind), 'coverage', 'Coverage of the 90 % band by horizon. Grey: 88-92 %.')
    print(report.write(arguments.output))


def _figure(tallies, by_kind):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    frames = np.arange(1, 26) * 1000 / 60
    for kind, some in by_kind.items():
        axes[0].plot(frames, 100 * pooled(some, 0.9, 1), label=kind)
    for subject in SUBJECTS:
        axes[1].plot(frames, 100 * pooled([tallies['unseen', subject]], 0.9, 1), label=f'subject {subject}')
    for ax in axes:
        ax.axhspan(88, 92, color='0.9')
        ax.set_xlabel('ms ahead')
        ax.legend(frameon=False, fontsize=8)
        ax.spines[['top', 'right']].set_visible(False)
    axes[0].set_ylabel('% inside the 90 % band')
    figure.tight_layout()
    return figure


if __name__ == '__main__':
    main()
