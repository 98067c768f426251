"""Speed of the locomotion model: learning 39 recordings of 62 channels; its cost against frames and positions.

The recordings are those of subjects 07, 08, 09 and the first of 35 where the mocap is present, else made ones of the
same sizes. Each row is the best of several runs in one process. Peers in the same run: numpy's dense inverse for the
cyclic chain, hmmlearn's C++ recursion over the full transition matrix for forward-backward.
"""
import os

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')

import argparse  # noqa: E402
from time import perf_counter  # noqa: E402

import numpy as np  # noqa: E402

from style_core import datasets  # noqa: E402
from style_core.errors import MotionError  # noqa: E402
from style_core.locomotion import kernels  # noqa: E402
from style_core.locomotion.learn import cycle_sizes, features_of, fit, standard  # noqa: E402

N_RECORDINGS = 39


def best(function, repeats=3):
    """Shortest time of several calls, s."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return min(times)


def recordings(rate_hz):
    """Scaled features of 39 recordings with all 62 channels, their noise limit, and where they come from."""
    try:
        names = [name for subject in ('07', '08', '09', '35') for name in datasets.trials(subject=subject)]
        names = names[:N_RECORDINGS]
        features, frames, _ = features_of([datasets.trial(name, None) for name in names], rate_hz)
    except MotionError:
        rng = np.random.default_rng(0)
        made = []
        for k in range(N_RECORDINGS):
            phase = 2 * np.pi * np.arange(int(2.5 * rate_hz)) / rate_hz * (0.9 if k % 2 else 1.3) + rng.uniform(0, 6)
            made.append(np.sin(phase[:, None] + np.arange(62)) + 0.05 * rng.normal(size=(len(phase), 62)))
        return made, np.full(62, 1e4), 'made'
    centre, scale = standard(frames, features)
    return [(x - centre) / scale for x in frames], (scale / features.floors)**2, 'CMU'


def stationary(n_frames, n_positions, n_features=62):
    """Random emissions of a walk through a cycle."""
    rng = np.random.default_rng(1)
    where = (2 * np.arange(n_frames)) % n_positions
    off = (np.arange(n_positions) - where[:, None] + n_positions / 2) % n_positions - n_positions / 2
    return -0.5 * n_features * (off * 8.0 / n_positions)**2 + rng.normal(size=off.shape)


def main():
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument('--threads', type=int, default=2)
    options.add_argument('--styles', type=int, default=4)
    options.add_argument('--rates', type=float, nargs='+', default=[30.0, 60.0, 120.0])
    args = options.parse_args()
    print('Learning: 39 recordings, 15 EM iterations with three inner updates each')
    print('rate Hz  data  frames  channels  positions  jumps  seconds  us per frame and update')
    for rate in args.rates:
        data, limit, source = recordings(rate)
        sizes = cycle_sizes(data, rate)
        frames = sum(map(len, data))
        spent = best(lambda data=data, sizes=sizes, limit=limit: fit(
            data, sizes, args.styles, 0, precision_max=limit, threads=args.threads), 2)
        print(f'{rate:7g}  {source:4}  {frames:6d}  {data[0].shape[1]:8d}  {sizes.n_positions:9d}  '
              f'{sizes.max_jump:5d}  {spent:7.2f}  {1e6 * spent / frames / 48:.2f}')
    print('\nForward-backward: ns per frame and position (level = linear in both)')
    print('frames  positions  ms      ns per cell')
    for n_frames, n_positions in ((500, 65), (1000, 65), (4000, 65), (1000, 130), (1000, 260), (1000, 520)):
        scores = stationary(n_frames, n_positions)
        out, counts = np.empty_like(scores), np.empty(3)
        spent = best(lambda a=scores, b=out, c=counts: kernels.forward_backward(a, np.log(np.full(3, 1 / 3)), b, c), 5)
        print(f'{n_frames:6d}  {n_positions:9d}  {1e3 * spent:6.2f}  {1e9 * spent / scores.size:.1f}')
    _peers()


def _peers():
    print('\nPeers on the same problem: 1000 frames, 130 positions; 62 cycles of 130 positions')
    scores = stationary(1000, 130)
    out, counts = np.empty_like(scores), np.empty(3)
    ours = best(lambda: kernels.forward_backward(scores, np.log(np.full(3, 1 / 3)), out, counts), 5)
    try:
        from hmmlearn import _hmmc
        transitions = np.zeros((130, 130))
        for j in (1, 2, 3):
            transitions[np.arange(130), (np.arange(130) + j) % 130] = 1 / 3
        start = np.full(130, 1 / 130)

        def peer():
            _, forward = _hmmc.forward_log(start, transitions, scores)
            backward = _hmmc.backward_log(start, transitions, scores)
            _hmmc.compute_log_xi_sum(forward, transitions, backward, scores)

        theirs = best(peer, 2)
        print(f'forward-backward  ours {1e3 * ours:.2f} ms, hmmlearn {1e3 * theirs:.2f} ms, ratio {theirs / ours:.0f}')
    except (ImportError, AttributeError, TypeError) as missing:
        print(f'forward-backward  ours {1e3 * ours:.2f} ms; hmmlearn not usable here: {missing}')
    diagonal = np.random.default_rng(0).uniform(3, 30, (130, 62))
    potential = diagonal.copy()
    arrays = [np.empty((130, 62)) for _ in range(3)]
    log_det = np.empty(62)
    ours = best(lambda: kernels.cyclic_chain(diagonal, np.ones(62), potential, *arrays, log_det), 10)
    ring = np.roll(np.eye(130), 1, 0) + np.roll(np.eye(130), -1, 0)

    def dense():
        for b in range(62):
            precision = np.diag(diagonal[:, b]) - ring
            covariance = np.linalg.inv(precision)
            covariance @ potential[:, b], np.diag(covariance), np.linalg.slogdet(precision)[1]

    theirs = best(dense, 2)
    print(f'cyclic chain      ours {1e3 * ours:.2f} ms, dense {1e3 * theirs:.2f} ms, ratio {theirs / ours:.0f}')


if __name__ == '__main__':
    main()
