#!/usr/bin/env python3
"""Learn the short-range dynamics of all motion, style_core/unknown/short_range.npz, which comes with style_core.

From every recording of labels.csv at 60 Hz, whatever its label: how a joint goes on after how it just moved. Walks and
runs of people that locomotion.npz was not trained on say what a model's errors usually are beside those of the
dynamics. The recordings are not part of the project: set STYLE_MOCAP to their folder, or have it at ../shared/mocap.
"""
import argparse
from pathlib import Path

import numpy as np

from style_core.datasets import BODY, labels, trial, trial_path
from style_core.evaluation import future
from style_core.model_file import read_header, training_files
from style_core.predictor_file import read_predictor
from style_core.unknown.short_range import FRAME_S, LAGS, LEADS, ShortRange, learn_short_range

HERE = Path(__file__).resolve().parent
SHIPPED = HERE.parents[1] / 'src/style_core/style_core/unknown/short_range.npz'
KNOWN = ('walk', 'run', 'slow_walk', 'walk_turn', 'run_turn')


def recordings():
    """Name, action and motion of every recording with a skeleton of its own and at least 60 frames a second."""
    for row in labels():
        if row.rate_hz >= 60 and row.file.startswith('cmu/'):
            yield row.name, row.action, trial(row.name).select(*BODY)


def usual_errors(model, motions, dynamics):
    """Products of the errors of a model and of dynamics, as shares of the squares of the latter, shape (2, H)."""
    weights, _ = dynamics.tables
    sums = np.zeros((3, len(LEADS)))
    predictor = read_predictor(model, without=('unknown',)).predictor
    ahead = np.array(LEADS) * FRAME_S
    for motion in motions:
        predictor.reset()
        said = []
        for time, y in zip(motion.times, motion.positions):
            predictor.update(time, y)
            said.append(predictor.predict(ahead).mean)
        last = slice(LAGS[-1], None)
        actual = future(motion, ahead)
        at = np.arange(motion.n_frames)[:, None] - np.concatenate([[0], LAGS])
        short = np.einsum('hk,tkd->thd', weights[-1], motion.positions[np.maximum(at, 0)])
        one, two = np.array(said)[last] - actual[last], short[last] - actual[last]
        # a recording counts at the leads that it is long enough for
        for row, product in enumerate((one * one, one * two, two * two)):
            inside = np.isfinite(product).all(axis=2)
            counted = inside.any(axis=0)
            sums[row, counted] += [product[inside[:, k], k].mean() for k in np.flatnonzero(counted)]
    return sums[:2] / sums[2]


def main():
    """Learn and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('-o', '--output', type=Path, default=SHIPPED)
    output = parser.parse_args().output
    every = list(recordings())
    model = HERE / 'locomotion.npz'
    trained = {one['name'].split('.')[0] for one in read_header(model)['training']}
    dynamics = learn_short_range([motion.positions for _, _, motion in every], np.zeros((2, len(LEADS))))
    known = [motion for name, action, motion in every if action in KNOWN and name not in trained]
    usual = usual_errors(model, known, dynamics)
    ShortRange(dynamics.moments, usual).save(output, training_files(trial_path(name) for name, _, _ in every))
    print(f'wrote {output}: {len(every)} recordings, usual errors from {len(known)}')


if __name__ == '__main__':
    main()
