"""Hostile trajectories by the hundred thousand against the bridge on a simulated bus, over real middleware.

    source install/setup.bash
    python3 benchmarks/experiments/servo_safety.py --count 100000

Every kind of spoiled trajectory in style_servo/hostile.py, among legal ones and floods at 10 kHz, goes to a bridge
process that drives a simulated Dynamixel chain in a third process. Afterwards every command in the bridge's flight
record is checked against the limits without tolerance, and every position value that reached a servo against the
position limits. Writes docs/results/servo/safety.md. Exit status 1 if anything was outside.
"""
import argparse
import collections
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'test'))

from style_core.report import Report  # noqa: E402
from style_servo.control_table import control_table, model_named  # noqa: E402
from style_servo.hostile import KINDS, hostile_fields, legal_fields  # noqa: E402
from style_servo.record import read_record, violations  # noqa: E402
from style_servo.states import State  # noqa: E402

IN_FLIGHT = 300     # messages sent but not yet counted by the bridge
FLOOD = 200


def send_all(rig, count, seed, minutes):
    """Send hostile trajectories, a legal one before every third of them; returns how many of each kind."""
    end = time.monotonic() + 60 * minutes
    rng = np.random.default_rng(seed)
    kinds, sent, resets = list(KINDS), collections.Counter(), 0

    def handled():
        return rig.states[-1].accepted + rig.states[-1].rejected
    with tqdm(total=count, disable=not sys.stderr.isatty(), unit='message') as bar:
        while sum(sent.values()) - sent['legal'] < count and time.monotonic() < end:
            for _ in range(20):
                now = time.monotonic()
                kind = kinds[int(rng.integers(len(kinds)))]
                if rng.random() < 0.33:
                    rig.send(legal_fields(rig.chain, now))
                    sent['legal'] += 1
                rig.send(hostile_fields(rig.chain, now, kind, rng))
                sent[kind] += 1
                bar.update()
            if rng.random() < 20 * FLOOD / 50000:
                fields = legal_fields(rig.chain, time.monotonic())
                for _ in range(FLOOD):
                    rig.send(fields)
                    time.sleep(1e-4)
                sent['flood at 10 kHz'] += FLOOD
                bar.update(FLOOD)
            del rig.states[:-2]
            patience = time.monotonic() + 30
            while sum(sent.values()) - handled() > IN_FLIGHT and time.monotonic() < patience:
                rig.spin(0.01)
            if rig.state is State.FAULT:        # a machine too busy for the bus: safe, but no test
                resets += 1
                rig.until(lambda: rig.trigger('reset').success, 60)
    patience = time.monotonic() + 60
    while handled() < sum(sent.values()) and time.monotonic() < patience:
        rig.spin(0.1)
    return sent, resets


def wire_violations(rig):
    """Position values at the servos outside the joints' limits, and how many there were."""
    joints = {str(joint.id): joint for joint in rig.chain.joints}
    units = {servo: control_table(model_named(joint.model)).position_unit for servo, joint in joints.items()}
    outside = total = 0
    with open(rig.wire) as file:
        for line in file:
            for servo, value in json.loads(line)[1].items():
                joint = joints[servo]
                angle = joint.sign * ((value - 2048) * units[servo] - joint.offset)
                outside += not joint.lower - 1e-9 <= angle <= joint.upper + 1e-9
                total += 1
    return outside, total


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=100000, help='hostile trajectories (default %(default)s)')
    parser.add_argument('--minutes', type=float, default=120.0,
                        help='stop earlier after so many minutes (default %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='default %(default)s')
    parser.add_argument('--rate', type=float, default=50.0,
                        help='commands a second; fewer leave more time for messages (default %(default)s)')
    parser.add_argument('--chain', default='exosuit6.yaml', help='chain file in config/servo (default %(default)s)')
    parser.add_argument('--output', default=ROOT / 'docs' / 'results' / 'servo', help='folder of the result page')
    arguments = parser.parse_args()
    os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
    os.environ.setdefault('ROS_DOMAIN_ID', '91')
    from servo_rig import DEEP, ServoRig
    with tempfile.TemporaryDirectory() as folder:
        rig = ServoRig(folder, chain=arguments.chain, listen=False, following_time=2.0, rate=arguments.rate,
                       **{**DEEP, 'watchdog': 2.0})
        try:
            rig.up()
            begin = time.monotonic()
            sent, resets = send_all(rig, arguments.count, arguments.seed, arguments.minutes)
            seconds = time.monotonic() - begin
            rig.until(lambda: rig.diagnostics)
            rig.diagnostics.clear()
            rig.until(lambda: rig.diagnostics)
            facts = {value.key: value.value for value in rig.diagnostics[-1].status[0].values}
            last = rig.states[-1]
        finally:
            rig.close()
        record = read_record(rig.record)
        counts = violations(record)
        outside, total = wire_violations(rig)
    report = Report('safety', 'Hostile trajectories against the servo bridge',
                    f'python3 benchmarks/experiments/servo_safety.py --count {arguments.count} '
                    f'--rate {arguments.rate:g} --minutes {arguments.minutes:g}', seed=arguments.seed)
    middleware = os.environ.get('RMW_IMPLEMENTATION', 'the default middleware')
    report.text(f'{sum(sent.values())} trajectories in {seconds:.0f} s over {middleware}, {rig.chain.name} '
                f'({len(rig.chain.joints)} joints) on a simulated Dynamixel bus, {arguments.rate:g} commands a second; '
                'no hardware was attached. '
                f'The machine was busy with other work (load {os.getloadavg()[0]:.0f} on {os.cpu_count()} processors), '
                'so the seconds say nothing about speed.')
    report.table('violations', ['what was checked', 'checked', 'outside'], [
        ['commands: position limit', counts['commands'], counts['position']],
        ['commands: velocity limit, each period, no tolerance', counts['commands'], counts['velocity']],
        ['commands: acceleration limit, each period, no tolerance', counts['commands'], counts['acceleration']],
        ['commands: not finite', counts['commands'], counts['not finite']],
        ['position values that reached the servos: position limit', total, outside]], 'Violations')
    report.table('answers', ['answer of the bridge', 'trajectories'], [
        ['accepted', last.accepted], ['refused or dropped', last.rejected],
        ['lost before the bridge (full queue)', sum(sent.values()) - last.accepted - last.rejected],
        *[[f'- {key.removeprefix("rejected: ")}', int(value)] for key, value in facts.items()
          if key.startswith('rejected: ')],
        ['- dropped in floods', int(facts['messages dropped in floods'])],
        ['joint commands clamped by the limiter', int(facts['joint commands clamped'])],
        ['joint targets rejected by the limiter', int(facts['joint targets rejected'])],
        ['faults of the bus on the busy machine, each reset', resets]], 'Answers')
    report.table('sent', ['kind', 'trajectories'], sorted(sent.items()), 'Sent')
    time_in = collections.Counter(State(state).name for state in record.state)
    report.table('states', ['state', 'periods'], sorted(time_in.items()), 'Periods spent in each state')
    print(report.write(arguments.output))
    bad = outside + sum(count for name, count in counts.items() if name != 'commands')
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
