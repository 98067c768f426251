"""Attack a running mirror (person, predictor, synthesizer, bridge, simulated servos) and count what goes wrong.

  python benchmarks/chaos/chaos.py --seconds 600 --seed 1

Ten minutes by default. A judge of its own listens to what the motors are told; after every attack the fleet must
follow the person again. Prints a table; exit status 1 where a command broke a limit, a node ended by itself or did not
recover.
"""
import argparse
import os
import random
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor

sys.path.insert(0, str(Path(__file__).parent))
from attacks import ATTACKS
from fleet import NODES, Fleet

from style_core.errors import MotionError
from style_servo.record import read_record, violations

#: until what an attack has done can be seen, s
SHOWS = 0.6


def attack_for(fleet, seconds, rng):
    """Attack until the time is up; name of the attack -> recovery times, s (None where there was none)."""
    recoveries, end = defaultdict(list), time.monotonic() + seconds
    order = []
    while time.monotonic() < end:
        order = order or rng.sample(list(ATTACKS), len(ATTACKS))      # each as often as the others
        name = order.pop()
        ATTACKS[name](fleet, rng)
        time.sleep(SHOWS)
        took = fleet.recover()
        took = took if took is None else took + SHOWS
        recoveries[name].append(took)
        print(f'{name:10} {"recovered after " + format(took, ".1f") + " s" if took is not None else "NO RECOVERY"}',
              flush=True)
        time.sleep(rng.uniform(0.2, 1.5))
    return recoveries


def exact_violations(records):
    """Commands of the flight records outside the limits, without any tolerance."""
    total = defaultdict(int)
    for path in records:
        try:
            found = violations(read_record(path))
        except (MotionError, OSError):
            continue        # it was killed before the first cycle
        for what, count in found.items():
            total[what] += count
    return dict(total)


def table(recoveries, fleet, exact, seconds, seed):
    """The summary as Markdown."""
    lines = [f'{seconds:.0f} s, seed {seed}, {os.environ.get("RMW_IMPLEMENTATION", "default middleware")}', '',
             '| attack | times | recovered | time to recover: median, longest (s) |', '| --- | --- | --- | --- |']
    for name, attack in ATTACKS.items():
        took = [one for one in recoveries[name] if one is not None]
        times = f'{np.median(took):.1f}, {max(took):.1f}' if took else ''
        lines.append(f'| {name}: {attack.__doc__.rstrip(".")} | {len(recoveries[name])} | {len(took)} | {times} |')
    counts = fleet.verdict['counts']
    lines += ['', '| judged by the subscriber | count |', '| --- | --- |',
              *(f'| {what} | {count} |' for what, count in counts.items()),
              *(f'| in flight records: {what} | {count} |' for what, count in exact.items()),
              f'| nodes that ended by themselves | {len(fleet.deaths)} |',
              *(f'| most memory of the {name} (MiB) | {fleet.memory.get(name, 0):.0f} |' for name in NODES)]
    return '\n'.join(lines)


def main():
    """Run; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=600.0, help='how long (default: 600)')
    parser.add_argument('--seed', type=int, default=1, help='of the order and kind of attacks (default: 1)')
    parser.add_argument('--folder', type=Path, help='for logs and records (default: a temporary one)')
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp(prefix='chaos_'))
    folder.mkdir(parents=True, exist_ok=True)
    rclpy.init()
    node, executor = rclpy.create_node('chaos'), SingleThreadedExecutor()
    executor.add_node(node)
    fleet = Fleet(folder, node, executor)
    try:
        if fleet.recover(120.0) is None:
            print(f'the fleet did not start; logs are in {folder}', file=sys.stderr)
            return 1
        recoveries = attack_for(fleet, options.seconds, random.Random(options.seed))
        time.sleep(4.0)     # until everything has been judged
    finally:
        fleet.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
    exact = exact_violations(fleet.records)
    print('\n' + table(recoveries, fleet, exact, options.seconds, options.seed))
    for name, status in fleet.deaths:
        print(f'{name} ended by itself with status {status}; see {folder}/{name}.log')
    wrong = [what for what in ('not finite', 'position', 'velocity', 'acceleration', 'command stamps', 'window content')
             if fleet.verdict['counts'].get(what) or exact.get(what)]
    lost = [name for name, took in recoveries.items() if None in took]
    return 1 if wrong or lost or fleet.deaths else 0


if __name__ == '__main__':
    sys.exit(main())
