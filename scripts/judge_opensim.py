#!/usr/bin/env python3
"""Compare how OpenSim and this project read .mot and .sto files.

OpenSim needs an environment of its own (pip install opensim), so the comparison has two steps:

  python scripts/judge_opensim.py dump tables.npz FILE ...        where opensim is installed
  python scripts/judge_opensim.py compare tables.npz FILE ...     where style_core is installed

The second prints the greatest difference of each file and ends with status 1 if one is above 1e-9.
"""
import sys

import numpy as np


def dump(target, files):
    """Write what OpenSim reads."""
    import opensim
    arrays = {}
    for number, file in enumerate(files):
        table = opensim.TimeSeriesTable(file)
        arrays[f'names{number}'] = np.array(list(table.getColumnLabels()))
        arrays[f'times{number}'] = np.array(table.getIndependentColumn())
        arrays[f'values{number}'] = table.getMatrix().to_numpy()
        arrays[f'degrees{number}'] = table.getTableMetaDataString('inDegrees') == 'yes'
    np.savez(target, **arrays)


def compare(source, files):
    """Print differences; returns the exit status."""
    from style_core.formats import read_motion
    theirs, failed = np.load(source), False
    for number, file in enumerate(files):
        motion = read_motion(file)
        names = [name.split('/')[-2] if name.endswith('/value') else name for name in theirs[f'names{number}']]
        values = theirs[f'values{number}'][:, [names.index(joint) for joint in motion.joint_names]]
        if theirs[f'degrees{number}']:
            values = np.where([unit == 'rad' for unit in motion.units], np.radians(values), values)
        worst = max(np.abs(motion.positions - values).max(), np.abs(motion.times - theirs[f'times{number}']).max())
        print(f'{file}: {motion.n_frames} frames, {motion.n_joints} coordinates, greatest difference {worst:.3g}')
        failed |= not worst <= 1e-9
    return int(failed)


if __name__ == '__main__':
    if len(sys.argv) < 4 or sys.argv[1] not in ('dump', 'compare'):
        sys.exit(__doc__)
    sys.exit({'dump': dump, 'compare': compare}[sys.argv[1]](sys.argv[2], sys.argv[3:]))
