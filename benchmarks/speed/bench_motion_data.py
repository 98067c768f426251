"""Speed of reading motion and of forward kinematics, as ratios to plain ways of doing the same in the same run.

    python benchmarks/speed/bench_motion_data.py

Needs the recordings (STYLE_MOCAP, or ../shared/mocap).
"""
import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from style_core import datasets
from style_core.angles import continuous_triples
from style_core.errors import MotionError
from style_core.formats import bag, read_motion, write_motion


def best(function, repeats):
    """Shortest of several runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def amc_by_lines(path):
    """What a short parser does: a dictionary of lists a frame."""
    frames = []
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
        elif frames:
            frames[-1][words[0]] = [float(word) for word in words[1:]]
    return np.array([[value for values in frame.values() for value in values] for frame in frames])


def bag_by_messages(path):
    """Deserialise every message, keep the positions."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        return np.array([store.deserialize_cdr(data, bag.JOINT_STATE).position for _, _, data in reader.messages()])


def kinematics_by_frames(skeleton, motion):
    """One frame after the other, with scipy's rotations."""
    column = {name: index for index, name in enumerate(motion.joint_names)}
    result = np.empty((motion.n_frames, len(skeleton.bodies), 3))
    for frame, row in enumerate(motion.positions):
        turns = []
        for index, body in enumerate(skeleton.bodies):
            place = result[frame, body.parent] if body.parent >= 0 else np.zeros(3)
            turn = turns[body.parent] if body.parent >= 0 else Rotation.identity()
            turn = turn * Rotation.from_matrix(body.before)
            for channel in body.channels:
                value = row[column[channel.name]]
                if channel.kind == 't':
                    place = place + value * np.array(channel.axis)
                else:
                    turn = turn * Rotation.from_rotvec(value * np.array(channel.axis))
            turn = turn * Rotation.from_matrix(body.after)
            turns.append(turn)
            result[frame, index] = place + turn.apply(body.tip)
    return result


def branches_by_frames(triples):
    """Choose the nearer of two equivalent triples, frame by frame."""
    result = triples.copy()
    for frame in range(1, len(triples)):
        here, before = result[frame], result[frame - 1]
        other = np.array([here[0] + np.pi, np.pi - here[1], here[2] + np.pi])
        both = [t - 2 * np.pi * np.round((t - before) / (2 * np.pi)) for t in (here, other)]
        result[frame] = min(both, key=lambda t, before=before: np.sum((t - before)**2))
    return result


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--repeats', type=int, default=3, help='runs of each, the shortest counts')
    parser.add_argument('--trial', default='131_09', help='recording to read')
    args = parser.parse_args()
    try:
        path = datasets.trial_path(args.trial)
    except MotionError as error:
        parser.exit(1, f'{error}\n')
    motion, skeleton = read_motion(path), datasets.skeleton(args.trial)
    triples = motion.joints([f'rhumerus.r{axis}' for axis in 'xyz']).positions
    with tempfile.TemporaryDirectory() as folder:
        table, recorded = Path(folder) / 'a.csv', Path(folder) / 'bag'
        write_motion(motion, table)
        write_motion(motion, recorded)
        rows = [
            ('read AMC', lambda: read_motion(path), 'line by line', lambda: amc_by_lines(path)),
            ('read CSV', lambda: read_motion(table), 'numpy.genfromtxt',
             lambda: np.genfromtxt(table, delimiter=',', skip_header=1)),
            ('read bag', lambda: read_motion(recorded), 'messages only', lambda: bag_by_messages(recorded)),
            ('forward kinematics', lambda: skeleton.forward(motion), 'scipy, frame by frame',
             lambda: kinematics_by_frames(skeleton, motion)),
            ('Euler branches', lambda: continuous_triples(triples, 1), 'frame by frame',
             lambda: branches_by_frames(triples)),
        ]
        print(f'{args.trial}: {motion.n_frames} frames, {motion.n_joints} channels; microseconds a frame')
        print(f'{"what":20} {"here":>8}   {"beside it":24} {"takes":>8}   ratio')
        for name, ours, other_name, other in rows:
            here, there = best(ours, args.repeats), best(other, 1 if 'kinematics' in name else args.repeats)
            print(f'{name:20} {here / motion.n_frames * 1e6:8.2f}   {other_name:24} '
                  f'{there / motion.n_frames * 1e6:8.2f}   {there / here:.1f}')
        everything = best(lambda: [read_motion(datasets.trial_path(name)) for name in datasets.trials()], 1)
        size = sum(datasets.trial_path(name).stat().st_size for name in datasets.trials())
        print(f'all {len(datasets.trials())} recordings: {everything:.1f} s for {size / 1e6:.0f} MB')


if __name__ == '__main__':
    main()
