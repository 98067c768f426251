"""Speed of the predictor node: rates held without a missed message, end-to-end latency, and what templates save.

Player, node and listener are processes of their own, as on a robot (`node_rig.py`). Latency counts from the moment
before the joint state, serialised already, is handed to the middleware to the moment after the trajectory, still
serialised, has come out of it: two trips through the middleware, the node's waiting and its work. Each message is
followed through its stages, so the table says where the slow ones lose their time. In the same run a relay that
answers every joint state with a ready-made trajectory of the same size, and computes nothing, shows what of it is the
middleware's (the floor).
"""
import argparse
import array
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)

import machine
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from node_rig import empty_trajectory
from rclpy.executors import SingleThreadedExecutor
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.motion import Motion
from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train
from style_core.synthetic import synthetic_people

RIG = Path(__file__).with_name('node_rig.py')


def widened(motion, joints):
    """The motion with exactly so many joints: some left out, or some repeated under new names."""
    columns = np.resize(np.arange(motion.n_joints), joints)
    names = [motion.joint_names[c] + (f'.copy{n // motion.n_joints}' if n >= motion.n_joints else '')
             for n, c in enumerate(columns)]
    return Motion(tuple(names), motion.positions[:, columns], motion.times, name=motion.name)


class Run:
    """One process that answers, one that listens, one that plays, and what is needed to measure them."""

    def __init__(self, folder, core, command, *more):
        self._folder = Path(folder)
        self.process = self._start(command, *more, core=core)
        self._listener = self._start('listen')
        rclpy.init()
        self.node = rclpy.create_node('bench')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.facts, self.total, self.updates = {}, 0, 0
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def _start(self, what, *more, core=None):
        pinned = ['taskset', '-c', str(core)] if core is not None else []
        return subprocess.Popen([*pinned, sys.executable, str(RIG), what, str(self._folder / f'{what}.npy'),
                                 *map(str, more)])

    def activate(self):
        """Take the predictor through its life."""
        client = self.node.create_client(ChangeState, '/predictor/change_state')
        client.wait_for_service(20.0)
        for label in ('configure', 'activate'):
            request = ChangeState.Request()
            request.transition.label = label
            future = client.call_async(request)
            self.executor.spin_until_future_complete(future, timeout_sec=20.0)
            if not (future.done() and future.result().success):
                raise RuntimeError(f'the node did not {label}')
        self.node.destroy_client(client)

    def _on_diagnostics(self, message):
        facts = {pair.key: pair.value for pair in message.status[0].values}
        self.total += int(facts.get('messages in the last report', 0))
        self.updates += int(facts.get('updates in the last report', 0))
        if 'update time p50, p99 (ms)' in facts:
            self.facts = facts

    def play(self, joints, rate, seconds):
        """Publish a walk of so many joints, and wait for what comes back."""
        walk = widened(synthetic_people(1, seed=5, duration_s=30.0)[0], joints)
        poses = walk.at(np.arange(int(rate * seconds)) / rate % walk.duration_s).positions
        material = self._folder / 'material.npz'
        np.savez(material, names=walk.joint_names, poses=poses, rate=rate)
        player = self._start('play', material)
        while player.poll() is None:
            self.executor.spin_once(timeout_sec=0.1)
        if player.returncode:
            raise RuntimeError('the player failed')
        end = time.monotonic() + 1.5
        while time.monotonic() < end:  # the last report
            self.executor.spin_once(timeout_sec=0.1)

    def close(self):
        """Stop everything."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()
        for process in (self.process, self._listener):
            process.terminate()
        for process in (self.process, self._listener):
            process.wait(10)

    def stages(self, what):
        """Where each answered message's time went, and how many were sent; stage name to ms, shape (N,)."""
        sent, answered, heard = (np.load(self._folder / f'{name}.npy') for name in ('play', what, 'listen'))
        stamps, rows = _common(sent, answered, heard)
        (stamp, published, due), (_, entered, began, ended), (_, arrived) = (row.T for row in rows)
        times = {
            'due time to stamp': stamp - due, 'publish joint state': published - stamp,
            'stamp to callback': entered - stamp, 'callback to trajectory ready': began - entered,
            'publish trajectory': ended - began, 'trajectory ready to listener': arrived - began,
            'end to end': arrived - stamp}
        warm = len(stamps) // 10
        return len(sent), len(stamps), {stage: 1e-6 * spent[warm:] for stage, spent in times.items()}


def _common(*tables):
    """Stamps in all of the tables, and their rows in each."""
    stamps = tables[0][:, 0]
    for table in tables[1:]:
        stamps = np.intersect1d(stamps, table[:, 0])
    rows = []
    for table in tables:
        unique, first = np.unique(table[:, 0], return_index=True)
        rows.append(table[first[np.searchsorted(unique, stamps)]])
    return stamps, rows


def print_stages(times):
    """Each stage's percentiles, and its part in the slowest hundredth."""
    whole = times['end to end']
    slowest = whole >= np.percentile(whole, 99)
    print(f'    {"ms":32}{"p50":>8}{"p90":>8}{"p99":>8}{"max":>8}   mean in the slowest hundredth')
    for stage, spent in times.items():
        ranks = ''.join(f'{value:8.3f}' for value in np.percentile(spent, [50, 90, 99, 100]))
        print(f'    {stage:32}{ranks}{spent[slowest].mean():10.3f}')


