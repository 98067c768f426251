"""Follow mode end to end: from a person's joint state to the servos' goals, joint states at 100 Hz, servos at 200 Hz.

    source install/setup.bash
    python benchmarks/speed/bench_follow.py

`mirror.launch.py` runs as a user starts it: predictor, synthesizer in follow mode, servo bridge at 200 Hz, 20 simulated
servos, each a process. An endless walk made by the shipped model comes in at 100.1 Hz: no whole fraction of the
bridge's rate, so that inputs fall on every moment between two of its cycles alike, as those of a person do. Predictor
and synthesizer answer each message as it comes; only the bridge has a clock. What is followed through the
chain, message by message:

    input       the joint state's stamp, taken right before it is published
    estimate    carries that stamp; the middleware notes when it was published
    window      of trajectory: the first one that the synthesizer stamped after that
    cycle       of the bridge: the first one whose flight record names that window (or a newer one) as what plays
    command     the first goal positions of a Sync Write that reach the simulated servos after that cycle began

Latency is command minus input, both read from this machine's clocks. An input for which one of these never came is
counted as lost. The stages between are printed as well, so that one sees what dominates.
"""
import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))

import machine
import numpy as np

try:
    import rclpy
except ModuleNotFoundError:
    sys.exit('this needs ROS; source install/setup.bash first')
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from style_core.synthesis.repertoire import load_repertoire
from style_core.synthesis.retargeting import plain_robot
from style_core.synthesis.stage import Stage
from style_msgs.msg import BridgeState, StyleEstimate
from style_node.templates import MessageTemplate, stamps_of
from style_servo.record import read_record

ROOT = Path(__file__).resolve().parents[2]
RATE = 100.1
# a busy machine can keep the simulator from answering for a while; real servos answer in time
PATIENT = {'reply_timeout': 0.1, 'watchdog': 2.0, 'error_run': 50, 'following_time': 5.0}
BRIDGE_RATE = 200.0
SETTLE_S = 6.0      # of streaming before the measurement


def walk(model, seconds):
    """Joint names and positions (T, J) of an endless walk at RATE, made by a model file."""
    repertoire = load_repertoire(model)
    stage = Stage(repertoire, plain_robot())
    stage.choose('cycle')
    rows = []
    for _ in range(round(seconds * RATE)):
        stage.advance(1 / RATE)
        rows.append(stage.window(np.zeros(1))[0][0])
    return stage.joint_names, np.array(rows)


class Listener:
    """Everything heard on a topic: raw bytes with the time at which they were published."""

    def __init__(self, node, kind, topic, qos):
        self.kind, self.heard = kind, []
        self._subscription = node.create_subscription(kind, topic, lambda message: None, qos, raw=True)

    def take(self):
        """Take what has arrived."""
        while (taken := self._subscription.handle.take_message(self.kind, True)) is not None:
            self.heard.append((taken[0], taken[1]['source_timestamp']))


