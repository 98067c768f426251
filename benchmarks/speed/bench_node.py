"""Speed of the predictor node: rates held without a missed message, end-to-end latency, and what templates save.

The node runs as a process of its own; a publisher and a listener run here. Latency counts from just before the joint
state is published to just after the trajectory was received, so it holds two trips through the middleware and both
ends' Python.
"""
import argparse
import array
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.motion import Motion
from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train
from style_core.synthetic import synthetic_people
from style_predictor.templates import MessageTemplate


def widened(motion, joints):
    """The motion with exactly so many joints: some left out, or some repeated under new names."""
    columns = np.resize(np.arange(motion.n_joints), joints)
    names = [motion.joint_names[c] + (f'.copy{n // motion.n_joints}' if n >= motion.n_joints else '')
             for n, c in enumerate(columns)]
    return Motion(tuple(names), motion.positions[:, columns], motion.times, name=motion.name)


class Run:
    """One node process and what is needed to measure it."""

    def __init__(self, model, core, rate_limit):
        command = ['ros2', 'run', 'style_predictor', 'predictor', '--ros-args', '-p', f'model:={model}',
                   '-p', f'max_publish_rate:={rate_limit}', '-p', 'horizon:=0.4166667', '--log-level', 'warn']
        if core is not None:
            command = ['taskset', '-c', str(core), *command]
        self.process = subprocess.Popen(command, start_new_session=True)
        rclpy.init()
        self.node = rclpy.create_node('bench')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        client = self.node.create_client(ChangeState, '/predictor/change_state')
        client.wait_for_service(20.0)
        for label in ('configure', 'activate'):
            request = ChangeState.Request()
            request.transition.label = label
            future = client.call_async(request)
            self.executor.spin_until_future_complete(future, timeout_sec=20.0)
            if not (future.done() and future.result().success):
                raise RuntimeError(f'the node did not {label}')
        self.publisher = self.node.create_publisher(JointState, '/joint_states', 64)
        self.received, self.facts, self.total, self.updates = {}, {}, 0, 0
        self.node.create_subscription(JointTrajectory, '/predictor/trajectory', self._on_trajectory,
                                      QoSProfile(depth=200), raw=True)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.spinner = threading.Thread(target=self._spin, daemon=True)
        self.spinning = True
        self.spinner.start()

    def _spin(self):
        while self.spinning:
            self.executor.spin_once(timeout_sec=0.1)

    def _on_trajectory(self, data):
        stamp = np.frombuffer(data, np.uint32, 2, 4)
        self.received[int(stamp[0]) * 1_000_000_000 + int(stamp[1])] = time.time_ns()

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
        while self.publisher.get_subscription_count() < 1:
            time.sleep(0.05)
        frames = int(rate * seconds)
        at = np.arange(frames) / rate
        poses = motion.at(at % motion.duration_s).positions
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
        time.sleep(2.2)
        return sent

    def close(self):
        """Stop everything."""
        self.spinning = False
        self.spinner.join()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()
        os.killpg(self.process.pid, 2)
        self.process.wait(10)


def held(folder, joints, rate, seconds, limit, core):
    """Play at a rate; print what was answered and how fast."""
    people = [widened(person, joints) for person in synthetic_people(4, duration_s=5.0)]
    model = Path(folder) / f'model{joints}.npz'
    if not model.exists():
        save_behaviours(model, [train(people, 'walk')])
    run = Run(model, core, limit)
    try:
        walk = widened(synthetic_people(1, seed=5, duration_s=30.0)[0], joints)
        before = run.cpu_seconds()
        sent = run.play(walk, rate, seconds)
        busy = 1e6 * (run.cpu_seconds() - before) / max(run.total, 1)
        latency = np.array([run.received[stamp] - stamp for stamp in sent if stamp in run.received]) * 1e-6
        p50, p99 = np.percentile(latency[len(latency) // 10:], [50, 99])
        limited = f', trajectories at most {limit:g} Hz' if limit else ''
        print(f'{joints} joints at {rate} Hz{limited}: {len(sent)} sent, {run.total} taken, {run.updates} used, '
              f'{len(run.received)} trajectories; latency p50 {p50:.2f} ms, p99 {p99:.2f} ms')
        print(f'    inside: update {run.facts.get("update time p50, p99 (ms)", "")} ms, '
              f'predict {run.facts.get("predict time p50, p99 (ms)", "")} ms, '
              f'callback {run.facts.get("callback time p50, p99 (ms)", "")} ms (p50, p99);\n'
              f'    processor time of the node {busy:.0f} us a message, {100 * busy * 1e-6 * rate:.0f} % of a core')
    finally:
        run.close()


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
    template = MessageTemplate(JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(positions=[0.0] * joints, velocities=[0.0] * joints) for _ in range(points)]))

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
    args = parser.parse_args()
    load = os.getloadavg()[0]
    print(f'middleware {os.environ.get("RMW_IMPLEMENTATION", "default")}, {os.cpu_count()} cores, load before the run '
          f'{load:.1f}' + (' (not idle: latencies say little)' if load > 1 else ''))
    templates()
    with tempfile.TemporaryDirectory() as folder:
        held(folder, 56, 200, args.seconds, 0.0, args.core)
        held(folder, 30, 1000, args.seconds, 0.0, args.core)
        held(folder, 30, 1000, args.seconds, 100.0, args.core)
    return 0


if __name__ == '__main__':
    sys.exit(main())
