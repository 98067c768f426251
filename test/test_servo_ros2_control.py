"""The bridge driving ros2_control over real middleware, against a node that behaves as its controller does."""
import os
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
from control_msgs.action import FollowJointTrajectory
from controller_node import ControllerNode
from lifecycle_msgs.msg import Transition
from rclpy.action import ActionClient
from servo_rig import ROOT, ServoRig
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_servo.record import read_record, violations
from style_servo.states import State

CHAIN = 'exosuit6_ros2_control.yaml'
POSTURE = np.array([0.3, 0.5, 0.0, 0.3, 0.5, 0.0])
ACTIVATE = Transition.TRANSITION_ACTIVATE


class Robot:
    """A bridge process and controllers in threads."""

    def __init__(self, folder, interface, **parameters):
        self.rig = ServoRig(str(folder), chain=CHAIN, simulate=False, **{
            'backend': 'ros2_control', 'interface': interface, 'rate': 50.0, 'goal_rate': 10.0, 'state_timeout': 1.0,
            'following_time': 2.0, 'transport_time': 0.03, 'start_wait': 5.0, **parameters})
        self.names, self.controllers = list(self.rig.chain.names), []

    def controller(self, position=POSTURE, joints=None, **parameters):
        """Start a controller."""
        one = ControllerNode(self.rig.context, joints or self.names, position, **parameters)
        self.controllers.append(one)
        return one

    def log_says(self, words):
        """Wait until the bridge's log has these words."""
        self.rig.until(lambda: words in self.rig.log())

    def close(self):
        for one in self.controllers:
            one.close()
        self.rig.close()


@pytest.fixture
def robot(tmp_path, request):
    one = Robot(tmp_path, getattr(request, 'param', 'topic'))
    yield one
    one.close()


both = pytest.mark.parametrize('robot', ['topic', 'action'], indirect=True)


@both
def test_a_stream_is_followed_and_every_stop_is_known_ahead(robot):
    rig, controller = robot.rig, robot.controller()
    rig.up()
    np.testing.assert_allclose(rig.states[-1].commanded, POSTURE, atol=1e-6)
    rig.stream_until(State.STREAMING, 40)
    begin = len(controller.commands)
    rig.stream(1.0)
    assert rig.state is State.STREAMING
    times, commands = map(np.array, zip(*controller.commands[begin:]))
    speeds = np.diff(commands, axis=0) / np.diff(times)[:, None]
    assert np.abs(speeds).max(axis=0).min() > 0.3       # every joint moves
    # how well: test_servo_controller.py; a busy machine keeps messages back longer than they plan ahead
    for message in controller.received:
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
        assert times[0] == 0.0 and np.all(np.diff(times) > 0)
        positions = np.array([point.positions for point in message.points])
        assert np.all((positions >= rig.chain.array('lower')) & (positions <= rig.chain.array('upper')))
        # whatever happens to the bridge, the controller already knows how to stop
        assert not np.any(message.points[-1].velocities)
    rig.wait_for(State.HOLDING)
    controller.silent = True
    rig.wait_for(State.FAULT)
    assert 'no joint states' in rig.reason
    controller.silent = False
    rig.until(lambda: rig.trigger('reset').success)
    rig.bridge.send_signal(signal.SIGINT)
    rig.bridge.wait(20)
    counts = violations(read_record(rig.record))
    assert counts.pop('commands') and not any(counts.values()), counts


@pytest.mark.parametrize('robot', ['action'], indirect=True)
def test_a_goal_that_the_controller_aborts_is_a_fault(robot):
    rig, controller = robot.rig, robot.controller(trajectory=0.3)
    rig.up()
    rig.stream_until(State.STREAMING, 40)
    controller.stuck[1] = True
    rig.until(lambda: rig.state is State.FAULT, 40, rig.send_legal)
    assert 'error -4' in rig.reason and 'path tolerance' in rig.reason


@pytest.mark.parametrize('robot', ['action'], indirect=True)
def test_somebody_elses_goal_is_a_fault(robot):
    rig = robot.rig
    robot.controller()
    rig.up()
    other = ActionClient(rig.node, FollowJointTrajectory, '/joint_trajectory_controller/follow_joint_trajectory')
    try:
        rig.until(other.server_is_ready)
        point = JointTrajectoryPoint(positions=POSTURE.tolist())
        point.time_from_start.sec = 5
        goal = FollowJointTrajectory.Goal(trajectory=JointTrajectory(joint_names=robot.names, points=[point]))
        rig.until(lambda: rig.state is State.FAULT, 20, lambda: other.send_goal_async(goal))
        assert 'somebody else' in rig.reason
    finally:
        other.destroy()


@both
def test_joints_that_the_chain_does_not_name_hold_where_partial_goals_are_allowed(robot):
    rig = robot.rig
    controller = robot.controller(np.append(POSTURE, 0.7), [*robot.names, 'trunk'], allow_partial_joints_goal=True)
    rig.up()
    robot.log_says('moves trunk as well')
    rig.stream_until(State.STREAMING, 40)
    rig.stream(0.3)
    commands = np.array([command for _, command in controller.commands])
    assert np.ptp(commands[:, :6], axis=0).min() > 0.05 and np.all(commands[:, 6] == 0.7)


@pytest.mark.parametrize('robot, words', [('topic', 'does not follow'), ('action', 'refuses goals')],
                         indirect=['robot'])
