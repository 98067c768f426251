"""Experiment 6: the whole body from the legs alone, and from the left arm alone.

    python benchmarks/experiments/style_machine_6_path_map.py
"""
import fnmatch

import numpy as np
from style_machine_common import body, parse, paths, skeleton

from style_core.pictures import stick_pair
from style_core.report import Report
from style_core.style_machine import Settings, StreamingSynthesizer, learn
from style_core.style_machine.path_map import FollowingFilter, cue_features, fit_path_map, follow

TRAINING = ('02_01', '07_01', '07_03', '08_01', '08_03', '16_16', '16_35', '35_01', '35_17', '09_01', '09_03', '02_03')
HELD_OUT = ('07_02', '08_02', '35_02', '16_32', '09_02', '16_36', '02_02')
CUES = {'legs': ('?femur.*', '?tibia.*', '?foot.*', '?toes.*'),
        'left arm': ('lclavicle.*', 'lhumerus.*', 'lradius.*', 'lwrist.*', 'lhand.*')}


def columns(names, patterns):
    return np.array([any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns) for name in names])


def on_line(path_map, features, lag):
    """Filtered occupancies through the streaming synthesiser; frame k uses cues up to k + lag."""
    machine = path_map.machine
    following, stream, style, frames = FollowingFilter(path_map), None, None, []
    for x in features:
        gamma, styles = following.update(x)
        best = max(styles, key=styles.get)
        if stream is None:
            stream = StreamingSynthesizer(machine, best, lag=lag)
        elif best != style:
            stream.set_style(best, seconds=0.2)
        style = best
        frames.append(stream.push(gamma))
    return np.array([frame.positions for frame in [*(f for f in frames if f is not None), *stream.flush()]])


def main():
    args = parse(__doc__, states=24)
    report = Report('style_machine_6_path_map', 'Whole body from a few joints',
                    'python benchmarks/experiments/style_machine_6_path_map.py', args.seed,
                    paths([*TRAINING, *HELD_OUT]))
    motions, held_out = [body(name) for name in TRAINING], [body(name) for name in HELD_OUT]
    tree = skeleton()
    machine = learn(motions, Settings(states=args.states, seed=args.seed), skeleton=tree)
    for title, patterns in CUES.items():
        cue = columns(machine.joint_names, patterns)
        features = [cue_features(motion.positions[:, cue]) for motion in motions]
        path_map = fit_path_map(machine, features, list(TRAINING))
        inputs = np.concatenate([x[1:] for x in features])
        targets = np.concatenate([motion.positions[1:] for motion in motions])
        scale = np.concatenate([np.ones(cue.sum()), np.full(cue.sum(), 3.0)])
        design = np.column_stack([inputs * scale, np.ones(len(inputs))])
        ridge = np.linalg.solve(design.T @ design + 1e-1 * np.eye(design.shape[1]), design.T @ targets)
        rows, drawn = [], None
        for motion in held_out:
            x = cue_features(motion.positions[:, cue])
            truth = motion.positions[:, ~cue]

            def error(poses, truth=truth, wanted=~cue):
                gap = poses[1:, wanted] - truth[1:]
                return float(np.degrees(np.sqrt((gap ** 2).mean())))

            off, style, _ = follow(path_map, x)
            whole = np.where(np.isnan(x), 0.0, x) * scale
            distances = ((whole ** 2).sum(axis=1)[:, None] - 2 * whole @ (inputs * scale).T
                         + ((inputs * scale) ** 2).sum(axis=1))
            nearest = targets[np.argmin(distances, axis=1)]
            linear = np.column_stack([whole, np.ones(len(x))]) @ ridge
            rows.append([motion.name, style, error(off.positions), error(on_line(path_map, x, 12)),
                         error(on_line(path_map, x, 1)), error(nearest), error(linear),
                         float(np.degrees(motion.positions[:, ~cue].std(axis=0).mean()))])
            if motion.name == '08_02':
                drawn = stick_pair(tree, [('recorded', motion), ('path map', off)],
                                   np.linspace(motion.times[5], motion.times[-5], 8), f'from the {title} alone')
        rows.append(['mean', '', *np.mean([row[2:] for row in rows], axis=0)])
        report.table(title, ['recording', 'style found', 'off-line', 'on-line, 0.2 s late', 'on-line, 17 ms late',
                             'nearest neighbour', 'linear regression',
                             'spread of the recording'], rows,
                     f'From {title} ({cue.sum()} channels and their changes) to the other {int((~cue).sum())}: '
                     'RMS error on held-out recordings, degrees')
        report.figure(drawn, title.replace(' ', '_'), f'08_02, not trained on, from its {title} alone.')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
