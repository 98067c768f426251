"""Speed of the predictor node: rates held without a missed message, end-to-end latency, and what templates save.

Publisher, node and listener are processes of their own, as on a robot. Latency counts from just before the joint state
is published to just after the trajectory was received, so it holds two trips through the middleware and both ends'
Python. In the same run a relay that answers every joint state with a ready-made trajectory of the same size, and
computes nothing, shows what of it is the middleware's (the floor).
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
if not {'--relay', '--listen'} & set(sys.argv):
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.motion import Motion
from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train
from style_core.synthetic import synthetic_people
from style_predictor.executor import run
from style_predictor.templates import MessageTemplate


def widened(motion, joints):
    """The motion with exactly so many joints: some left out, or some repeated under new names."""
    columns = np.resize(np.arange(motion.n_joints), joints)
    names = [motion.joint_names[c] + (f'.copy{n // motion.n_joints}' if n >= motion.n_joints else '')
             for n, c in enumerate(columns)]
    return Motion(tuple(names), motion.positions[:, columns], motion.times, name=motion.name)


def relay(joints):
    """Answer every joint state with the same serialised trajectory under its stamp; runs until it is stopped."""
    def make():
        node = rclpy.create_node('relay')
        publisher = node.create_publisher(JointTrajectory, '/predictor/trajectory', 5)
        template = empty_trajectory([f'joint_{number}' for number in range(joints)])

        def answer(data):
            seconds, nanoseconds = np.frombuffer(data, np.uint32, 2, 4)
            publisher.publish(template.write({'header.stamp.sec': seconds, 'header.stamp.nanosec': nanoseconds}))
        node.create_subscription(JointState, '/joint_states', answer,
                                 QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT), raw=True)
        return node
    return run(make, 'relay', args=[])


def listen(path):
    """Write down when each trajectory arrived: pairs of stamp and arrival, ns, when stopped."""
    heard = []

    def make():
        node = rclpy.create_node('listener')

        def note(data):
            heard.append((data[4:12], time.time_ns()))
        node.create_subscription(JointTrajectory, '/predictor/trajectory', note, QoSProfile(depth=200), raw=True)
        return node
    status = run(make, 'listener', args=[])
    stamps = np.frombuffer(b''.join(stamp for stamp, _ in heard), np.uint32).reshape(-1, 2).astype(np.int64)
    np.save(path, np.column_stack([stamps @ [1_000_000_000, 1], [arrival for _, arrival in heard]]))
    return status


class Run:
    """One process that answers, one that listens, and what is needed to measure them."""

    def __init__(self, command, core, folder):
        if core is not None:
            command = ['taskset', '-c', str(core), *command]
        self.process = subprocess.Popen(command, start_new_session=True)
        self._heard = Path(folder) / 'heard.npy'
        self._listener = subprocess.Popen([sys.executable, __file__, '--listen', str(self._heard)])
        rclpy.init()
        self.node = rclpy.create_node('bench')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publisher = self.node.create_publisher(JointState, '/joint_states', 64)
        self.facts, self.total, self.updates = {}, 0, 0
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

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

    def cpu_seconds(self):
        """Processor time of the node so far: of all processes of its group."""
        ticks = 0
        for stat in Path('/proc').glob('[0-9]*/stat'):
            try:
                fields = stat.read_text().rpartition(')')[2].split()
            except OSError:
                continue
            if int(fields[2]) == self.process.pid:
                ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf('SC_CLK_TCK')

    def play(self, motion, rate, seconds):
        """Publish; returns the stamps sent."""
        while self.publisher.get_subscription_count() < 1 or \
                self.node.count_subscribers('/predictor/trajectory') < 1:
            self.executor.spin_once(timeout_sec=0.05)
        time.sleep(1.0)  # the listener has found the node
        frames = int(rate * seconds)
        poses = motion.at(np.arange(frames) / rate % motion.duration_s).positions
        message = JointState(name=list(motion.joint_names))
        sent = []
        begin = time.perf_counter() + 0.05
        for number in range(frames):
            while (left := begin + number / rate - time.perf_counter()) > 0:
                time.sleep(max(left - 0.0001, 0))
            stamp = time.time_ns()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            message.position = array.array('d', poses[number].tobytes())
            self.publisher.publish(message)
            sent.append(stamp)
            if number % 50 == 0:
                self.executor.spin_once(timeout_sec=0)
        end = time.monotonic() + 2.2
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)
        return sent

    def close(self):
        """Stop everything; when each trajectory arrived, by stamp."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()
        os.killpg(self.process.pid, 2)
        self._listener.send_signal(2)
        self.process.wait(10)
        self._listener.wait(10)
        return dict(np.load(self._heard).tolist()) if self._heard.exists() else {}


