"""The launch file brings up simulated servos and an active bridge, and everything stops in order."""
import time
import unittest
from pathlib import Path

import launch_testing
import pytest
import rclpy
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from rclpy.qos import DurabilityPolicy, QoSProfile
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_msgs.msg import BridgeState

LAUNCH = Path(__file__).resolve().parents[1] / 'launch' / 'servo.launch.py'


@pytest.mark.launch_test
def generate_test_description():
    """The launch file as a user starts it."""
    return LaunchDescription([
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(LAUNCH)),
                                 launch_arguments={
                                     'sim': 'true', 'chain': 'exosuit6.yaml',
                                     'params': str(Path(__file__).parent / 'servo_patient.yaml')}.items()),
        ReadyToTest()])


class TestLaunch(unittest.TestCase):
    """While it runs."""

    def setUp(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('watcher', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.states = []
        self.node.create_subscription(BridgeState, '/servo_bridge/state', self.states.append,
                                      QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def tearDown(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, condition, seconds=60.0):
        """Receive until a condition holds."""
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, self.states[-1:])
            self.executor.spin_once(timeout_sec=0.05)

    def test_a_goal_is_reached_by_the_simulated_servos(self):
        self.until(lambda: self.states and self.states[-1].state == BridgeState.READY)
        names = self.states[-1].joint_names
        goal = JointTrajectory(joint_names=names)
        point = JointTrajectoryPoint(positions=[0.3, 0.6, 0.1, 0.3, 0.6, 0.1])
        point.time_from_start.sec = 2
        goal.points.append(point)
        publisher = self.node.create_publisher(JointTrajectory, '/joint_trajectory', 1)
        self.until(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(goal)
        self.until(lambda: self.states[-1].accepted > 0 and self.states[-1].state == BridgeState.READY)
        self.until(lambda: max(abs(a - b) for a, b in zip(self.states[-1].measured, point.positions)) < 0.01)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """After it."""

    def test_everything_ends_in_order(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
