#!/usr/bin/env python3
"""Train locomotion_styles.npz, the style machine in this folder, from ten CMU recordings of six people.

The recordings are not part of the project: set STYLE_MOCAP to their folder, or have it at ../shared/mocap.
"""
import argparse
from pathlib import Path

from tqdm import tqdm

from style_core.datasets import BODY, mocap_folder, trial, trial_path
from style_core.model_file import training_files
from style_core.skeleton import read_skeleton
from style_core.style_machine import Settings, learn, save

#: style -> recording
STYLES = {'walk_02': '02_01', 'walk_07': '07_01', 'walk_08': '08_01', 'walk_16': '16_16', 'walk_35': '35_01',
          'slow_walk_07': '07_05', 'run_02': '02_03', 'run_09': '09_01', 'run_16': '16_35', 'run_35': '35_17'}


def main():
    """Train and write the model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('-o', '--output', type=Path, default=Path(__file__).parent / 'locomotion_styles.npz')
    parser.add_argument('--states', type=int, default=16)
    args = parser.parse_args()
    motions = [trial(name).select(*BODY).replace(name=style) for style, name in STYLES.items()]
    with tqdm(desc='training', unit='it', disable=None, leave=False) as bar:
        machine = learn(motions, Settings(states=args.states), progress=lambda row: bar.update(),
                        skeleton=read_skeleton(mocap_folder() / 'cmu' / '07' / '07.asf'),
                        training_files=training_files(trial_path(name) for name in STYLES.values()))
    save(machine, args.output)
    print(f'wrote {args.output}: {machine.n_states} states, {machine.dof} style coordinates')


if __name__ == '__main__':
    main()
