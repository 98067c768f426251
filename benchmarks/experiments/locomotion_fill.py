"""Filling in missing joints: the upper body of a held-out walk (section 4.3 of Pan and Torresani 2009), sensors,
bursts.

Walks of subject 07 are held out one after the other; models learn from all other recordings of subjects 07, 08, 09
and 35, and once more without subject 07 altogether. The first half of the test recording is complete. Then (a) the
upper body is missing, (b) ten random channels, (c) all channels in bursts that hide 30 %. Mean squared error over
the hidden angles.
"""
from locomotion_common import names, parser, recording  # isort: skip

from dataclasses import replace

import numpy as np
from tqdm import tqdm

from style_core.alignment import harmonic_design, period
from style_core.datasets import trial_path
from style_core.evaluation import random_bursts
from style_core.locomotion.infer import fill
from style_core.locomotion.learn import learn
from style_core.locomotion.online import fill_causally
from style_core.phase_style.smoother import fill as fill_phase_style
from style_core.phase_style.training import train
from style_core.pictures import Line, joint_curves
from style_core.report import Report

RATE_HZ = 60.0
LEGS = ('femur', 'tibia', 'foot', 'toes')
CASES = ('upper body', '10 random channels', 'bursts of 0.25 s, 30 %')
METHODS = (
    'locomotion model',
    'locomotion model, without departures',
    'locomotion model, causal',
    'phase-style smoother',
    'nearest neighbour',
    'own first half repeated',
)
PROTOCOLS = ('same person in training', 'person not in training')
SHOWN = ('rhumerus.rx', 'thorax.rx', 'lradius.rx', 'upperneck.rx')


def hidden_entries(motion, case, seed):
    """What a case hides: ndarray of bool, shape (T, D)."""
    half = motion.n_frames // 2
    angles = np.array([not name.startswith('root.') for name in motion.joint_names])
    hidden = np.zeros(motion.positions.shape, bool)
    if case == CASES[0]:
        upper = [not any(word in name for word in LEGS) for name in motion.joint_names]
        hidden[half:] = angles & upper
    elif case == CASES[1]:
        hidden[half:, np.random.default_rng(seed).choice(np.flatnonzero(angles), 10, replace=False)] = True
    else:
        hidden[half:] = ~random_bursts(motion.joint_names, motion.n_frames - half, 0.3, 15, seed) & angles
    return hidden


def nearest_neighbour(training, shown):
    """Copy the hidden angles of each frame from the training frame most like it in the visible ones."""
    bank = np.concatenate([motion.positions for motion in training])
    bank = bank[np.isfinite(bank).all(axis=1)]
    angles = np.array(
        [unit == 'rad' and not name.startswith('root.') for name, unit in zip(shown.joint_names, shown.units)]
    )
    filled = shown.positions.copy()
    for row in filled:
        missing = np.isnan(row)
        if missing.any():
            seen = ~missing & angles
            row[missing] = bank[((bank[:, seen] - row[seen])**2).sum(axis=1).argmin(), missing]
    return filled


def own_cycle(shown, harmonics=6):
    """Each channel continued by Fourier cycles fitted to what is seen of it, at the recording's period."""
    y, seen = shown.positions, np.isfinite(shown.positions)
    angles = [k for k, name in enumerate(shown.joint_names) if not name.startswith('root.') and seen[:, k].all()]
    steady = y[:, angles] if angles else y[seen.all(axis=1)]
    design = harmonic_design(2 * np.pi * shown.times / period(steady, RATE_HZ), harmonics)[0]
    filled = y.copy()
    for k in np.flatnonzero(~seen.all(axis=0)):
        rows = seen[:, k]
        gram = design[rows].T @ design[rows] + 0.5 * np.eye(design.shape[1])
        middle = y[rows, k].mean()
        cycle = np.linalg.solve(gram, design[rows].T @ (y[rows, k] - middle))
        filled[~rows, k] = middle + design[~rows] @ cycle
    return filled


def without_departures(model):
    """The published model: no departure of the recording from its style, no memory of residuals."""
    ones = np.ones(len(model.joint_names))
    return replace(
        model, personal=replace(model.personal, pull=1e12 * ones, memory=0 * ones, noise=model.noise.mean(axis=0))
    )


