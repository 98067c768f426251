#!/usr/bin/env python3
"""Restyling: asked effort against effort of the result, content kept, and smoothness of the joins.

Held-out sequences of every subject are restyled with a library of everyone else, for a grid of asked efforts.
"""
import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt
from effort_data import EFFORTS, parser, people, skeleton_of

from style_core import datasets
from style_core.effort import restyle, segment, train_library, warp
from style_core.effort.joins import join
from style_core.pictures import stick_strip
from style_core.report import Report

COMMAND = 'python benchmarks/experiments/effort_restyling.py'
TARGETS = (-2.0, -1.0, 0.0, 1.0, 2.0)


def steps_and_jerk(joints):
    """Largest velocity change between frames (rad/s) and 99.9th percentile of jerk (rad/s^3), at 60 Hz."""
    return (np.abs(np.diff(joints, 2, axis=0)).max() * 60,
            np.percentile(np.abs(np.diff(joints, 3, axis=0)), 99.9) * 60**3)


def main():
    options = parser(__doc__)
    options.add_argument('--sequences', type=int, default=2, help='sequences a subject (default 2)')
    args = options.parse_args()

    held = people(args.seed)
    everything, scale, space, generator = held
    asked, got, plain, matching, joins, kept = [], [], [], [], {'plain': [], 'joined': [], 'real': []}, []
    strip = None
    for subject, members, own in held.held_out(args.seed):
        library = train_library([f.motion for f in members], groups=[f.content for f in members], scale=scale,
                                blends=105, seed=args.seed)
        contents = np.array([f.content for f in members])
        for _ in range(args.sequences):
            chosen = [own[k] for k in generator.integers(len(own), size=6)]
            source = space.decode(join([space.encode(f.motion) for f in chosen], 60.0), 60.0, name=f'subject {subject}')
            encoded = space.encode(source).joints * scale
            joins['real'] += [steps_and_jerk(space.encode(f.motion).joints) for f in chosen]
            for effort in range(3):
                for value in TARGETS:
                    target = np.full(3, np.nan)
                    target[effort] = value
                    result = restyle(library, source, target)
                    unverified = restyle(library, source, target, verify=False)
                    asked.append((effort, value))
                    got.append(np.mean([library.computed_effort(library.blend(c.blend), library.groups[c.blend.first])
                                        for c in result.choices], axis=0))
                    plain.append(np.mean([library.computed_effort(library.blend(c.blend),
                                                                  library.groups[c.blend.first])
                                          for c in unverified.choices], axis=0))
                    joints = space.encode(result.motion).joints
                    segments, _ = segment(joints * scale, library.sequences)
                    kept.append([contents[s.fragment] for s in segments]
                                == [contents[c.segment.fragment] for c in result.choices])
                    shuffled = library.sequences[int(np.flatnonzero(contents != chosen[0].content)[0])]
                    matching.append((warp(encoded, joints * scale).mean_cost, warp(encoded, shuffled).mean_cost))
                    parts = [library.blend(c.blend) for c in result.choices]
                    joins['joined'].append(steps_and_jerk(joints))
                    joins['plain'].append(steps_and_jerk(np.concatenate([part.joints for part in parts])))
                    if subject == '08' and effort == 1 and strip is None and value == TARGETS[0]:
                        strong = restyle(library, source, (np.nan, 2.0, np.nan))
                        strip = (source, result.motion, strong.motion)

    asked, got, plain = np.array(asked), np.array(got), np.array(plain)
    report = Report('restyling', 'Restyling by effort', COMMAND, args.seed,
                    [datasets.trial_path(name) for name in sorted({f.trial for f in everything})])
    report.text('Sequences of six fragments of a person whom the library does not hold, restyled to one asked effort '
                'at a time. **Efforts are computed ones**, averaged over the fragments of the result. Verified: the '
                'twelve most promising blends are made and measured; regression only: the paper\'s choice.')
    rows = []
    for effort, name in enumerate(EFFORTS):
        for value in TARGETS:
            at = (asked[:, 0] == effort) & (asked[:, 1] == value)
            rows.append([name, value, got[at, effort].mean(), got[at, effort].std(), plain[at, effort].mean(),
                         plain[at, effort].std()])
    report.table('asked', ['effort', 'asked', 'result, verified', '(spread)', 'result, regression only', '(spread)'],
                 rows, 'Asked effort and effort of the result')
    rows = []
    for effort, name in enumerate(EFFORTS):
        at = asked[:, 0] == effort
        rows.append([name, *(np.corrcoef(asked[at, 1], values[at, effort])[0, 1] for values in (got, plain)),
                     *(np.sqrt(np.mean((asked[at, 1] - values[at, effort])**2)) for values in (got, plain))])
    report.table('agreement', ['effort', 'correlation, verified', 'correlation, regression only', 'RMS miss, verified',
                               'RMS miss, regression only'], rows, 'Agreement of asked and obtained effort')
    matching = np.array(matching)
    report.table('content', ['mean squared distance to the input along the best warp', 'of a fragment of other content',
                             'content sequence found again in the result (%)'],
                 [[matching[:, 0].mean(), matching[:, 1].mean(), 100 * np.mean(kept)]], 'Content preserved')
    rows = [[name, *np.median(np.array(joins[key]), axis=0), *np.max(np.array(joins[key]), axis=0)]
            for key, name in (('real', 'recorded fragments'), ('plain', 'plain concatenation (the paper)'),
                              ('joined', 'continuous joins (ours)'))]
    report.table('joins', ['', 'velocity change a frame, median (rad/s)', 'jerk, median (rad/s^3)',
                           'velocity change a frame, worst', 'jerk, worst'], rows,
                 'Largest velocity change between frames and 99.9th percentile of jerk of each motion')
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), sharey=True)
    for effort, (axis, name) in enumerate(zip(axes, EFFORTS)):
        at = asked[:, 0] == effort
        for values, label, shift in ((got, 'verified', -0.08), (plain, 'regression only', 0.08)):
            axis.plot(asked[at, 1] + shift, values[at, effort], '.', alpha=0.5, label=label)
        axis.plot([-2, 2], [-2, 2], 'k:', lw=1)
        axis.set_xlabel(f'{name} asked')
    axes[0].set_ylabel('computed effort of the result')
    axes[0].legend(fontsize=8)
    report.figure(figure, 'asked', 'Asked effort and computed effort of the result')
    source, light, strong = strip
    figure = stick_strip(skeleton_of('08'), [('input', source), ('weight -2', light), ('weight +2', strong)], count=12)
    report.figure(figure, 'strip', 'Subject 08 as recorded, restyled lighter and stronger')
    print(report.write(args.output).read_text())


if __name__ == '__main__':
    main()
