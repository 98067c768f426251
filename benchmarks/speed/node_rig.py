"""The processes that `bench_node.py` measures with: player, listener, relay, and the predictor with a stopwatch.

Each notes times of the machine's clock (``time.time_ns``, the same in all processes) and writes them down when it ends.
Player and listener are made so that they add as little as Python can: messages are serialised before the run, the
player collects no garbage (the others do between messages, as every node of the suite), it waits for each moment awake
(so it is not late by its own waking), and the listener takes the time before it looks at the message.
"""
import gc
import struct
import sys
import time

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_node.executor import run
from style_node.templates import MessageTemplate, stamps_of
from style_predictor.predictor_node import PredictorNode

INPUT, OUTPUT = '/joint_states', '/predictor/trajectory'
#: where the stamp of a serialised message with a header is
STAMP = slice(4, 12)
#: how long before its moment the player is awake, s
AWAKE = 0.0006


def play(path, material):
    """Publish the poses of a file at its rate; writes stamp (just before publishing), time after, due time."""
    with np.load(material) as data:
        names, poses, rate = data['names'].tolist(), data['poses'], float(data['rate'])
    rclpy.init(args=[])
    node = rclpy.create_node('player')
    publisher = node.create_publisher(JointState, INPUT, 64)
    bodies = [serialize_message(JointState(name=names, position=pose.tolist()))[STAMP.stop:] for pose in poses]
    head = serialize_message(JointState())[:STAMP.start]
    while not (publisher.get_subscription_count() and node.count_subscribers(OUTPUT)):
        time.sleep(0.05)
    time.sleep(1.0)  # node and listener have found each other
    gc.collect()
    gc.freeze()
    gc.disable()
    noted = np.zeros((len(bodies), 3), np.int64)
    begin = time.time_ns() + 50_000_000
    for number, body in enumerate(bodies):
        due = begin + round(1e9 * number / rate)
        if (left := 1e-9 * (due - time.time_ns()) - AWAKE) > 0:
            time.sleep(left)
        while time.time_ns() < due:
            pass
        stamp = time.time_ns()
        publisher.publish(head + struct.pack('<II', *divmod(stamp, 1_000_000_000)) + body)
        noted[number] = stamp, time.time_ns(), due
    np.save(path, noted)
    time.sleep(0.5)
    node.destroy_node()
    rclpy.shutdown()
    return 0


def listen(path):
    """Write down the stamp and the arrival of each trajectory."""
    heard = []

    def make():
        node = rclpy.create_node('listener')

        def note(data):
            now = time.time_ns()
            heard.append((data[:STAMP.stop], now))
        node.create_subscription(JointTrajectory, OUTPUT, note, QoSProfile(depth=200), raw=True)
        return node
    status = run(make, 'listener', args=[])
    np.save(path, np.column_stack([stamps_of([stamp for stamp, _ in heard]), [now for _, now in heard]]))
    return status


def empty_trajectory(names, points=25):
    """Template of a trajectory."""
    return MessageTemplate(JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(positions=[0.0] * len(names), velocities=[0.0] * len(names)) for _ in range(points)]))


class Stopwatch:
    """Times of entering the callback, and of beginning and ending to publish the trajectory."""

    def __init__(self):
        self._noted = []
        self.entered = 0

    def enter(self):
        """A message has reached the callback."""
        self.entered = time.time_ns()

    def around(self, publish):
        """A function that publishes and notes when."""
        def noting(data):
            began = time.time_ns()
            publish(data)
            self._noted.append((data[:STAMP.stop], self.entered, began, time.time_ns()))
        return noting

    def write(self, path):
        """Rows of stamp, entered, began and ended."""
        np.save(path, np.column_stack([stamps_of([row[0] for row in self._noted]), [row[1:] for row in self._noted]]))


def relay(path, joints):
    """Answer every joint state with the same serialised trajectory under its stamp."""
    watch = Stopwatch()

    def make():
        node = rclpy.create_node('relay')
        publish = watch.around(node.create_publisher(JointTrajectory, OUTPUT, 5).publish)
        answer = empty_trajectory([f'joint_{number}' for number in range(int(joints))]).write({})

        def on_joint_states(data):
            watch.enter()
            publish(answer[:STAMP.start] + data[STAMP] + answer[STAMP.stop:])
        node.create_subscription(JointState, INPUT, on_joint_states,
                                 QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT), raw=True)
        return node
    status = run(make, 'relay', args=[])
    watch.write(path)
    return status


def predict(path, *args):
    """The predictor node as it is, with a stopwatch."""
    watch = Stopwatch()

    class Watched(PredictorNode):
        def on_configure(self, state):
            result = super().on_configure(state)
            publisher = self._outputs._topics['trajectory']
            publisher.publish = watch.around(publisher.publish)
            return result

        def _on_joint_states(self, message):
            watch.enter()
            super()._on_joint_states(message)
    status = run(Watched, 'predictor', args=list(args))
    watch.write(path)
    return status


if __name__ == '__main__':
    sys.exit({one.__name__: one for one in (play, listen, relay, predict)}[sys.argv[1]](*sys.argv[2:]))
