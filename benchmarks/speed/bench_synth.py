"""Speed of synthesis: one window of trajectory (20 points) for the 20-servo humanoid, as ratios to a plain way.

    python benchmarks/speed/bench_synth.py

The plain way evaluates the Gaussian processes of the model at the points of the window, one after the other. The share
of a 10 ms period (100 Hz) says how much of follow mode's time the synthesizer takes.
"""
import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from style_core.style_machine import random_walk
from style_core.synthesis.performer import Performer, window_times
from style_core.synthesis.repertoire import load_repertoire
from style_core.synthesis.retargeting import read_robot
from style_core.synthesis.sources.style_machine import MachineSource
from style_core.synthesis.stage import Stage

CONFIG = Path(__file__).resolve().parents[2] / 'config'


def percentiles(function, repeats):
    """Median and 99th percentile of a call, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return np.percentile(times, (50, 99))


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--repeats', type=int, default=1000, help='calls of each kind (default: 1000)')
    repeats = parser.parse_args().repeats
    robot, ahead = read_robot(CONFIG / 'robots' / 'humanoid20.yaml'), window_times(0.02, 0.4)
    repertoire = load_repertoire(CONFIG / 'models' / 'locomotion.npz')
    behaviour = next(iter(repertoire.behaviours.values()))
    processes = behaviour.processes()
    bound = robot.bind(behaviour.joint_names)

    def plain():
        for at in ahead:
            phase = np.array([6.0 * at])
            parts = [process.evaluate(phase) for process in processes]
            bound.combine(sum(v * part[0] for v, part in zip(behaviour.styles[0], parts)),
                          sum(v * part[1] * 6.0 for v, part in zip(behaviour.styles[0], parts)))
    cycle, follow = Stage(repertoire, robot), Stage(repertoire, robot)
    cycle.choose('cycle')
    follow.choose('follow')
    follow.observe(1.0, 6.0)
    strong = Stage(repertoire, replace(robot, joints={
        name: replace(joint, velocity=np.inf, acceleration=np.inf) for name, joint in robot.joints.items()}))
    strong.choose('cycle')
    machine = load_repertoire(CONFIG / 'models' / 'locomotion_styles.npz').machine
    walk = Performer(MachineSource(machine, visits=random_walk(machine, seed=1)), robot)

    def tick(stage):
        stage.advance(0.01)
        stage.window(ahead)

    def step():
        follow.advance(0.01)
        follow.observe(follow.source.phase, 6.0)
        follow.window(ahead)

    def changing():
        cycle.set_style(behaviour.styles[int(time.perf_counter_ns()) % len(behaviour.styles)])
        tick(cycle)
    reference = percentiles(plain, max(20, repeats // 50))
    print(f'{"one window, 21 points, 20 joints":40}{"p50 ms":>9}{"p99 ms":>9}{"plain / this":>14}{"of 10 ms":>10}')
    for name, function in (('plain', plain), ('cycle', lambda: tick(cycle)), ('cycle, style changing', changing),
                           ('cycle, motors without limits', lambda: tick(strong)),
                           ('follow, with an estimate', step), ('random walk', lambda: tick(walk))):
        median, high = reference if function is plain else percentiles(function, repeats)
        print(f'{name:40}{1e3 * median:9.3f}{1e3 * high:9.3f}{reference[0] / median:14.1f}{high / 0.01:10.1%}')


if __name__ == '__main__':
    main()
