"""Experiment 5: gait and subject of a recording that was left out, by its nearest training style.

    python benchmarks/experiments/style_machine_5_identification.py
"""
import numpy as np
from style_machine_common import body, gait, parse, paths, skeleton
from tqdm import tqdm

from style_core.effort.warping import warp
from style_core.report import Report
from style_core.style_machine import Settings, analyze, learn
from style_core.style_machine.preprocessing import mean_pose, pose_weights

RECORDINGS = ('02_01', '02_02', '07_01', '07_02', '07_03', '08_01', '08_02', '08_03', '16_16', '16_32', '16_35',
              '16_36', '35_01', '35_02', '35_03', '09_01', '09_02', '09_03')


def main():
    args = parse(__doc__, states=16)
    report = Report('style_machine_5_identification', 'Style identification, leaving one recording out',
                    'python benchmarks/experiments/style_machine_5_identification.py', args.seed, paths(RECORDINGS))
    motions = {name: body(name) for name in RECORDINGS}
    tree = skeleton()
    weights = pose_weights(list(motions.values()), tree, args.seed)
    rows = []
    for name in tqdm(RECORDINGS, disable=None):
        rest = [motions[other] for other in RECORDINGS if other != name]
        found = analyze(learn(rest, Settings(states=args.states, seed=args.seed), skeleton=tree), motions[name])
        costs = {'absolute': {}, 'centred': {}}
        for motion in rest:
            one, other = motions[name].positions * weights, motion.positions * weights
            costs['absolute'][motion.name] = warp(one, other).mean_cost
            costs['centred'][motion.name] = warp(one - mean_pose(motions[name]) * weights,
                                                 other - mean_pose(motion) * weights).mean_cost
        rows.append([name, found.nearest, min(costs['absolute'], key=costs['absolute'].get),
                     min(costs['centred'], key=costs['centred'].get), found.distance, found.out_of_range])
    summary = []
    for label, column in (('style machine', 1), ('DTW, poses as recorded', 2), ('DTW, mean pose removed', 3)):
        summary.append([label, 100 * np.mean([gait(row[0]) == gait(row[column]) for row in rows]),
                        100 * np.mean([row[0][:2] == row[column][:2] for row in rows])])
    report.table('accuracy', ['method', 'gait (%)', 'subject (%)'], summary,
                 f'Nearest of the other {len(RECORDINGS) - 1} recordings; chance for the subject is about 12 %')
    report.table('recordings', ['left out', 'nearest style', 'nearest by DTW', 'nearest by DTW, centred', 'distance',
                                'flagged out of range'], rows, 'Each recording')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
