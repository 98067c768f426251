"""Joints of ros2_control: commands to joint_trajectory_controller, measurements from joint_states.

Every message says: be here at the end of this period, then brake to a stand there. A bridge that dies leaves the
controller with a stop it already knows.
"""
import array
import time

import numpy as np
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_servo.backend import BackendFault, Measurement

__all__ = ['Ros2ControlBackend']


class Ros2ControlBackend:
    """Drive a joint_trajectory_controller by its topic or its action.

    Parameters
    ----------
    node : rclpy.node.Node
    chain : Chain
    period : float
        Of the commands, s.
    controller : str
        Name of the controller; its topic is ``<controller>/joint_trajectory``.
    goal_rate : float or None
        Goals a second for the action ``<controller>/follow_joint_trajectory``; None for the topic.
    state_timeout : float
        Joint states older than this are as good as none, s.
    error_run : int
        So many cycles in a row without fresh joint states are a fault.
    """

    def __init__(self, node, chain, period, controller, goal_rate, state_timeout, error_run):
        self._node, self._names, self._period = node, list(chain.names), period
        self._controller, self._state_timeout, self._error_run = controller, state_timeout, error_run
        self._index = {name: i for i, name in enumerate(self._names)}
        self.measurement = Measurement.unknown(len(self._names))
        self.statistics = {'cycles': 0, 'read errors': 0, 'goals sent': 0, 'goals refused': 0}
        self.notes, self.facts, self.warnings = [], {}, []
        self._seen = np.full(len(self._names), -np.inf)
        self._run = 0
        self._problem = None
        self._subscription = node.create_subscription(JointState, 'joint_states', self._on_state, QoSProfile(depth=5))
        self._every = 1
        self._publisher = self._action = self._goal = None
        if goal_rate is None:
            self._publisher = node.create_publisher(JointTrajectory, f'{controller}/joint_trajectory', 5)
        else:
            self._action = ActionClient(node, FollowJointTrajectory, f'{controller}/follow_joint_trajectory')
            self._every = max(1, round(1 / (goal_rate * period)))
            # action clients belong to the executor's thread, cycles to another one
            self._goals_due = node.create_guard_condition(self._send_goal)

    def _on_state(self, message):
        now = time.monotonic()
        for k, name in enumerate(message.name):
            i = self._index.get(name)
            if i is None or k >= len(message.position):
                continue
            self.measurement.position[i] = message.position[k]
            self.measurement.velocity[i] = message.velocity[k] if k < len(message.velocity) else np.nan
            self.measurement.effort[i] = message.effort[k] if k < len(message.effort) else np.nan
            self._seen[i] = now

    def connect(self):
        """Nothing to open: whether somebody listens is checked when the bridge is activated."""
        self._problem = None
        self._run = 0

    def observe(self):
        """Judge how fresh the joint states are."""
        self.measurement.fresh = bool(np.all(time.monotonic() - self._seen < self._state_timeout)
                                      and np.all(np.isfinite(self.measurement.position)))
        self._run = 0 if self.measurement.fresh else self._run + 1

    def enable(self):
        """There is no torque to switch; check that the controller is there."""
        if self._publisher is not None and self._publisher.get_subscription_count() == 0:
            raise BackendFault(f'nobody listens to {self._controller}/joint_trajectory: is the controller active?')
        if self._action is not None and not self._action.server_is_ready():
            raise BackendFault(f'no action server {self._controller}/follow_joint_trajectory: is the controller '
                               'active?')
        self.observe()

    def exchange(self, position, velocity, stop):
        """Send the command and the stop after it; see Backend.exchange."""
        if self._problem:
            problem, self._problem = self._problem, None
            raise BackendFault(problem)
        if self.statistics['cycles'] % self._every == 0:
            self._send(position, velocity, stop)
        self.statistics['cycles'] += 1
        self.observe()
        if not self.measurement.fresh:
            self.statistics['read errors'] += 1
            if self._run >= self._error_run:
                late = [name for name, seen in zip(self._names, self._seen)
                        if time.monotonic() - seen >= self._state_timeout]
                raise BackendFault(f'no joint states for {", ".join(late[:5])} for {self._state_timeout:g} s and '
                                   f'{self._run} cycles: is the joint state broadcaster running?')

    def _send(self, position, velocity, stop):
        arrive = self._period * self._every
        points = [_point(arrive, position, velocity)]
        if np.any(velocity):
            rest, duration = stop()
            points.append(_point(arrive + duration, rest, np.zeros_like(rest)))
        trajectory = JointTrajectory(joint_names=self._names, points=points)
        self.statistics['goals sent'] += 1
        if self._publisher is not None:
            self._publisher.publish(trajectory)
        else:
            self._goal = FollowJointTrajectory.Goal(trajectory=trajectory)
            self._goals_due.trigger()

    def _send_goal(self):
        goal, self._goal = self._goal, None
        if goal is not None and self._action is not None:
            self._action.send_goal_async(goal).add_done_callback(self._on_answer)

    def _on_answer(self, future):
        handle = future.result()
        if not handle.accepted:
            self.statistics['goals refused'] += 1
            self._problem = (f'{self._controller} refuses goals: is it active, and are its joints those of the chain '
                             'file?')
            return
        handle.get_result_async().add_done_callback(self._on_result)

    def _on_result(self, future):
        result = future.result().result
        # a goal that its successor replaced ends with the same status as a failed one, but without an error code
        if result.error_code != FollowJointTrajectory.Result.SUCCESSFUL:
            self._problem = f'{self._controller} reports error {result.error_code}: {result.error_string}'

    def disable(self):
        """ros2_control keeps its own power; the controller holds after the last stop."""
        return True

    def close(self):
        """Take publishers and subscriptions down."""
        if self._subscription is None:
            return
        self._node.destroy_subscription(self._subscription)
        self._subscription = None
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        if self._action is not None:
            self._node.destroy_guard_condition(self._goals_due)
            self._action.destroy()
            self._action = None


def _point(seconds, position, velocity):
    nanoseconds = round(seconds * 1e9)
    return JointTrajectoryPoint(
        positions=array.array('d', position.tobytes()), velocities=array.array('d', velocity.tobytes()),
        time_from_start=Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9))
