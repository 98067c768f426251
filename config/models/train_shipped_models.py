#!/usr/bin/env python3
"""Train the models in this folder from the CMU recordings that the phase-style paper names.

The recordings are not part of the project: set STYLE_MOCAP to their folder, or have it at ../shared/mocap.

locomotion.npz   walking and running of three people, the paper's training list (footnote 3) as far as present;
                 held out: 08_01, 08_09, 35_23, 02_01, 16_35
jump.npz         jumps of two people (footnote 6); held out: 13_32
everyday.npz     both behaviours in one file, for following a person from standing through walking to jumping
"""
import argparse
from pathlib import Path

from style_core.datasets import BODY, labels, trial, trial_path
from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train

LOCOMOTION = ['08_02', '08_03', '08_04', '08_05', '08_06', '08_07', '08_08', '35_20', '35_21', '35_22',
              '02_02', '02_03']
JUMPS = ['13_11', '13_13', '13_19', '13_39', '13_40', '13_41', '13_42', '16_01', '16_02']


def main():
    """Train and write all models."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('-o', '--output', type=Path, default=Path(__file__).parent, help='folder (default: this one)')
    parser.add_argument('--styles', type=int, default=8, help='style dimension of locomotion (default: 8)')
    folder = parser.parse_args()
    present = {row.name for row in labels()}
    groups = {}
    for name, rhythmic, names, styles in (('locomotion', True, LOCOMOTION, folder.styles),
                                          ('jump', False, JUMPS, None)):
        used = [one for one in names if one in present]
        absent = [one for one in names if one not in present]
        print(f'{name}: {", ".join(used)}' + (f' (not here: {", ".join(absent)})' if absent else ''))
        motions = [trial(one).select(*BODY) for one in used]
        groups[name] = train(motions, name, rhythmic, motions[0].joint_names, styles, progress=True), \
            [trial_path(one) for one in used]
        save_behaviours(folder.output / f'{name}.npz', [groups[name][0]], groups[name][1])
    save_behaviours(folder.output / 'everyday.npz', [group[0] for group in groups.values()],
                    [path for group in groups.values() for path in group[1]])


if __name__ == '__main__':
    main()
