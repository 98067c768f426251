#!/usr/bin/env python3
"""Speed of the effort model: warping beside dtaidistance and dtw-python, and segmentation of a minute of motion."""
import argparse
import importlib
import time

import numpy as np

from style_core.effort import segment, warp


def median_ms(call, repeats):
    """Median time of a call in ms, after one that is not counted."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times))


def peers(first, second):
    """Name -> call that returns distance and path, for the peers that are installed; says which are not."""
    found = {}
    for module, package in (('dtaidistance.dtw_ndim', 'dtaidistance'), ('dtw', 'dtw-python')):
        try:
            found[package] = importlib.import_module(module)
        except ImportError:
            print(f'{package} is not installed: pip install {package} to compare with it')
    calls = {}
    if 'dtaidistance' in found:
        ndim = found['dtaidistance']
        calls['dtaidistance, distance only (C)'] = lambda: ndim.distance_fast(first, second)
        calls['dtaidistance, with path (C)'] = lambda: ndim.warping_path(first, second, use_c=True)
    if 'dtw-python' in found:
        calls['dtw-python, with path'] = lambda: found['dtw-python'].dtw(
            first, second, dist_method='sqeuclidean', step_pattern='symmetric1')
    return calls


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--repeats', type=int, default=30)
    args = parser.parse_args()
    generator = np.random.default_rng(0)
    first, second = generator.normal(size=(2, 300, 56)).cumsum(1)
    ours = median_ms(lambda: warp(first, second), args.repeats)
    print('warping of two fragments of 300 frames x 56 channels, distance and path')
    print(f'  {"style_core.effort.warp":<36} {ours:9.3f} ms   1.00')
    for name, call in peers(first, second).items():
        taken = median_ms(call, args.repeats)
        print(f'  {name:<36} {taken:9.3f} ms {taken / ours:6.2f} times ours')
    library = [generator.normal(size=(int(n), 56)).cumsum(0) for n in generator.integers(30, 110, size=60)]
    print(f'segmentation against 60 fragments ({sum(map(len, library))} frames in all)')
    base = None
    for seconds in (15, 30, 60):
        frames = generator.normal(size=(60 * seconds, 56)).cumsum(0)
        taken = median_ms(lambda frames=frames: segment(frames, library), 3) / 1e3
        base = base or taken / seconds
        print(f'  {seconds:3d} s of motion at 60 Hz: {taken:6.3f} s, a second of it {taken / seconds / base:5.2f} times'
              ' that of 15 s')


if __name__ == '__main__':
    main()