def measure(seconds, priority, folder):
    """Run the chain; returns stamps of inputs (ns), and what was heard, recorded and received by the servos."""
    sys.path.insert(0, str(ROOT / 'scripts'))
    from launching import launch, stop
    bridge = {**PATIENT, 'rate': BRIDGE_RATE, 'realtime_priority': priority}
    params = folder / 'bridge.yaml'
    params.write_text('/**:\n  ros__parameters:\n' + ''.join(f'    {k}: {v}\n' for k, v in bridge.items()))
    flight, wire = folder / 'flight', folder / 'wire'
    model = ROOT / 'config' / 'models' / 'locomotion.npz'
    names, positions = walk(model, 120.0)
    with (folder / 'log').open('w') as log:
        nodes = launch([str(ROOT / 'launch' / 'mirror.launch.py'), 'file:=', f'model:={model}',
                        f'bridge_params:={params}', f'record:={flight}', f'sim_options:=--record {wire}'], log)
    rclpy.init()
    node = rclpy.create_node('bench_follow')
    try:
        publisher = node.create_publisher(JointState, '/person/joint_states', 10)
        template = MessageTemplate(JointState(name=list(names), position=[0.0] * len(names)))
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        states = Listener(node, BridgeState, '/servo_bridge/state', latched)
        estimates = Listener(node, StyleEstimate, '/predictor/estimate', qos_profile_sensor_data)
        windows = Listener(node, JointTrajectory, '/joint_trajectory', 100)
        inputs, streaming, k = [], None, 0
        begin = due = time.monotonic()
        while streaming is None or time.monotonic() < streaming + SETTLE_S + seconds:
            due += 1 / RATE
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.time_ns()
            publisher.publish(template.write({'position': positions[k % len(positions)]}, now))
            k += 1
            if streaming is not None and time.monotonic() > streaming + SETTLE_S:
                inputs.append(now)
            for listener in (states, estimates, windows):
                listener.take()
            if streaming is None and states.heard and \
                    rclpy.serialization.deserialize_message(states.heard[-1][0], BridgeState).state == 3:
                streaming = time.monotonic()
            if nodes.poll() is not None or time.monotonic() > begin + 90.0 + seconds:
                raise SystemExit('the chain never came to stream:\n' + (folder / 'log').read_text()[-2000:])
        time.sleep(0.3)
        for listener in (estimates, windows):
            listener.take()
    finally:
        stop(nodes)
        node.destroy_node()
        rclpy.shutdown()
    goals = np.array([json.loads(line)[0] for line in wire.read_text().splitlines() if line.endswith(']')])
    return np.array(inputs), estimates.heard, windows.heard, read_record(flight), goals


def first(times, after):
    """For every value the first of the sorted ``times`` at or after it; NaN where there is none."""
    place = np.searchsorted(times, after)
    found = np.append(times, np.nan)[np.minimum(place, len(times))]
    return np.where(np.isnan(after), np.nan, found)


def latencies(inputs, estimates, windows, record, goals):
    """Times of every stage of every input, s of the wall clock: (N, 5); NaN from the stage on that never came."""
    # monotonic to wall clock
    offset = time.time() - time.monotonic()
    published = dict(zip(stamps_of([data for data, _ in estimates]), [1e-9 * when for _, when in estimates]))
    estimate = np.array([published.get(stamp, np.nan) for stamp in inputs])
    window = first(np.sort(1e-9 * stamps_of([data for data, _ in windows])), estimate)
    playing = np.maximum.accumulate(np.nan_to_num(record.playing))
    place = np.searchsorted(playing, np.nan_to_num(window, nan=np.inf) - 1e-6)
    cycle = np.append(record.time + offset, np.nan)[np.minimum(place, len(record.time))]
    command = first(goals + offset, cycle)
    return np.stack([1e-9 * inputs, estimate, window, cycle, command], axis=1)


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=20.0, help='length of the measurement (default %(default)s)')
    parser.add_argument('--priority', type=int, default=0, help='real-time priority of the bridge (default: none)')
    machine.add_argument(parser)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, machine.watched(arguments.awake):
        times = latencies(*measure(arguments.seconds, arguments.priority, Path(folder)))
    whole = ~np.isnan(times).any(axis=1)
    print(f'{len(times)} inputs at {RATE:g} Hz, bridge at {BRIDGE_RATE:g} Hz; '
          f'{np.count_nonzero(~whole)} lost; load {os.getloadavg()[0]:.1f} on '
          f'{os.cpu_count()} processors')
    if not whole.any():
        return 1
    stages = 1e3 * np.diff(times[whole], axis=1)
    print(f'{"ms":44}{"p50":>9}{"p99":>9}{"max":>9}')
    names = ('joint state to estimate (predictor)', 'estimate to window (synthesizer)', 'window to cycle (bridge)',
             'cycle to the servos (bridge, bus)')
    for name, values in (*zip(names, stages.T), ('joint state to servos (p99 to be below 15)', stages.sum(axis=1))):
        print(f'{name:44}' + ''.join(f'{x:9.2f}' for x in np.percentile(values, [50, 99, 100])))
    return 0


if __name__ == '__main__':
    sys.exit(main())
