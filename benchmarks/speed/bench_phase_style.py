#!/usr/bin/env python3
"""Speed of the on-line predictors, beside peers in the same run. Needs no recordings: the gait is made.

One step is an update with one observation plus a prediction of 25 points with standard deviation. All on one core.
The bars: at 56 joints and 4 styles the published method in 50 us, the full filter (8 styles, personal cycle) in
100 us at the median and 250 us at the 99th percentile, restarts included; cost linear in joints and styles.
"""
import argparse
import os
import time

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import numpy as np  # noqa: E402  (after the thread settings)

from style_core.baselines.regression import LinearLeastSquares  # noqa: E402
from style_core.phase_style import FullPredictor, PaperPredictor, Sequence  # noqa: E402
from style_core.phase_style.kernel import Table  # noqa: E402
from style_core.phase_style.learning import align, bases_from  # noqa: E402
from style_core.phase_style.residual import learn_residual  # noqa: E402
from style_core.phase_style.table import tabulate  # noqa: E402
from style_core.predictor import Status  # noqa: E402

AHEAD = np.arange(1, 26) / 60


def people(joints, count, seconds, rng):
    """Made walkers: three harmonics with random style, posture and tremor."""
    base = rng.standard_normal((3, 2, joints)) * 0.3 / np.arange(1, 4)[:, None, None]
    ways = rng.standard_normal((3, 3, 2, joints)) * 0.1 / np.arange(1, 4)[:, None, None]
    found = []
    for person in range(count):
        shape = base + np.tensordot(rng.standard_normal(3), ways, axes=1)
        phase = rng.uniform(5, 7) * np.arange(int(60 * seconds)) / 60 + rng.uniform(0, 6)
        y = sum(np.cos((k + 1) * phase)[:, None] * shape[k, 0] + np.sin((k + 1) * phase)[:, None] * shape[k, 1]
                for k in range(3))
        y = y + 0.1 * rng.standard_normal(joints) + 0.01 * rng.standard_normal(y.shape)
        found.append(Sequence(f'p{person}_1', f'p{person}', y, 60.0))
    return found


def model(joints, styles, seed=0):
    """A behaviour with its residual model, and recordings of people it does not know."""
    everyone = people(joints, 16, 8.0, np.random.default_rng(seed))
    known = [Sequence(one.name, one.group, one.y[:180], 60.0) for one in everyone[4:]]
    unknown = everyone[:4]
    known, aligned = align(known, True)
    names = [f'j{k}' for k in range(joints)]
    behaviour = bases_from(known, aligned, 'walk', True, names, styles)
    return learn_residual(behaviour, known, aligned, rounds=1), [one.y for one in unknown]


def measure(predictor, y, warm=20):
    """Time of every step in us, update and prediction, and the status after it."""
    updates, predictions, status = [], [], []
    for frame, row in enumerate(y):
        begin = time.perf_counter()
        estimate = predictor.update(frame / 60, row)
        middle = time.perf_counter()
        predictor.predict(AHEAD)
        end = time.perf_counter()
        updates.append(middle - begin)
        predictions.append(end - middle)
        status.append(getattr(estimate, 'status', Status.TRACKING))
    return 1e6 * np.array(updates)[warm:], 1e6 * np.array(predictions)[warm:], np.array(status)[warm:]


class NaiveProcesses:
    """The same EKF and predictions with the Gaussian processes evaluated anew every time (update and 25 points)."""

    def __init__(self, behaviour):
        self._processes = behaviour.processes()
        self._style = behaviour.styles.mean(axis=0)
        self._noise, self._x, self._p = behaviour.noise, np.array([0.0, 6.0]), np.diag([0.1, 0.1])

    def _pose(self, phase):
        parts = [one.evaluate(np.atleast_1d(phase)) for one in self._processes]
        mean = sum(w * part[0] for w, part in zip(self._style, parts))
        slope = sum(w * part[1] for w, part in zip(self._style, parts))
        return mean, slope, sum(w * w * part[2] for w, part in zip(self._style, parts))

    def update(self, _, y):
        """One E-step."""
        f = np.array([[1, 1 / 60], [0, 1]])
        self._x, self._p = f @ self._x, f @ self._p @ f.T + np.diag([1e-7, 1e-3])
        mean, slope, _ = self._pose(self._x[0])
        h = np.stack([slope[0], np.zeros(len(y))], axis=1)
        s = h @ self._p @ h.T + np.diag(self._noise)
        gain = np.linalg.solve(s, h @ self._p).T
        self._x = self._x + gain @ (y - mean[0])
        self._p = self._p - gain @ h @ self._p

    def predict(self, ahead):
        """Mean and variance at 25 times."""
        mean, slope, variance = self._pose(self._x[0] + ahead * self._x[1])
        return mean, np.sqrt(variance[:, None] + self._noise + self._p[0, 0] * slope ** 2)