def fills(model, behaviour, training, shown):
    """Every method's filled positions (T, D), and the standard deviations of the first."""
    filled, std = fill(model, shown)
    joints = list(behaviour.joint_names)
    smoothed = shown.positions.copy()
    columns = [shown.joint_names.index(name) for name in joints]
    smoothed[:, columns] = fill_phase_style([behaviour], shown.joints(joints))[0].positions
    return {METHODS[0]: filled.positions, METHODS[1]: fill(without_departures(model), shown)[0].positions,
            METHODS[2]: fill_causally(model, shown)[0].positions, METHODS[3]: smoothed,
            METHODS[4]: nearest_neighbour(training, shown), METHODS[5]: own_cycle(shown)}, std


def main():
    """Hold out, hide, fill, score, draw."""
    options = parser(__doc__)
    options.add_argument('--styles', type=int, default=6)
    options.add_argument('--tests', nargs='+', default=['07_01', '07_03'])
    options.add_argument('--protocols', nargs='+', default=list(PROTOCOLS), choices=PROTOCOLS)
    args = options.parse_args()
    motions = {name: recording(name).resample(RATE_HZ) for name in names()}
    strangers = [name for name in motions if not name.startswith('07')]
    errors, covered, figure = {}, {}, None
    jobs = []
    if PROTOCOLS[0] in args.protocols:
        jobs += [(test, PROTOCOLS[0], [n for n in motions if n != test]) for test in args.tests]
    if PROTOCOLS[1] in args.protocols:
        jobs += [(test, PROTOCOLS[1], strangers) for test in args.tests]
    learned = {}
    for test, protocol, training in tqdm(jobs, desc='tests', disable=None):
        key = tuple(training)
        if key not in learned:
            given = [motions[name] for name in training]
            learned[key] = (learn(given, args.styles, seed=args.seed, restarts=1), train(
                given, joints=[name for name in given[0].joint_names if not name.startswith('root.')]), given)
        model, behaviour, given = learned[key]
        whole = motions[test]
        for case in CASES:
            hidden = hidden_entries(whole, case, args.seed)
            shown = whole.replace(positions=np.where(hidden, np.nan, whole.positions))
            found, std = fills(model, behaviour, given, shown)
            for method, positions in found.items():
                gap = np.degrees(positions - whole.positions)[hidden]
                errors.setdefault((protocol, method, case), []).append(np.mean(gap**2))
            gap = np.abs(found[METHODS[0]] - whole.positions)[hidden]
            covered.setdefault((protocol, case), []).append(np.mean(gap < 1.96 * std[hidden]))
            if figure is None:
                half = whole.times[whole.n_frames // 2]
                lines = [Line('recorded', whole.times, whole.joints(SHOWN).positions)]
                lines += [Line(method, whole.times, np.where(hidden, positions, np.nan)[
                    :, [whole.joint_names.index(name) for name in SHOWN]]) for method, positions in found.items()
                    if method in (METHODS[0], METHODS[1], METHODS[4])]
                figure = joint_curves(SHOWN, lines, spans=[(half, whole.times[-1], 'upper body missing')], title=test)
    command = f'python benchmarks/experiments/locomotion_fill.py --tests {" ".join(args.tests)} --protocols '
    command += ' '.join(f'"{protocol}"' for protocol in args.protocols)
    report = Report('fill', 'Filling in missing joints', command, args.seed,
                    [trial_path(name) for name in motions])
    report.text(
        f'Test recordings {", ".join(args.tests)} at {RATE_HZ:g} Hz, {args.styles} styles; mean squared error '
        'over hidden '
        'angles, deg^2, mean of the tests (single tests in brackets for the upper body). The paper, one '
        'test: 9.3, nearest '
        'neighbour 23.9.'
    )
    for protocol in args.protocols:
        rows = []
        for method in METHODS:
            each = errors[protocol, method, CASES[0]]
            rows.append([method, f'{np.mean(each):.2f} ({", ".join(f"{e:.1f}" for e in each)})']
                        + [float(np.mean(errors[protocol, method, case])) for case in CASES[1:]])
        rows.append(['share within 1.96 standard deviations (locomotion model)']
                    + [f'{np.mean(covered[protocol, case]):.0%}' for case in CASES])
        report.table(protocol, ['method', *CASES], rows, f'Mean squared error, deg^2: {protocol}')
    report.figure(figure, 'upper_body', 'The first test: hidden angles as recorded and as filled in.')
    print(report.write(args.out))


if __name__ == '__main__':
    main()
