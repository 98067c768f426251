"""Blends of the styles found: continuity, foot contacts and stick figures along the blend (section 4.2, figure 3).

Styles of subjects 07, 08, 09 and 35 are learned without labels and blended: each style by itself, half-way between
pairs, and one motion that changes from a walk into a run. Measured: the largest step of a joint between frames and
the jerk against the real recordings; where in the cycle the feet strike, half-way against between the two styles;
how far a standing foot slides.
"""
from locomotion_common import actions, names, parser, recording  # isort: skip

import matplotlib.pyplot as plt
import numpy as np

from style_core import datasets
from style_core.contacts import CMU_FEET, foot_contacts
from style_core.datasets import trial_path
from style_core.locomotion.learn import learn
from style_core.locomotion.synthesis import Blend, synthesize
from style_core.pictures import Line, joint_curves, stick_strip
from style_core.report import Report
from style_core.skeleton import read_skeleton

RATE_HZ = 60.0


def smoothness(motion):
    """Largest step between frames (deg), RMS jerk of all angles (10^3 deg/s^3)."""
    angles = np.degrees(motion.positions[:, [not n.startswith('root.') for n in motion.joint_names]])
    return [float(np.abs(np.diff(angles, axis=0)).max()),
            float(np.sqrt(np.mean((np.diff(angles, 3, axis=0) * motion.rate_hz**3)**2)) / 1e3)]


def strikes(motion, phases, skeleton):
    """Mean phase of the left and right heel strikes (% of cycle), their spread, and the number."""
    found = foot_contacts(motion, skeleton)
    result = []
    for foot in ('left', 'right'):
        at = np.interp(found[foot].heel_strikes, motion.times, phases)
        result.append(
            float(100 * (np.angle(np.mean(np.exp(1j * at))) % (2 * np.pi)) / (2 * np.pi)) if len(at) else float('nan')
        )
    return [*result, sum(len(f.heel_strikes) for f in found.values())]


def slide(motion, skeleton):
    """Mean speed of the sole points of a foot on the ground, cm/s; NaN without contact."""
    places = skeleton.forward(motion)
    found = foot_contacts(motion, skeleton)
    speeds = []
    for foot, points in CMU_FEET.items():
        tracks = places[:, [skeleton.body_names.index(p) for p in points]]
        speed = np.linalg.norm(np.gradient(tracks, motion.times, axis=0)[..., [0, 2]], axis=2).min(axis=1)
        speeds.append(speed[found[foot].on_ground])
    speeds = np.concatenate(speeds)
    return float(100 * speeds.mean()) if speeds.size else float('nan')