class FilterpyEkf:
    """filterpy's EKF on the same model, with our tables for its bases; predictions in numpy."""

    def __init__(self, behaviour):
        from filterpy.kalman import ExtendedKalmanFilter
        joints = len(behaviour.joint_names)
        self._table, self._style = Table(tabulate(behaviour.processes(), True)), behaviour.styles.mean(axis=0)
        one = ExtendedKalmanFilter(dim_x=2, dim_z=joints)
        one.x, one.P = np.array([[0.0], [6.0]]), np.diag([0.1, 0.1])
        one.F, one.Q, one.R = np.array([[1, 1 / 60], [0, 1]]), np.diag([1e-7, 1e-3]), np.diag(behaviour.noise)
        self._filter, self._noise = one, behaviour.noise

    def update(self, _, y):
        """Predict and update."""
        self._filter.predict()
        value, slope = self._table.evaluate(self._filter.x[0, 0])
        tangent = np.stack([self._style @ slope, np.zeros(len(y))], axis=1)
        self._filter.update(y[:, None], lambda _: tangent, lambda _: (self._style @ value)[:, None])

    def predict(self, ahead):
        """Mean and standard deviation at 25 times."""
        found = [self._table.evaluate(self._filter.x[0, 0] + tau * self._filter.x[1, 0]) for tau in ahead]
        mean = np.array([self._style @ value for value, _ in found])
        slope = np.array([self._style @ one for _, one in found])
        return mean, np.sqrt(self._noise + self._filter.P[0, 0] * slope ** 2)


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--frames', type=int, default=400, help='frames a measurement (default: 400)')
    frames = parser.parse_args().frames
    paper_model, unknown = model(56, 4)
    full_model, _ = model(56, 8)
    y = np.concatenate(unknown)[:frames]

    rows = {}
    rows['published method, 4 styles'] = measure(PaperPredictor(paper_model), y)
    rows['full filter, 4 styles'] = measure(FullPredictor([paper_model]), y)
    rows['full filter, 8 styles'] = measure(FullPredictor([full_model]), y)
    rows['recursive least squares'] = measure(LinearLeastSquares(paper_model.joint_names, np.zeros(56)), y[:120])
    try:
        rows['filterpy EKF, our tables'] = measure(FilterpyEkf(paper_model), y[:120])
    except ImportError:
        print('filterpy is not installed: pip install filterpy to compare with it')
    rows['processes evaluated anew'] = measure(NaiveProcesses(paper_model), y[:120])
    unit = np.median(np.sum(rows['published method, 4 styles'][:2], axis=0))
    print(f'{"56 joints, 25 points":28s} {"update":>8s} {"predict":>8s} {"both":>8s} {"p99":>8s} us {"ratio":>7s}')
    for name, (update, predict, _) in rows.items():
        both = update + predict
        print(f'{name:28s} {np.median(update):8.1f} {np.median(predict):8.1f} {np.median(both):8.1f} '
              f'{np.percentile(both, 99):8.1f}    {np.median(both) / unit:7.2f}')

    # another person, in another phase, every two seconds: the search must not cost a step
    jumps = np.concatenate([unknown[k % 4][37 * k:37 * k + 120] for k in range(12)])
    update, predict, status = measure(FullPredictor([full_model]), jumps)
    both, searching = update + predict, status != Status.TRACKING
    print(f'\nfull filter with a new person every two seconds: median {np.median(both):.1f} us, 99th percentile '
          f'{np.percentile(both, 99):.1f} us; searching {searching.mean():.0%} of the time, then median '
          f'{np.median(both[searching]):.1f} us = '
          f'{np.median(both[searching]) / np.median(both[~searching]):.2f} x tracking')

    print(f'\n{"joints":>8s} {"paper us":>9s} {"full us":>9s} {"full us/joint":>14s}')
    for joints in (14, 28, 56, 112, 224):
        one, seen = model(joints, 4)
        times = [np.median(np.sum(measure(make([one] if make is FullPredictor else one), seen[0][:200])[:2], axis=0))
                 for make in (PaperPredictor, FullPredictor)]
        print(f'{joints:8d} {times[0]:9.1f} {times[1]:9.1f} {times[1] / joints:14.2f}')
    print(f'\n{"styles":>8s} {"paper us":>9s} {"full us":>9s}')
    for styles in (1, 2, 4, 6, 8, 10):
        one, seen = model(56, styles)
        times = [np.median(np.sum(measure(make([one] if make is FullPredictor else one), seen[0][:200])[:2], axis=0))
                 for make in (PaperPredictor, FullPredictor)]
        print(f'{styles:8d} {times[0]:9.1f} {times[1]:9.1f}')

    eleven = people(50, 11, 2.3, np.random.default_rng(1))
    begin = time.perf_counter()
    eleven, aligned = align(eleven, True)
    behaviour = bases_from(eleven, aligned, 'walk', True, [f'j{k}' for k in range(50)], 4)
    middle = time.perf_counter()
    learn_residual(behaviour, eleven, aligned)
    print(f'\ntraining on eleven sequences of 50 joints: {middle - begin:.2f} s for the published model, '
          f'{time.perf_counter() - middle:.2f} s more for the residual model of the full filter')


if __name__ == '__main__':
    main()
