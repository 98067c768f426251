"""What the style machine's experiments share: recordings, agreement of state labels, errors."""
import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from style_core import datasets
from style_core.effort.warping import warp
from style_core.skeleton import read_skeleton
from style_core.style_machine.preprocessing import mean_pose

RESULTS = Path(__file__).resolve().parents[2] / 'docs' / 'results' / 'style_machine'

#: ten locomotion recordings of six subjects: walks, slow walk, runs
LOCOMOTION = ('07_01', '08_01', '35_01', '16_16', '02_01', '07_05', '09_01', '16_35', '35_17', '02_03')
#: four acted performances of one subject with similar choreographies (in 131_14 the right shoulder passes gimbal lock)
ACTED = ('131_09', '131_10', '131_11', '131_13')


def parse(doc, seed=0, **extra):
    """Command-line arguments every experiment has; ``extra`` are further options with defaults."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int, default=seed)
    parser.add_argument('--output', default=str(RESULTS), metavar='FOLDER')
    for name, value in extra.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=type(value), default=value)
    return parser.parse_args()


def body(name):
    """The 50 body channels of a trial at 60 Hz."""
    return datasets.trial(name).select(*datasets.BODY)


def skeleton(name='07'):
    """Skeleton of a subject (or of a trial's subject)."""
    subject = name.split('_')[0]
    return read_skeleton(datasets.mocap_folder() / 'cmu' / subject / f'{subject}.asf')


def paths(names):
    """Files of trials, for the report."""
    return [datasets.trial_path(name) for name in names]


def rms_deg(motion, other):
    """RMS difference over frames and joints, degrees."""
    return float(np.degrees(np.sqrt(np.mean((motion.positions - other.positions) ** 2))))


def gait(name):
    """Walk or run, from labels.csv (a slow walk is a walk)."""
    action = next(row.action for row in datasets.labels() if row.name == name)
    return 'run' if action == 'run' else 'walk'


def alignments(motions, weights):
    """Best time alignment of every pair of recordings, mean poses removed: {(a, b): (frames of a, frames of b)}."""
    poses = [(motion.positions - mean_pose(motion)) * weights for motion in motions]
    result = {}
    for a in range(len(motions)):
        for b in range(a + 1, len(motions)):
            path = warp(poses[a], poses[b])
            result[a, b] = np.asarray(path.rows), np.asarray(path.columns)
    return result


def agreement(labels, aligned):
    """Share of aligned frame pairs with the same state, and with the same after the best renaming of states.

    Parameters
    ----------
    labels : list of ndarray of int
    aligned : dict from `alignments`

    Returns
    -------
    same, renamed : float
        Means over pairs.
    """
    same, renamed = [], []
    for (a, b), (rows, columns) in aligned.items():
        x, y = labels[a][rows], labels[b][columns]
        same.append(np.mean(x == y))
        table = np.zeros((x.max() + 1, y.max() + 1))
        np.add.at(table, (x, y), 1)
        renamed.append(table[linear_sum_assignment(-table)].sum() / len(x))
    return float(np.mean(same)), float(np.mean(renamed))


def sharing(labels, n_states):
    """How evenly states are used by all styles: 1 = each state by all alike, 0 = each state by one only."""
    use = np.array([np.bincount(one, minlength=n_states) / len(one) for one in labels])
    total = use.sum(axis=0)
    share = use / np.where(total > 0, total, 1.0)
    entropy = -np.where(share > 0, share * np.log(np.where(share > 0, share, 1.0)), 0.0).sum(axis=0)
    return float((entropy * total).sum() / total.sum() / np.log(len(labels)))
