"""Speed of style machines: EM iteration against hmmlearn, whole training, batch and streaming synthesis.

Ratios to the peer are measured in the same run, alternating, on one core; set OMP_NUM_THREADS=1 (done here if unset).

    python benchmarks/speed/bench_style_machine.py
    python benchmarks/speed/bench_style_machine.py --training      with the whole training of experiment 2 (mocap)
"""
import argparse
import os
import time

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import numpy as np  # noqa: E402

from style_core.hmm import Hmm, em_step  # noqa: E402
from style_core.report import Report  # noqa: E402
from style_core.style_machine.emission import Emission  # noqa: E402
from style_core.style_machine.trajectory import information, trajectory  # noqa: E402


def timed(function, repeats):
    """Every duration of ``repeats`` calls, s."""
    durations = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        durations.append(time.perf_counter() - begin)
    return durations


def em_iteration(seed, repeats=3):
    """One EM iteration at 75 states, 6000 frames, 10 dimensions: ours and hmmlearn's two implementations."""
    from hmmlearn.hmm import GaussianHMM
    rng = np.random.default_rng(seed)
    n, frames, d = 75, 6000, 10
    x = 0.1 * np.cumsum(rng.standard_normal((frames, d)), axis=0)
    model = Hmm(np.full(n, 1 / n), rng.dirichlet(np.ones(n), size=n), x[:: frames // n][:n],
                np.tile(0.5 * np.eye(d), (n, 1, 1)))

    def peer(implementation):
        one = GaussianHMM(n, 'full', init_params='', n_iter=1, implementation=implementation)
        one.startprob_, one.transmat_, one.means_, one.covars_ = model.start, model.trans, model.means, model.covs
        one.fit(x)

    runs = {'style_core': lambda: em_step(model, [x]), 'hmmlearn, scaling': lambda: peer('scaling'),
            'hmmlearn, log (its default)': lambda: peer('log')}
    durations = {name: [] for name in runs}
    for _ in range(repeats):
        for name, function in runs.items():
            durations[name] += timed(function, 1)
    best = {name: float(np.median(values)) for name, values in durations.items()}
    return [[name, 1e3 * value, value / best['style_core']] for name, value in best.items()]


def random_emission(rng, n=75, joints=56, leading=10):
    """A style of a made machine of the size that counts."""
    roots = rng.standard_normal((n, 2 * leading, 2 * leading)) * 0.1
    small = rng.standard_normal((n, joints - leading, 2, 2)) * 0.1
    return Emission(np.zeros(joints), rng.standard_normal((n, joints)), 0.05 * rng.standard_normal((n, joints)),
                    roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(2 * leading),
                    small @ small.transpose(0, 1, 3, 2) + 1e-3 * np.eye(2), np.full(n, 8.0))


def batch(seed):
    """Batch synthesis of 56 joints, 1,000 to 100,000 frames, from a state sequence and from occupancies."""
    rng = np.random.default_rng(seed)
    emission = random_emission(rng)
    basis = np.linalg.qr(rng.standard_normal((56, 56)))[0]
    rows = []
    for frames in (1000, 3000, 10_000, 30_000, 100_000):
        path = np.repeat(rng.integers(75, size=frames // 8 + 1), 8)[:frames]
        gamma = np.zeros((frames, 75))
        gamma[np.arange(frames), path] = 0.9
        gamma[np.arange(frames), (path + 1) % 75] = 0.1
        repeats = max(3, 30_000 // frames)

        def states(path=path):
            return trajectory(information(emission), path) @ basis.T

        def soft(gamma=gamma):
            return trajectory(information(emission), gamma) @ basis.T

        rows.append([frames, *(float(np.median(timed(function, repeats))) for function in (states, soft))])
    return rows


def streaming(machine, frames=3000):
    """Time of each streamed frame, microseconds: plain, and while the style changes."""
    from style_core.style_machine import StreamingSynthesizer, random_walk
    stream = StreamingSynthesizer(machine, source=random_walk(machine, seed=1))
    for _ in range(100):
        stream.step()
    plain = timed(stream.step, frames)
    names = list(machine.styles)
    change = timed(lambda: stream.set_style(names[0], seconds=frames / machine.rate_hz), 1)
    ramp = timed(stream.step, frames)
    return [['a frame', *(1e6 * np.quantile(plain, [0.5, 0.99]))],
            ['a frame while the style changes', *(1e6 * np.quantile(ramp, [0.5, 0.99]))],
            ['the call that changes the style', 1e6 * change[0], 1e6 * change[0]]]


def made_machine(seed):
    """A style machine of 75 states and 56 joints learned from made motion."""
    from style_core.motion import Motion
    from style_core.style_machine import Settings, learn
    rng = np.random.default_rng(seed)
    motions = []
    for k, rate in enumerate((0.8, 1.1, 1.5)):
        t = np.arange(600) / 60
        shape = rng.standard_normal((6, 56))
        phase = 2 * np.pi * rate * t[:, None] * np.array([1, 1, 2, 2, 3, 3]) + np.array([0, np.pi / 2] * 3)
        motions.append(Motion([f'j{i}' for i in range(56)], 0.2 * np.sin(phase) @ shape
                              + 0.01 * rng.standard_normal((600, 56)), t, name=f'style{k}'))
    return learn(motions, Settings(states=75, anneal=5, max_iterations=5))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--training', action='store_true', help='also train experiment 2 (needs the recordings)')
    parser.add_argument('--output', metavar='FOLDER', help='write a result page with the plot into this folder')
    args = parser.parse_args()
    report = Report('bench_style_machine', 'Speed of style machines',
                    'python benchmarks/speed/bench_style_machine.py' + (' --training' if args.training else ''),
                    args.seed)

    def table(name, columns, rows, caption):
        print(f'\n{caption}')
        for row in (columns, *rows):
            print('  ' + '  '.join(f'{cell:.4g}'.rjust(12) if isinstance(cell, float) else str(cell).ljust(34)
                                   for cell in row))
        report.table(name, columns, rows, caption)

    table('em', ['', 'ms', 'times ours'], em_iteration(args.seed),
          'One EM iteration, 75 states, 6000 frames, 10 dimensions, full covariances, one core (bar: 3 times faster)')
    rows = batch(args.seed)
    table('batch', ['frames', 'state sequence (s)', 'occupancies (s)'], rows,
          'Batch synthesis, 56 joints, 75 states (bar: 10,000 frames in 0.5 s)')
    table('streaming', ['', 'median (us)', '99 % (us)'], streaming(made_machine(args.seed)),
          'Streaming synthesis, 56 joints, 75 states, lag 40 frames (bar: 200 us a frame)')
    if args.training:
        from style_core import datasets
        from style_core.skeleton import read_skeleton
        from style_core.style_machine import Settings, learn
        motions = [datasets.trial(name).select(*datasets.BODY) for name in ('131_09', '131_10', '131_11', '131_13')]
        tree = read_skeleton(datasets.mocap_folder() / 'cmu' / '131' / '131.asf')
        begin, used = time.perf_counter(), time.process_time()
        machine = learn(motions, Settings(states=75, seed=args.seed), skeleton=tree, mirror=True)
        table('training', ['frames', 'iterations', 'wall clock (s)', 'processor (s)'], [
            [sum(map(len, machine.recordings.values())), len(machine.history), time.perf_counter() - begin,
             time.process_time() - used]], 'Whole training of experiment 2 (bar: 30 s; the paper: 20 minutes)')
    if args.output:
        import matplotlib
        matplotlib.use('Agg')
        import matplotlib.pyplot as plt
        figure, axis = plt.subplots(figsize=(6, 4))
        frames = np.array([row[0] for row in rows])
        for column, label in ((1, 'state sequence'), (2, 'occupancies')):
            axis.loglog(frames, [row[column] for row in rows], 'o-', label=label)
        axis.loglog(frames, rows[0][1] * frames / frames[0], ':', color='k', label='proportional')
        axis.set_xlabel('frames')
        axis.set_ylabel('s')
        axis.legend()
        report.figure(figure, 'linear', 'Time of batch synthesis over the number of frames.')
        print(report.write(args.output))


if __name__ == '__main__':
    main()
