#!/usr/bin/env python3
"""Speed of the on-line predictors, beside peers in the same run. Needs no recordings: the gait is made.

One step is an update with one observation plus a prediction of 25 points with standard deviation. All on one core.
A method goes through the recording in a row, as in use; the passes of all methods take turns, and medians and 99th
percentiles are those of all steps of all passes. Other work on the machine slows passes down: a fixed loop of
arithmetic beside them shows by how much, and the best pass stands beside the median. A second table has the methods
take turns frame by frame with 8 MB of other memory touched before every call, so that each finds its caches cold.
The bars: at 56 joints and 4 styles the published method in 50 us, the full filter in 100 us at the median and 250 us
at the 99th percentile, restarts included; cost linear in joints and styles.
"""
import argparse
import os
import time
from pathlib import Path

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import numpy as np  # noqa: E402  (after the thread settings)

from style_core.baselines.regression import LinearLeastSquares  # noqa: E402
from style_core.phase_style import FullPredictor, PaperPredictor, Sequence  # noqa: E402
from style_core.phase_style.basis_table import Table, tabulate  # noqa: E402
from style_core.phase_style.learning import align, bases_from  # noqa: E402
from style_core.phase_style.model import load_behaviours  # noqa: E402
from style_core.phase_style.residual import learn_residual  # noqa: E402
from style_core.predictor import Status  # noqa: E402

AHEAD = np.arange(1, 26) / 60
SHIPPED = Path(__file__).parents[2] / 'config/models/locomotion.npz'


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


def shipped_walker(frames):
    """The shipped model's behaviours, and a made walker with it: mean style at mean speed, posture and tremor."""
    behaviours = load_behaviours(SHIPPED)
    walk, rng = behaviours[0], np.random.default_rng(0)
    table = Table(tabulate(walk.processes(), walk.rhythmic))
    style, speed = walk.styles[walk.gaits == 0].mean(axis=0), walk.speeds[walk.gaits == 0, 0].mean()
    y = np.array([style @ table.evaluate(speed * frame / 60)[0] for frame in range(frames)])
    return behaviours, y + 0.02 * rng.standard_normal(y.shape[1]) + 0.002 * rng.standard_normal(y.shape)


def step(predictor, frame, row):
    """One update and one prediction: their times in us, and the status."""
    begin = time.perf_counter()
    estimate = predictor.update(frame / 60, row)
    middle = time.perf_counter()
    predictor.predict(AHEAD)
    end = time.perf_counter()
    return 1e6 * (middle - begin), 1e6 * (end - middle), getattr(estimate, 'status', Status.TRACKING)


WARM = 20  # frames at the start of a pass that do not count


def measure(predictor, y, warm):
    """Time of every step from ``warm`` on in us, (T, 2) of update and prediction, and the status after it."""
    steps = [step(predictor, frame, row) for frame, row in enumerate(y)][warm:]
    return np.array([one[:2] for one in steps]), np.array([one[2] for one in steps])


def fixed_loop():
    """Time of a fixed piece of arithmetic without memory, us: how fast the machine is just now."""
    begin, total = time.perf_counter(), 0
    for k in range(2000):
        total += k * k
    return 1e6 * (time.perf_counter() - begin)


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


def interleaved(makers, rounds=4, warm=WARM):
    """Measure predictors in whole passes that take turns.

    Parameters
    ----------
    makers : dict of str to (callable, ndarray)
        Makes the predictor; its observations.
    rounds : int
    warm : int
        Steps at the start of a pass that do not count.

    Returns
    -------
    times : dict of str to ndarray, shape (rounds, T, 2)
        Us of update and prediction.
    status : dict of str to ndarray, shape (T,)
    """
    times, status = {name: [] for name in makers}, {}
    for _ in range(rounds):
        for name, (make, y) in makers.items():
            found, status[name] = measure(make(), y, warm)
            times[name].append(found)
    return {name: np.array(found) for name, found in times.items()}, status


def frame_by_frame(makers):
    """Methods in turn at every frame, after 8 MB of other memory: ``{name: (T, 2) us}``."""
    predictors = {name: make() for name, (make, _) in makers.items()}
    times, other = {name: [] for name in makers}, np.zeros(1 << 20)
    for frame in range(min(len(y) for _, y in makers.values())):
        for name, (_, y) in makers.items():
            np.add(other, 1.0, out=other)
            begin = time.perf_counter()
            predictors[name].update(frame / 60, y[frame])
            middle = time.perf_counter()
            np.add(other, 1.0, out=other)
            again = time.perf_counter()
            predictors[name].predict(AHEAD)
            end = time.perf_counter()
            times[name].append((1e6 * (middle - begin), 1e6 * (end - again)))
    return {name: np.array(found)[WARM:] for name, found in times.items()}


def best_round(times):
    """The pass with the lowest median of update and prediction together: (T, 2)."""
    return times[np.argmin(np.median(times.sum(axis=2), axis=1))]


def columns(times):
    """Median and 99th percentile of update, prediction and both."""
    return '  '.join(f'{np.median(part):7.1f}/{np.percentile(part, 99):7.1f}'
                     for part in (times[..., 0], times[..., 1], times.sum(axis=-1)))


HEADER = f'{"update":>15s}  {"prediction":>15s}  {"both":>15s}'


