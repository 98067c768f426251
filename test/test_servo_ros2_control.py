"""The bridge driving ros2_control, against controllers that behave like joint_trajectory_controller."""
import contextlib
import signal
import threading
import time

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from lifecycle_msgs.msg import Transition
from rclpy.action import ActionServer, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from sensor_msgs.msg import JointState
from servo_rig import ServoRig
from trajectory_msgs.msg import JointTrajectory

from style_servo.record import read_record, violations
from style_servo.states import State

CHAIN = 'exosuit6_ros2_control.yaml'


class Controller:
    """Joints that go where they are told, with the controller's topic or its action, and a state broadcaster."""

    def __init__(self, rig, action):
        self.rig, self.names = rig, list(rig.chain.names)
        self.position = np.array([0.3, 0.5, 0.0, 0.3, 0.5, 0.0])
        self.received, self.refuse, self.silent, self.error = [], False, False, ''
        node = self.node = rclpy.create_node('controller', context=rig.context)
        self.states = node.create_publisher(JointState, '/joint_states', 10)
        self.timer = node.create_timer(0.01, self.broadcast)
        if action:
            self.server = ActionServer(
                node, FollowJointTrajectory, '/joint_trajectory_controller/follow_joint_trajectory', self.execute,
                goal_callback=lambda goal: GoalResponse.REJECT if self.refuse else GoalResponse.ACCEPT,
                callback_group=ReentrantCallbackGroup())
        else:
            node.create_subscription(JointTrajectory, '/joint_trajectory_controller/joint_trajectory', self.take, 1)
        self.executor = SingleThreadedExecutor(context=rig.context)
        self.executor.add_node(node)
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        """A process of its own, as it were: the rig must not slow it down."""
        with contextlib.suppress(ExternalShutdownException, rclpy.executors.ShutdownException):
            self.executor.spin()

    def close(self):
        self.executor.shutdown()
        self.thread.join()
        self.node.destroy_node()

    def broadcast(self):
        if not self.silent:
            self.states.publish(JointState(name=self.names[::-1], position=self.position[::-1].tolist()))

    def take(self, trajectory):
        assert list(trajectory.joint_names) == self.names
        self.received.append(trajectory)
        self.position = np.array(trajectory.points[0].positions)

    def execute(self, handle):
        self.take(handle.request.trajectory)
        if self.error:
            handle.abort()
            return FollowJointTrajectory.Result(error_code=-4, error_string=self.error)
        handle.succeed()
        return FollowJointTrajectory.Result()


@pytest.fixture(params=['topic', 'action'])
def driven(tmp_path, request):
    rig = ServoRig(str(tmp_path), chain=CHAIN, simulate=False, backend='ros2_control', interface=request.param,
                   rate=100.0, state_timeout=2.0, following_time=2.0)
    controller = Controller(rig, request.param == 'action')
    yield rig, controller
    controller.close()
    rig.close()


def test_streaming_through_the_controller(driven):
    rig, controller = driven
    rig.spin(1.0)       # discovery
    rig.up()
    np.testing.assert_allclose(rig.states[-1].commanded, controller.position, atol=1e-6)
    rig.stream_until(State.STREAMING, 40)
    rig.stream(0.5)
    assert rig.states[-1].cycles > 10 and len(controller.received) > 5
    for trajectory in controller.received:
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in trajectory.points]
        assert np.all(np.diff([0.0, *times]) > 0)
        for point in trajectory.points:
            assert np.all(np.array(point.positions) >= rig.chain.array('lower'))
            assert np.all(np.array(point.positions) <= rig.chain.array('upper'))
        # whatever happens to the bridge, the controller already knows how to stop
        assert not np.any(trajectory.points[-1].velocities)
    assert any(np.any(trajectory.points[0].velocities) for trajectory in controller.received)
    rig.wait_for(State.HOLDING)
    controller.silent = True
    rig.wait_for(State.FAULT)
    assert 'no joint states' in rig.reason
    controller.silent = False
    rig.spin(0.5)
    assert rig.trigger('reset').success
    rig.bridge.send_signal(signal.SIGINT)
    rig.bridge.wait(20)
    counts = violations(read_record(rig.record))
    assert counts.pop('commands') and not any(counts.values()), counts


@pytest.mark.parametrize('driven', ['action'], indirect=True)
def test_refused_and_failed_goals_are_faults(driven):
    rig, controller = driven
    rig.spin(1.0)
    rig.up()
    rig.stream_until(State.STREAMING, 40)
    controller.error = 'path tolerance of left_knee violated'
    rig.until(lambda: rig.state is State.FAULT, 40, rig.send_legal)
    assert 'error -4' in rig.reason and 'left_knee' in rig.reason
    controller.error = ''
    rig.spin(0.5)
    assert rig.trigger('reset').success
    rig.until(lambda: rig.state is not State.FAULT, 40)
    controller.refuse = True
    rig.until(lambda: rig.state is State.FAULT, 40, rig.send_legal)
    assert 'refuses goals' in rig.reason


def test_nobody_listening_is_told_at_activation(tmp_path):
    rig = ServoRig(str(tmp_path), chain=CHAIN, simulate=False, backend='ros2_control')
    try:
        assert rig.change(Transition.TRANSITION_CONFIGURE)
        assert not rig.change(Transition.TRANSITION_ACTIVATE)
        rig.until(lambda: 'not known' in rig.log())
        names = list(rig.chain.names)
        states = rig.node.create_publisher(JointState, '/joint_states', 10)
        rig.node.create_timer(0.01, lambda: states.publish(JointState(name=names, position=[0.1] * len(names))))
        rig.spin(1.0)
        assert not rig.change(Transition.TRANSITION_ACTIVATE)
        rig.until(lambda: 'nobody listens to /joint_trajectory_controller' in rig.log())
    finally:
        rig.close()
        time.sleep(0.1)
