"""Record what nodes say, write it as a bag, and read it back by topic."""
import time
from pathlib import Path

import numpy as np
import rclpy
from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from style_msgs.msg import MotionPrediction, StyleEstimate
from style_node.templates import MessageTemplate, stamps_of

__all__ = ['Recorder']

TOPICS = {
    '/joint_states': JointState, '/motion_player/truth': JointState, '/predictor/trajectory': JointTrajectory,
    '/predictor/prediction': MotionPrediction, '/predictor/estimate': StyleEstimate, '/predictor/filled': JointState,
    '/predictor/model': String, '/diagnostics': DiagnosticArray,
}
LATCHED = ('/predictor/model',)


class Recorder:
    """Subscribes to everything and keeps the serialised messages.

    Attributes
    ----------
    messages : list of (int, str, bytes)
        Time of arrival, ns; topic; message as it came.
    """

    def __init__(self):
        rclpy.init()
        self._node = rclpy.create_node('demo_recorder')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self.messages = []
        for topic, kind in TOPICS.items():
            durability = DurabilityPolicy.TRANSIENT_LOCAL if topic in LATCHED else DurabilityPolicy.VOLATILE
            self._subscribe(topic, kind, QoSProfile(depth=2000, durability=durability))

    def _subscribe(self, topic, kind, qos):
        def take(data):
            # all that has come at one go: a wait for each would cost more than the messages, and make them look late
            while data is not None:
                self.messages.append((time.time_ns(), topic, data))
                taken = subscription.handle.take_message(kind, True)
                data = taken[0] if taken is not None else None
        subscription = self._node.create_subscription(kind, topic, take, qos, raw=True)

    def record(self, seconds, alive, patience=60.0):
        """Record until ``seconds`` after the first joint state, or until ``alive()`` is false."""
        stop = time.monotonic() + patience
        started = False
        while time.monotonic() < stop and alive():
            self._executor.spin_once(timeout_sec=0.1)
            if not started and any(topic == '/joint_states' for _, topic, _ in self.messages):
                started, stop = True, time.monotonic() + seconds

    def close(self):
        """Stop listening."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def times(self, topic):
        """Arrivals and stamps (ns) of a topic's messages, which begin with a header."""
        own = [(arrival, data) for arrival, name, data in self.messages if name == topic]
        return np.array([arrival for arrival, _ in own]), stamps_of([data for _, data in own])

    def numbers(self, topic, *paths):
        """The first of a topic's messages, which differ in numbers alone, and the numbers at each path, (T, ...)."""
        own = [data for _, name, data in self.messages if name == topic]
        first = deserialize_message(own[0], TOPICS[topic])
        template = MessageTemplate(first)
        return first, *map(np.array, zip(*(template.read(data, *paths) for data in own)))

    def read(self, topic):
        """Arrivals (ns) and messages of a topic."""
        return [(arrival, deserialize_message(data, TOPICS[topic]))
                for arrival, own, data in self.messages if own == topic]

    def write(self, path):
        """Write everything as a ROS 2 bag (sqlite3)."""
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        store = get_typestore(Stores.ROS2_HUMBLE)
        known = {}
        for name in ('StyleEstimate', 'MotionPrediction'):
            text = (Path(get_package_share_directory('style_msgs')) / 'msg' / f'{name}.msg').read_text()
            known.update(get_types_from_msg(text, f'style_msgs/msg/{name}'))
        store.register(known)
        names = {topic: f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}' for topic, kind in TOPICS.items()}
        with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
            connections = {topic: bag.add_connection(topic, names[topic], typestore=store)
                           for topic in sorted({topic for _, topic, _ in self.messages})}
            for arrival, topic, data in self.messages:
                bag.write(connections[topic], arrival, data)