def print_peers(paper_model, full_model, y):
    """Update and prediction of all methods."""
    frames = len(y)
    shipped, walker = shipped_walker(frames)
    joints = len(shipped[0].joint_names)
    dark = y.copy()
    dark[WARM:, :14] = np.nan
    name = f'full, shipped model, J = {shipped[0].styles.shape[1]}, D = {joints}'
    ours = {
        'published method, J = 4': (lambda: PaperPredictor(paper_model), y),
        'full filter, J = 4': (lambda: FullPredictor([paper_model]), y),
        'full filter, J = 8': (lambda: FullPredictor([full_model]), y),
        'full filter, J = 4, 14 joints dark': (lambda: FullPredictor([paper_model]), dark),
        name: (lambda: FullPredictor(shipped), walker),
    }
    peers = {
        'recursive least squares': (lambda: LinearLeastSquares(paper_model.joint_names, np.zeros(56)), y[:120]),
        'filterpy EKF, our tables': (lambda: FilterpyEkf(paper_model), y[:120]),
        'processes evaluated anew': (lambda: NaiveProcesses(paper_model), y[:50]),
    }
    try:
        FilterpyEkf(paper_model)
    except ImportError:
        print('filterpy is not installed: pip install filterpy to compare with it')
        del peers['filterpy EKF, our tables']
    loops = [fixed_loop() for _ in range(200)]
    times, _ = interleaved(ours | peers, rounds=8)
    loops += [fixed_loop() for _ in range(200)]
    first, unit = next(iter(ours)), np.median(times[next(iter(ours))].sum(axis=2))
    print(f'{"56 joints, 25 points: us, median/p99":36s} {HEADER}  {"best pass":>9s}  {"ratio":>7s}')
    for name, found in times.items():
        both = found.sum(axis=2)
        print(f'{name:36s} {columns(found)}  {np.median(best_round(found).sum(axis=1)):9.1f}  '
              f'{np.median(both) / unit:7.2f}')
    print(f'(ratio: of the medians, to {first}; a fixed loop took {np.median(loops) / min(loops):.2f} times its best '
          'at the median)')
    print(f'\n{"cold caches: us, median/p99":36s} {HEADER}')
    for name, found in frame_by_frame(ours).items():
        print(f'{name:36s} {columns(found)}')


def print_search(behaviour, unknown):
    """Another person, in another phase, every two seconds: what the search costs."""
    jumps, rounds = np.concatenate([unknown[k % 4][37 * k:37 * k + 120] for k in range(12)]), 80
    times, status = interleaved({'full': (lambda: FullPredictor([behaviour]), jumps)}, rounds, warm=0)
    # the same frames in every round: the lowest of each is its cost without what else ran on the machine
    lowest, searching = times['full'].min(axis=0), status['full'] != Status.TRACKING
    print(f'\nfull filter, a new person every two seconds; searching in {searching.mean():.0%} of the frames')
    print(f'{"":28s} {"update":>9s} {"both":>9s}  us, the lowest of {rounds} rounds for every frame')
    for name, chosen in (('tracking, median', ~searching), ('searching, median', searching)):
        print(f'{name:28s} {np.median(lowest[chosen, 0]):9.1f} {np.median(lowest[chosen].sum(axis=1)):9.1f}')
    for name, share in (('all, 99th percentile', 99), ('all, highest', 100)):
        print(f'{name:28s} {np.percentile(lowest[:, 0], share):9.1f} '
              f'{np.percentile(lowest.sum(axis=1), share):9.1f}')
    print(f'{"all steps of all rounds":28s} {HEADER}\n{"  median/99th percentile":28s} {columns(times["full"])}')
    usual, seeking = (np.median(lowest[chosen], axis=0) for chosen in (~searching, searching))
    print(f'{"searching / tracking":28s} {seeking[0] / usual[0]:9.2f} {seeking.sum() / usual.sum():9.2f}')
    found = np.stack([lowest[:, 0], lowest.sum(axis=1)])
    ratio = found / np.median(found, axis=1, keepdims=True)
    print(f'{"the first / median of all":28s} {ratio[0, 0]:9.2f} {ratio[1, 0]:9.2f}')
    print(f'{"highest of the others":28s} {ratio[0, 1:].max():9.2f} {ratio[1, 1:].max():9.2f}')
    print(f'{"over twice the median":28s} {np.mean(ratio[0] > 2):9.1%} {np.mean(ratio[1] > 2):9.1%}')


def print_growth(title, models):
    """Cost over joints or styles: median of the best pass."""
    found = {}
    print(f'\n{title:>8s} {"paper us":>9s} {"full us":>9s}')
    for value, (one, seen) in models:
        makers = {'paper': (lambda one=one: PaperPredictor(one), seen[0][:160]),
                  'full': (lambda one=one: FullPredictor([one]), seen[0][:160])}
        times, _ = interleaved(makers)
        found[value] = [np.median(best_round(times[name]).sum(axis=1)) for name in makers]
        print(f'{value:8d} {found[value][0]:9.1f} {found[value][1]:9.1f}')
    values = np.array(list(found))
    for k, name in enumerate(('published method', 'full filter')):
        slope, start = np.polyfit(values, [found[value][k] for value in values], 1)
        print(f'  {name}: {start:.1f} us + {slope:.2f} us x {title}')


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--frames', type=int, default=400, help='frames a measurement (default: 400)')
    frames = parser.parse_args().frames
    paper_model, unknown = model(56, 4)
    full_model, _ = model(56, 8)
    print_peers(paper_model, full_model, np.concatenate(unknown)[:frames])
    print_search(paper_model, unknown)
    print_growth('joints', [(joints, model(joints, 4)) for joints in (14, 28, 56, 112, 224)])
    print_growth('styles', [(styles, model(56, styles)) for styles in (1, 2, 4, 6, 8, 10)])

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