def test_partial_goals_that_are_not_allowed_end_in_a_fault(robot, words):
    rig = robot.rig
    controller = robot.controller(np.append(POSTURE, 0.7), [*robot.names, 'trunk'])
    rig.up()
    rig.until(lambda: rig.state is State.FAULT, 40, rig.send_legal)
    assert words in rig.reason
    assert all(np.all(command == controller.commands[0][1]) for _, command in controller.commands)


@both
def test_a_controller_that_is_restarted_is_not_moved_before_a_reset(robot):
    rig, controller = robot.rig, robot.controller()
    rig.up()
    rig.stream_until(State.STREAMING, 40)
    controller.deactivate()
    rig.until(lambda: rig.state is State.FAULT, 20, rig.send_legal)
    controller.activate()
    begin = len(controller.commands)
    rig.stream(0.5)
    assert rig.state is State.FAULT
    assert np.ptp([command for _, command in controller.commands[begin:]], axis=0).max() == 0.0
    rig.until(lambda: rig.trigger('reset').success)
    rig.stream_until(State.STREAMING, 40)


@both
def test_a_controller_that_is_gone_is_told_and_its_successor_not_moved_before_a_reset(robot):
    rig, controller = robot.rig, robot.controller()
    rig.up()
    rig.stream_until(State.STREAMING, 40)
    controller.close()
    rig.until(lambda: rig.state is State.FAULT, 20, rig.send_legal)
    assert 'gone' in rig.reason or 'no joint states' in rig.reason, rig.reason
    successor = robot.controller(POSTURE)
    rig.stream(0.5)
    assert np.ptp([command for _, command in successor.commands], axis=0).max() == 0.0
    rig.until(lambda: rig.trigger('reset').success, 30)
    rig.stream_until(State.STREAMING, 40)


def test_two_controllers_of_one_name_are_refused(robot):
    rig = robot.rig
    robot.controller()
    second = robot.controller(broadcast=False)
    assert rig.change(Transition.TRANSITION_CONFIGURE)
    assert not rig.change(ACTIVATE)
    robot.log_says('2 controllers are named /joint_trajectory_controller')
    second.close()
    rig.until(lambda: rig.change(ACTIVATE))


def test_a_second_commander_is_refused_and_later_a_fault(robot):
    rig = robot.rig
    robot.controller()
    topic = '/joint_trajectory_controller/joint_trajectory'
    other = rig.node.create_publisher(JointTrajectory, topic, 1)
    assert rig.change(Transition.TRANSITION_CONFIGURE)
    rig.until(lambda: rig.node.count_publishers(topic) == 2)
    assert not rig.change(ACTIVATE)
    robot.log_says('1 more node command')
    rig.node.destroy_publisher(other)
    rig.until(lambda: rig.change(ACTIVATE))
    rig.wait_for(State.READY)
    other = rig.node.create_publisher(JointTrajectory, topic, 1)
    rig.wait_for(State.FAULT)
    assert 'more node' in rig.reason


def test_a_controller_of_other_joints_is_refused_by_name(robot):
    robot.controller(name='broadcaster')
    robot.controller(joints=[*robot.names[:-1], 'trunk'], broadcast=False)
    assert robot.rig.change(Transition.TRANSITION_CONFIGURE)
    assert not robot.rig.change(ACTIVATE)
    robot.log_says('does not move right_ankle')


@both
def test_a_posture_that_comes_late_is_waited_for(robot):
    assert robot.rig.change(Transition.TRANSITION_CONFIGURE)
    starter = threading.Timer(1.0, robot.controller)
    starter.start()
    try:
        assert robot.rig.change(ACTIVATE)
    finally:
        starter.join()
    robot.rig.wait_for(State.READY)


def test_what_never_comes_is_told_at_the_end_of_the_wait(tmp_path):
    robot = Robot(tmp_path, 'topic', start_wait=0.5)
    try:
        assert robot.rig.change(Transition.TRANSITION_CONFIGURE)
        begin = time.monotonic()
        assert not robot.rig.change(ACTIVATE)
        assert time.monotonic() - begin > 0.5
        robot.log_says('no joint states for left_hip, left_knee')
        controller = robot.controller(name='another')
        controller.deactivate()
        robot.rig.spin(0.5)
        assert not robot.rig.change(ACTIVATE)
        robot.log_says('nobody listens to /joint_trajectory_controller')
        robot.controller(broadcast=False).deactivate()
        robot.rig.spin(0.5)
        robot.rig.until(lambda: not robot.rig.change(ACTIVATE) and 'is it active?' in robot.rig.log())
    finally:
        robot.close()


def test_the_launch_file_drives_the_controller_it_is_given_by_its_action(tmp_path):
    rig = ServoRig(str(tmp_path), chain=CHAIN, link='none')
    controller = ControllerNode(rig.context, rig.chain.names, POSTURE, name='arm')
    launch = subprocess.Popen(
        ['ros2', 'launch', os.path.join(ROOT, 'launch', 'servo.launch.py'), 'backend:=ros2_control', f'chain:={CHAIN}',
         'controller:=/arm', 'interface:=action'], start_new_session=True)
    try:
        rig.until(lambda: rig.state is State.READY and controller.received, 60)
        assert controller.controller.goal is not None       # only the action makes goals
    finally:
        os.killpg(launch.pid, signal.SIGINT)
        launch.wait(30)
        controller.close()
        rig.close()