def floor(folder, joints, rate, seconds, core):
    """The same trips through the same middleware with nothing computed."""
    trial = Run(folder, core, 'relay', joints)
    try:
        trial.play(joints, rate, seconds)
    finally:
        trial.close()
    sent, count, times = trial.stages('relay')
    p50, p99 = np.percentile(times['end to end'], [50, 99])
    print(f'{joints} joints at {rate} Hz, a relay that computes nothing: {sent} sent, {count} trajectories; '
          f'latency p50 {p50:.2f} ms, p99 {p99:.2f} ms')
    print_stages(times)
    return p50, p99


def held(folder, joints, rate, seconds, limit, core, middleware=None):
    """Play at a rate; print what was answered and how fast, also as a ratio to ``middleware`` (p50, p99 in ms)."""
    people = [widened(person, joints) for person in synthetic_people(4, duration_s=5.0)]
    model = Path(folder) / f'model{joints}.npz'
    if not model.exists():
        save_behaviours(model, [train(people, 'walk')])
    trial = Run(folder, core, 'predict', '--ros-args', '-p', f'model:={model}', '-p', f'max_publish_rate:={limit}',
                '-p', 'horizon:=0.4166667', '--log-level', 'warn')
    try:
        trial.activate()
        before = machine.processor_time(trial.process.pid)
        trial.play(joints, rate, seconds)
        busy = 1e6 * (machine.processor_time(trial.process.pid) - before) / max(trial.total, 1)
    finally:
        trial.close()
    sent, count, times = trial.stages('predict')
    p50, p99 = np.percentile(times['end to end'], [50, 99])
    limited = f', trajectories at most {limit:g} Hz' if limit else ''
    ratio = f' ({p50 / middleware[0]:.1f} and {p99 / middleware[1]:.1f} times the relay)' if middleware else ''
    print(f'{joints} joints at {rate} Hz{limited}: {sent} sent, {trial.total} taken, {trial.updates} used, '
          f'{count} trajectories; latency p50 {p50:.2f} ms, p99 {p99:.2f} ms{ratio}')
    print_stages(times)
    print(f'    inside: update {trial.facts.get("update time p50, p99 (ms)", "")} ms, '
          f'predict {trial.facts.get("predict time p50, p99 (ms)", "")} ms, '
          f'callback {trial.facts.get("callback time p50, p99 (ms)", "")} ms (p50, p99);\n'
          f'    processor time of the node {busy:.0f} us a message, {100 * busy * 1e-6 * rate:.0f} % of a core')


def templates(joints=56, points=25):
    """Trajectory as a message of objects against the serialised template."""
    rclpy.init()
    node = rclpy.create_node('bench_templates')
    publisher = node.create_publisher(JointTrajectory, 'trajectory', 10)
    node.create_subscription(JointTrajectory, 'trajectory', lambda message: None, 10)
    names = [f'joint_{number}' for number in range(joints)]
    values = np.random.default_rng(0).standard_normal((2, points, joints))

    def objects():
        message = JointTrajectory(joint_names=names, points=[
            JointTrajectoryPoint(positions=array.array('d', p.tobytes()), velocities=array.array('d', v.tobytes()))
            for p, v in zip(*values)])
        publisher.publish(message)
    template = empty_trajectory(names, points)

    def serialised():
        publisher.publish(template.write({'points.positions': values[0], 'points.velocities': values[1]}))
    medians = []
    for method in (objects, serialised):
        spent = []
        for _ in range(400):
            started = time.perf_counter()
            method()
            spent.append(time.perf_counter() - started)
        medians.append(1e6 * np.median(spent))
    node.destroy_node()
    rclpy.shutdown()
    print(f'build and publish a trajectory of {points} x {joints}: as objects {medians[0]:.0f} us, as template '
          f'{medians[1]:.0f} us: {medians[0] / medians[1]:.1f} times faster')


def main():
    """Print every figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=10.0, help='length of each run (default: 10)')
    parser.add_argument('--core', type=int, help='pin the node to this core')
    parser.add_argument('--only', choices=('templates', 'relay', 'latency', 'rate'), nargs='+',
                        help='some of the measurements (default: all)')
    machine.add_argument(parser)
    args = parser.parse_args()
    wanted = args.only or ('templates', 'relay', 'latency', 'rate')
    load = os.getloadavg()[0]
    print(f'middleware {os.environ.get("RMW_IMPLEMENTATION", "default")}, {os.cpu_count()} cores, load before the run '
          f'{load:.1f}' + (' (not idle: latencies say little)' if load > 1 else ''))
    if 'templates' in wanted:
        templates()
    with tempfile.TemporaryDirectory() as folder, machine.watched(args.awake):
        middleware = floor(folder, 56, 200, args.seconds, args.core) if 'relay' in wanted else None
        if 'latency' in wanted:
            held(folder, 56, 200, args.seconds, 0.0, args.core, middleware)
        if 'rate' in wanted:
            held(folder, 30, 1000, args.seconds, 0.0, args.core)
            held(folder, 30, 1000, args.seconds, 100.0, args.core)
    return 0


if __name__ == '__main__':
    sys.exit(main())
