"""How well recordings are aligned: a picture like figure 1 of Pan and Torresani 2009, and the spread of foot contacts.

All recordings of subjects 07, 08, 09 and 35, unlabelled. An aligned recording puts a heel strike of a foot at the
same phase in every cycle. Measured against contacts found from the skeleton: the circular standard deviation of
their phases in % of a cycle, for the locomotion model, for a single latent cycle (the cyclic continuous profile
model), and for a phase by autocorrelation with Fourier cycles (functional analysis). The second table applies the
learned models to people who were not in the training data.
"""
from locomotion_common import (CHANNELS, actions, circular_spread, heel_strikes, linear_phases, names,  # isort: skip
                               parser, recording)

import matplotlib.pyplot as plt
import numpy as np
from sklearn.decomposition import PCA

from style_core import datasets
from style_core.datasets import trial_path
from style_core.locomotion.infer import analyze
from style_core.locomotion.learn import features_of, learn, standard
from style_core.locomotion.pictures import alignment_picture
from style_core.report import Report

RATE_HZ = 60.0
METHODS = ('locomotion model', 'single latent cycle', 'autocorrelation')
NEW_PEOPLE = ('02', '16')


def strike_phases(trials, phases):
    """Phases of heel strikes: {foot: [array of a recording, ...]} from (times, phases) of each."""
    found = {'left': [], 'right': []}
    for name, (times, phase) in zip(trials, phases):
        for foot, strikes in heel_strikes(name).items():
            inside = strikes[(strikes >= times[0]) & (strikes <= times[-1])]
            found[foot].append(np.interp(inside, times, phase))
    return found


def spreads(found, chosen):
    """Spread over recordings ``chosen`` of left, right and both (root mean square), % of cycle; and the number of
    strikes."""
    each = [np.concatenate([found[foot][k] for k in chosen]) for foot in ('left', 'right')]
    values = [circular_spread(v) for v in each]
    return [*values, float(np.sqrt(np.mean(np.square(values)))), sum(map(len, each))]


def main():
    """Learn, align, measure, draw."""
    options = parser(__doc__)
    options.add_argument('--styles', type=int, default=6)
    args = options.parse_args()
    trials = names()
    motions = [recording(name) for name in trials]
    label = np.array(actions(trials))
    models = {METHODS[0]: learn(motions, args.styles, seed=args.seed, rate_hz=RATE_HZ, progress=True),
              METHODS[1]: learn(motions, 1, seed=args.seed, rate_hz=RATE_HZ, restarts=3, progress=True)}
    features, frames, rate = features_of(motions, RATE_HZ)
    centre, scale = standard(frames, features)
    scaled = [(x - centre) / scale for x in frames]
    analyses = {method: [analyze(model, motion) for motion in motions] for method, model in models.items()}
    times = [a.times for a in analyses[METHODS[0]]]
    phases = {method: [(a.times, a.phase) for a in found] for method, found in analyses.items()}
    phases[METHODS[2]] = list(zip(times, linear_phases(scaled, rate)[0]))

    report = Report(
        'alignment',
        'Alignment of unlabelled recordings',
        'python benchmarks/experiments/locomotion_alignment.py',
        args.seed,
        [trial_path(name) for name in trials],
    )
    report.text(
        f'{len(trials)} recordings of subjects 07, 08, 09 and 35 at {RATE_HZ:g} Hz, '
        f'{len(features.joint_names)} channels, '
        f'{args.styles} styles. Heel strikes from the skeletons; where a foot touches down is a matter of the gait too '
        '(a runner lands elsewhere in the cycle than a walker), so walks and runs are also shown by '
        'themselves, and the '
        'last rows compare each recording only with itself.'
    )
    groups = [
        ('all', np.arange(len(trials))),
        ('walks', np.flatnonzero(label != 'run')),
        ('runs', np.flatnonzero(label == 'run')),
    ]
    style = np.array([a.style for a in analyses[METHODS[0]]])
    rows = []
    for method in METHODS:
        found = strike_phases(trials, phases[method])
        rows += [[method, title, *spreads(found, chosen)] for title, chosen in groups]
        within = [spreads(found, np.flatnonzero(style == c)) for c in np.unique(style)]
        count = np.array([w[3] for w in within])
        rows.append(
            [
                method,
                'within the styles found',
                *[float(np.sqrt(count @ np.square([w[i] for w in within]) / count.sum())) for i in range(3)],
                int(count.sum()),
            ]
        )
    report.table('spread', ['method', 'recordings', 'left', 'right', 'both', 'strikes'], rows,
                 'Circular standard deviation of the phase of heel strikes, % of cycle')
    rows = [[model.style_names[c], float(model.periods_s[c]),
             ', '.join(f'{n} x {s} {a}' for (s, a), n in _count(trials, label, style == c))]
            for model in [models[METHODS[0]]] for c in range(model.n_styles)]
    report.table('styles', ['style', 'cycle, s', 'recordings (number x subject, label)'], rows, 'The styles found')

    strangers = [name for subject in NEW_PEOPLE for action in ('walk', 'run')
                 for name in datasets.trials(subject=subject, action=action)]
    new = {method: [analyze(model, datasets.trial(name).select(*CHANNELS)) for name in strangers]
           for method, model in models.items()}
    new_label = np.array(actions(strangers))
    rows = []
    for method, found in new.items():
        strikes = strike_phases(strangers, [(a.times, a.phase) for a in found])
        rows += [[method, action, *spreads(strikes, np.flatnonzero(new_label == action))] for action in ('walk', 'run')]
    report.table(
        'new people',
        ['method', 'recordings', 'left', 'right', 'both', 'strikes'],
        rows,
        f'The same of {len(strangers)} recordings of subjects {", ".join(NEW_PEOPLE)}, not in the training data',
    )

    component = [values[:, 1] for values in np.split(PCA(2, random_state=0).fit_transform(np.concatenate(scaled)),
                                                     np.cumsum([len(x) for x in scaled])[:-1])]
    figure, axes = plt.subplots(2, 2, figsize=(13, 8), sharey=True)
    colours = {'walk': 'tab:blue', 'slow_walk': 'tab:green', 'run': 'tab:red'}
    for axis, title in zip(axes.flat, ('recordings over time', METHODS[2], METHODS[1], METHODS[0])):
        for k, values in enumerate(component):
            if title in phases:
                phase = phases[title][k][1]
                turn = np.floor(phase / (2 * np.pi))
                across = 100 * (phase / (2 * np.pi) - turn)
                values = np.where(np.diff(turn, prepend=turn[0]) != 0, np.nan, values)
            else:
                across = times[k] - times[k][0]
            axis.plot(across, values, color=colours[label[k]], lw=0.6)
        axis.set_title(title)
        axis.set_xlabel('phase, % of cycle' if title in phases else 'time, s')
    axes[0, 0].set_ylabel('second principal component')
    figure.tight_layout()
    report.figure(
        figure,
        'figure1',
        'Second principal component of all recordings (blue: walk, green: slow walk, red: run), '
        'over time and over the phase that each method gives.',
    )
    report.figure(alignment_picture(models[METHODS[0]], motions, analyses[METHODS[0]]), 'joints',
                  'The same recordings in the joints that tell most, coloured by the style found.')
    print(report.write(args.out))


def _count(trials, label, chosen):
    groups = [(trials[k][:2], label[k]) for k in np.flatnonzero(chosen)]
    return [(group, groups.count(group)) for group in sorted(set(groups))]


if __name__ == '__main__':
    main()