def main():
    """Learn, blend, measure, draw."""
    options = parser(__doc__)
    options.add_argument('--styles', type=int, default=6)
    args = options.parse_args()
    trials = names()
    motions = [recording(name) for name in trials]
    label = np.array(actions(trials))
    model = learn(motions, args.styles, seed=args.seed, rate_hz=RATE_HZ, progress=True)
    skeleton = read_skeleton(datasets.mocap_folder() / 'cmu' / '35' / '35.asf')
    own = model.labels.argmax(axis=1)
    title = {}
    for c in range(model.n_styles):
        groups = sorted(
            {(trials[k][:2], label[k]) for k in np.flatnonzero(own == c)},
            key=lambda g: -sum(trials[k][:2] == g[0] and label[k] == g[1] for k in np.flatnonzero(own == c)),
        )
        title[c] = ' '.join(groups[0]) if groups else 'empty'
    used = [c for c in range(model.n_styles) if (own == c).any()]
    running = [c for c in used if title[c].endswith('run')]
    walking = [c for c in used if c not in running]

    def pure(c):
        return np.eye(model.n_styles)[c]

    rows = []
    for action in ('walk', 'run'):
        values = [smoothness(m.resample(RATE_HZ)) for m, a in zip(motions, label) if a == action]
        rows.append([f'recordings: {action} (median)', *np.median(values, axis=0).tolist(), '', '', '', ''])
    recipes = [(title[c], pure(c)) for c in used]
    pairs = [(walking[0], running[0]), (walking[1], running[-1]), (walking[0], walking[1]), (running[0], running[-1])]
    recipes += [(f'half {title[a]}, half {title[b]}', 0.5 * (pure(a) + pure(b))) for a, b in pairs]
    recipes += [(f'1.3 {title[running[0]]} - 0.3 {title[walking[0]]}', 1.3 * pure(running[0]) - 0.3 * pure(walking[0]))]
    for name, weights in recipes:
        motion, phases = synthesize(model, Blend(np.zeros(1), weights[None]), 8.0, RATE_HZ)
        rows.append([name, *smoothness(motion), *strikes(motion, phases, skeleton), slide(motion, skeleton)])
    change = Blend(np.array([2.0, 6.0]), np.stack([pure(walking[0]), pure(running[0])]))
    motion, phases = synthesize(model, change, 8.0, RATE_HZ, name='walk to run')
    rows.append(
        [
            f'{title[walking[0]]} into {title[running[0]]}',
            *smoothness(motion),
            '',
            '',
            strikes(motion, phases, skeleton)[2],
            slide(motion, skeleton),
        ]
    )
    report = Report('blends', 'Blends of styles', 'python benchmarks/experiments/locomotion_blends.py', args.seed,
                    [trial_path(name) for name in trials])
    report.text(
        f'{args.styles} styles of {len(trials)} recordings, 8 s of each blend at {RATE_HZ:g} Hz on the '
        'skeleton of subject 35. '
        'A step is the largest change of any joint angle from frame to frame.'
    )
    report.table(
        'blends',
        [
            'motion',
            'step, deg',
            'RMS jerk, 1000 deg/s^3',
            'left strike, %',
            'right strike, %',
            'strikes',
            'slide, cm/s',
        ],
        rows,
        'Continuity and contacts',
    )
    report.figure(stick_strip(skeleton, [(title[walking[0]], synthesize(
        model, Blend(np.zeros(1), pure(walking[0])[None]), 2.4, RATE_HZ)[0]), ('half each', synthesize(
            model, Blend(np.zeros(1), 0.5 * (pure(walking[0]) + pure(running[0]))[None]), 2.4, RATE_HZ)[0]),
        (title[running[0]], synthesize(model, Blend(np.zeros(1), pure(running[0])[None]), 2.4, RATE_HZ)[0])], count=13),
        'figures', 'A walk, a run and the blend half-way, at the same times.')
    report.figure(
        stick_strip(skeleton, [('walk into run', motion)], count=20),
        'change',
        'From a walk into a run between 2 and 6 s.',
    )
    shown = ('lfemur.rx', 'ltibia.rx', 'lhumerus.rx', 'lradius.rx')
    figure = joint_curves(
        shown,
        [Line('blend', motion.times, motion.joints(shown).positions)],
        spans=[(2.0, 6.0, 'changing')],
        title='walk into run',
    )
    report.figure(figure, 'curves', 'Angles along the change.')
    figure, axis = plt.subplots(figsize=(9, 2.6))
    contacts = foot_contacts(motion, skeleton)
    axis.plot(motion.times, np.gradient(phases, motion.times) / (2 * np.pi), color='k', lw=1)
    for level, (foot, colour) in enumerate((('left', 'tab:blue'), ('right', 'tab:orange'))):
        axis.fill_between(
            motion.times,
            0.05 + 0.15 * level,
            0.17 + 0.15 * level,
            where=contacts[foot].on_ground,
            color=colour,
            label=f'{foot} foot on the ground',
            step='mid',
        )
    axis.set_xlabel('time, s')
    axis.set_ylabel('cycles a second')
    axis.set_ylim(0, None)
    axis.legend(fontsize=8, loc='upper left')
    report.figure(figure, 'contacts', 'Pace and contacts along the change.')
    print(report.write(args.out))


if __name__ == '__main__':
    main()
