"""What the system tests share: a domain of one's own, a node that speaks to the nodes under test, a small model."""
import array
import os
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train
from style_core.synthetic import synthetic_people

ROOT = Path(__file__).resolve().parents[1]


def own_domain(name):
    """Take a domain id for this process and test file, and put it where nodes started from here find it."""
    domain = 1 + (os.getpid() * 7 + sum(map(ord, name))) % 100
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    return domain


def small_model():
    """A phase-style model of a synthetic walk, trained once a machine and version; returns its path."""
    import style_core
    path = Path(tempfile.gettempdir()) / f'style_test_model_{os.getuid()}_{os.getpid()}_{style_core.__version__}.npz'
    if not path.exists():
        save_behaviours(path, [train(synthetic_people(4, duration_s=5.0), 'walk')])
    return path


class Probe:
    """A node that publishes joint states, remembers what comes back, and calls services.

    Parameters
    ----------
    target : str
        Name of the node under test.
    topics : mapping of str to (type, qos)
        What to listen to.
    """

    def __init__(self, target, topics):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('probe', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.target = target
        self.heard = defaultdict(list)
        self.publisher = self.node.create_publisher(JointState, '/joint_states', 50)
        for topic, (kind, qos) in topics.items():
            self.listen(topic, kind, qos)

    def listen(self, topic, kind, qos=None):
        """Remember every message of a topic in ``heard[topic]``."""
        self.node.create_subscription(kind, topic, self.heard[topic].append, qos or QoSProfile(depth=1000))

    def close(self):
        """Take the node down."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def wait(self, condition, timeout=10.0):
        """Spin until the condition holds; its last value."""
        deadline = time.monotonic() + timeout
        while not (result := condition()) and time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)
        return result

    def spin(self, seconds):
        """Listen for a while."""
        self.wait(lambda: False, seconds)

    def call(self, kind, service, timeout=10.0, **fields):
        """Call a service of the target; its response, or None after the time-out."""
        client = self.node.create_client(kind, f'/{self.target}/{service}')
        try:
            if not self.wait(client.service_is_ready, timeout):
                return None
            future = client.call_async(kind.Request(**fields))
            self.wait(future.done, timeout)
            return future.result() if future.done() else None
        finally:
            self.node.destroy_client(client)

    def transition(self, label):
        """Ask for a lifecycle transition; whether it succeeded."""
        request = ChangeState.Request()
        request.transition.label = label
        response = self.call(ChangeState, 'change_state', transition=request.transition)
        return response is not None and response.success

    def state(self):
        """The target's lifecycle state."""
        response = self.call(GetState, 'get_state')
        return response.current_state.label if response is not None else ''

    def set_parameters(self, **values):
        """Set parameters together; '' or the reason why not."""
        response = self.call(SetParametersAtomically, 'set_parameters_atomically', parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
        return '' if response.result.successful else response.result.reason

    def now(self):
        """Clock, ns."""
        return self.node.get_clock().now().nanoseconds

    def send(self, names, positions, stamp):
        """Publish a JointState; ``stamp`` in ns."""
        message = JointState(name=list(names), position=array.array('d', positions))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(stamp), 1_000_000_000)
        self.publisher.publish(message)


def stamp_of(message):
    """The stamp of a message, ns."""
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
