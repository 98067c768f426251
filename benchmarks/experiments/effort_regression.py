#!/usr/bin/env python3
"""Effort of interpolated motions: four regressions on real fragments (table 1 and figure 1 of the effort paper).

60 fragments of five contents from several people, 105 space-time interpolations, labels computed from the kinematics.
Random splits into 85 and 20 as in the paper, and leave-one-subject-out, which the paper does not do.
"""
from multiprocessing import Pool

import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt
from effort_data import CONTENTS, EFFORTS, all_fragments, balanced, parser, scale_of
from tqdm import tqdm

from style_core import datasets
from style_core.effort import ALPHA_RANGE, train_library
from style_core.effort.regression import METHODS, features, fit_regression
from style_core.report import Report

COMMAND = 'python benchmarks/experiments/effort_regression.py'


def split_errors(task):
    """Squared errors of every method on one random split; shape (methods, 3)."""
    z, efforts, seed = task
    order = np.random.default_rng(seed).permutation(len(z))
    train, test = order[:85], order[85:]
    return [np.mean((fit_regression(method, z[train], efforts[train], seed=seed)[0].predict(z[test])
                     - efforts[test])**2, axis=0) for method in METHODS]


def main():
    options = parser(__doc__)
    options.add_argument('--splits', type=int, default=500, help='random splits (default 500)')
    options.add_argument('--processes', type=int, default=2)
    args = options.parse_args()

    fragments = balanced(all_fragments(), seed=args.seed)
    scale = scale_of(fragments)
    truth = np.array([f.content for f in fragments])
    library = train_library([f.motion for f in fragments], groups=truth, scale=scale, blends=105, seed=args.seed)
    found = train_library([f.motion for f in fragments], scale=scale, blends=20, seed=args.seed).groups
    z = features(library.contents, library.efforts, *np.array([b[:2] for b in library.blends]).T,
                 [b.alpha for b in library.blends])
    efforts = library.blend_efforts

    tasks = [(z, efforts, args.seed + k) for k in range(args.splits)]
    with Pool(args.processes) as pool:
        errors = np.array(list(tqdm(pool.imap(split_errors, tasks), total=len(tasks), desc='splits', disable=None)))
    mean, error = errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(len(errors))

    trials = sorted({f.trial for f in fragments})
    report = Report('regression', 'Effort of interpolated motions', COMMAND, args.seed,
                    [datasets.trial_path(name) for name in trials])
    report.text(f'{len(fragments)} fragments of {len({f.subject for f in fragments})} people, '
                f'{np.bincount(truth).tolist()} of the contents {", ".join(CONTENTS)}; {len(library.blends)} '
                f'interpolations, {args.splits} splits of 85 and {len(z) - 85}. **Labels are computed from the '
                'kinematics, not given by a movement analyst**, so the figures are not comparable with the paper\'s in '
                'size; what can be compared is the order of the methods.')
    columns = ['method', *EFFORTS, *(f'{e} (standard error)' for e in EFFORTS)]
    rows = [[method, *mean[m], *error[m]] for m, method in enumerate(METHODS)]
    rows.append(['the mean effort (variance)', *efforts.var(axis=0), '', '', ''])
    report.table('random splits', columns, rows, 'Mean squared error, random splits')

    subjects = np.array([f.subject for f in fragments])
    pairs = np.array([b[:2] for b in library.blends])
    squared, counted = {method: [] for method in METHODS}, []
    for subject in sorted(set(subjects)):
        test = (subjects[pairs] == subject).any(axis=1)
        if not test.any() or (~test).sum() < 20:
            continue
        counted.append((subject, int(test.sum()), int((~test).sum())))
        for method in METHODS:
            model, _ = fit_regression(method, z[~test], efforts[~test], seed=args.seed)
            squared[method].append((model.predict(z[test]) - efforts[test])**2)
    rows = []
    for method in METHODS:
        pooled = np.concatenate(squared[method])
        rows.append([method, *pooled.mean(axis=0), *(pooled.std(axis=0, ddof=1) / np.sqrt(len(pooled)))])
    report.table('leave one subject out', columns, rows,
                 'Mean squared error, every interpolation that involves the subject held out ('
                 + ', '.join(f'{s}: {n} of {n + m}' for s, n, m in counted) + ')')

    agreement = sum(len(set(found[truth == c])) for c in range(len(CONTENTS)))
    mixed = sum(len(set(truth[found == g])) > 1 for g in range(found.max() + 1))
    report.table('content', ['true contents', 'groups found', 'groups a content is split into, in all',
                             'groups that mix contents'],
                 [[len(CONTENTS), int(found.max()) + 1, agreement, mixed]], 'Contents found without labels')
    report.table('correlation', ['', *EFFORTS], [[e, *row] for e, row in zip(EFFORTS, np.corrcoef(efforts.T))],
                 'Correlation of the computed efforts')

    best = {e: METHODS[int(np.argmin(mean[:, k]))] for k, e in enumerate(EFFORTS)}
    ratios = mean[2:].min(axis=0) / mean[:2].min(axis=0)
    report.text('Best method in random splits: ' + ', '.join(f'{e}: {m}' for e, m in best.items()) + '. Error of the '
                'better non-linear method over that of the better linear one: '
                + ', '.join(f'{e} {ratio:.2f}' for e, ratio in zip(EFFORTS, ratios)) + '.')

    figure, axes = plt.subplots(3, 3, figsize=(10, 7), sharex=True)
    grid = np.linspace(*ALPHA_RANGE, 31)
    for column, content in enumerate((0, 2, 4)):
        first, second = np.flatnonzero(truth == content)[:2]
        predicted = library.predicted_efforts([first] * len(grid), [second] * len(grid), grid)
        measured = np.array([library.computed_effort(library.blend(type(library.blends[0])(first, second, a)), content)
                             for a in grid])
        straight = (1 - grid[:, None]) * library.efforts[first] + grid[:, None] * library.efforts[second]
        for row, effort in enumerate(EFFORTS):
            axis = axes[row, column]
            axis.plot(grid, measured[:, row], 'k', label='measured')
            axis.plot(grid, predicted[:, row], label='kernel ridge')
            axis.plot(grid, straight[:, row], ':', label='linear interpolation')
            axis.set_ylim(-3.3, 3.3)
            axis.set_ylabel(effort if column == 0 else '')
            axis.set_title(f'{library.names[first]} ~ {library.names[second]}' if row == 0 else '', fontsize=9)
    axes[0, 0].legend(fontsize=8)
    for axis in axes[2]:
        axis.set_xlabel('alpha')
    report.figure(figure, 'along_alpha', 'Computed efforts along alpha: a pair of walking steps, running steps, jumps')
    print(report.write(args.output).read_text())


if __name__ == '__main__':
    main()
