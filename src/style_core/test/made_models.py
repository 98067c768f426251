"""A small model of every kind, made within seconds, and recordings that fit each."""
from pathlib import Path

import numpy as np
from test_effort_cli import made
from test_locomotion import made_gait
from test_style_machine import FAST, cycle

from style_core import effort, locomotion, phase_style, style_machine
from style_core.cli import main
from style_core.formats import write_motion

#: kind -> function that reads all of its file
LOADERS = {'phase-style': phase_style.load_parts, 'locomotion': locomotion.load, 'style-machine': style_machine.load,
           'effort': effort.load}
KINDS = tuple(LOADERS)


def made_recordings():
    """kind -> recordings to learn from, and one that the model has not seen."""
    gaits = [made_gait(0, k, pace=(0.95, 1.05)[k % 2], name=f'p{k // 2}_{k}')[0] for k in range(4)]
    fragments = [made(f'{"swing" if content else "kick"}{manner}', content, manner)
                 for content in (0, 1) for manner in range(5)]
    machines = [cycle('walk', 0.9, 0.4, 0.0), cycle('run', 1.5, 0.7, 0.2, seed=1)]
    new_gait = made_gait(0, 77, name='new')[0]
    return {'phase-style': (gaits, new_gait), 'locomotion': (gaits, new_gait),
            'style-machine': (machines, cycle('new', 1.45, 0.7, 0.2, seed=8)), 'effort': (fragments, fragments[1])}


def make_models(folder):
    """Write ``KIND.npz``, ``KIND_histories.npz`` where a kind can hold recordings, and ``KIND.csv``, the new recording.

    Returns
    -------
    dict of str to pathlib.Path
        The model files by kind.
    """
    folder = Path(folder)
    recordings = made_recordings()
    for kind, (_, new) in recordings.items():
        write_motion(new, folder / f'{kind}.csv')
    gaits = recordings['phase-style'][0]
    files = []
    for gait in gaits:
        write_motion(gait, folder / f'{gait.name}.csv')
        files.append(str(folder / f'{gait.name}.csv'))
    with_recordings = folder / 'phase-style_histories.npz'
    assert main(['train', 'phase-style', *files, '--styles', '2', '-o', str(with_recordings), '--histories']) == 0
    phase_style.save_behaviours(folder / 'phase-style.npz', phase_style.load_parts(with_recordings)[0], files)
    locomotion.save(locomotion.learn(gaits, 1, restarts=1), folder / 'locomotion.npz')
    style_machine.save(style_machine.learn(recordings['style-machine'][0], FAST, leading=3, dof=2),
                       folder / 'style-machine.npz')
    effort.save(effort.train_library(recordings['effort'][0], blends=24), folder / 'effort.npz')
    return {kind: folder / f'{kind}.npz' for kind in KINDS}


def samples(motion, count):
    """The first ``count`` frames as (time, pose) pairs, over and over where there are fewer."""
    step = float(np.median(np.diff(motion.times)))
    return [(step * k, motion.positions[k % motion.n_frames]) for k in range(count)]