def latency_of(sent, arrived):
    """Trajectories, and latency p50 and p99 in ms once everything is warm."""
    late = np.array([arrived[stamp] - stamp for stamp in sent if stamp in arrived]) * 1e-6
    return len(late), *np.percentile(late[len(late) // 10:], [50, 99])


def floor(folder, joints, rate, seconds, core):
    """The same trips through the same middleware with nothing computed."""
    trial = Run([sys.executable, __file__, '--relay', str(joints)], core, folder)
    try:
        walk = widened(synthetic_people(1, seed=5, duration_s=30.0)[0], joints)
        sent = trial.play(walk, rate, seconds)
    finally:
        arrived = trial.close()
    count, p50, p99 = latency_of(sent, arrived)
    print(f'{joints} joints at {rate} Hz, a relay that computes nothing: {len(sent)} sent, {count} trajectories; '
          f'latency p50 {p50:.2f} ms, p99 {p99:.2f} ms')
    return p50, p99


def held(folder, joints, rate, seconds, limit, core, middleware=None):
    """Play at a rate; print what was answered and how fast, also as a ratio to ``middleware`` (p50, p99 in ms)."""
    people = [widened(person, joints) for person in synthetic_people(4, duration_s=5.0)]
    model = Path(folder) / f'model{joints}.npz'
    if not model.exists():
        save_behaviours(model, [train(people, 'walk')])
    trial = Run(['ros2', 'run', 'style_predictor', 'predictor', '--ros-args', '-p', f'model:={model}', '-p',
                 f'max_publish_rate:={limit}', '-p', 'horizon:=0.4166667', '--log-level', 'warn'], core, folder)
    try:
        trial.activate()
        walk = widened(synthetic_people(1, seed=5, duration_s=30.0)[0], joints)
        before = trial.cpu_seconds()
        sent = trial.play(walk, rate, seconds)
        busy = 1e6 * (trial.cpu_seconds() - before) / max(trial.total, 1)
    finally:
        arrived = trial.close()
    count, p50, p99 = latency_of(sent, arrived)
    limited = f', trajectories at most {limit:g} Hz' if limit else ''
    ratio = f' ({p50 / middleware[0]:.1f} and {p99 / middleware[1]:.1f} times the relay)' if middleware else ''
    print(f'{joints} joints at {rate} Hz{limited}: {len(sent)} sent, {trial.total} taken, {trial.updates} used, '
          f'{count} trajectories; latency p50 {p50:.2f} ms, p99 {p99:.2f} ms{ratio}')
    print(f'    inside: update {trial.facts.get("update time p50, p99 (ms)", "")} ms, '
          f'predict {trial.facts.get("predict time p50, p99 (ms)", "")} ms, '
          f'callback {trial.facts.get("callback time p50, p99 (ms)", "")} ms (p50, p99);\n'
          f'    processor time of the node {busy:.0f} us a message, {100 * busy * 1e-6 * rate:.0f} % of a core')


def empty_trajectory(names, points=25):
    """Template of a trajectory."""
    return MessageTemplate(JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(positions=[0.0] * len(names), velocities=[0.0] * len(names)) for _ in range(points)]))


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
    parser.add_argument('--relay', type=int, metavar='JOINTS', help=argparse.SUPPRESS)
    parser.add_argument('--listen', type=Path, metavar='FILE', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.relay:
        return relay(args.relay)
    if args.listen:
        return listen(args.listen)
    load = os.getloadavg()[0]
    print(f'middleware {os.environ.get("RMW_IMPLEMENTATION", "default")}, {os.cpu_count()} cores, load before the run '
          f'{load:.1f}' + (' (not idle: latencies say little)' if load > 1 else ''))
    templates()
    with tempfile.TemporaryDirectory() as folder:
        middleware = floor(folder, 56, 200, args.seconds, args.core)
        held(folder, 56, 200, args.seconds, 0.0, args.core, middleware)
        held(folder, 30, 1000, args.seconds, 0.0, args.core)
        held(folder, 30, 1000, args.seconds, 100.0, args.core)
    return 0


if __name__ == '__main__':
    sys.exit(main())
