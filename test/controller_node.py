"""The controller of controller_stand_in.py as a node: topic, action, state, joint states; joints do what it commands.

The action's server answers as the controller's does: goals are taken at once, each replaces the one before, and of that
one only the status is told.
"""
import contextlib
import threading

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from controller_stand_in import SECOND, JointTrajectoryController, Parameters, message_of
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import GoalEvent
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

__all__ = ['ControllerNode']


class ControllerNode:
    """One controller with a joint state broadcaster, in a thread of its own.

    Parameters
    ----------
    context : rclpy.Context
    joints : sequence of str
    position : array_like
    rate : float
        Updates a second.
    name : str
    parameters : of the controller
    """

    def __init__(self, context, joints, position, rate=100.0, name='joint_trajectory_controller', broadcast=True,
                 **parameters):
        self.controller = JointTrajectoryController(Parameters(list(joints), **parameters))
        self.position = np.array(position, dtype=float)
        self.stuck = np.zeros(len(self.position), dtype=bool)
        self.received, self.commands, self.silent = [], [], False
        self._goals = {}
        node = self.node = rclpy.create_node(name, context=context)
        self._states = node.create_publisher(JointState, '/joint_states', 10) if broadcast else None
        self._reports = node.create_publisher(JointTrajectoryControllerState, '~/controller_state', 10)
        node.create_subscription(JointTrajectory, '~/joint_trajectory', self._on_message, 10)
        self._server = ActionServer(
            node, FollowJointTrajectory, '~/follow_joint_trajectory', self._execute, goal_callback=self._judge,
            handle_accepted_callback=self._accept, cancel_callback=self._cancel,
            callback_group=ReentrantCallbackGroup())
        self._timer = node.create_timer(1.0 / rate, self._update)
        self._every, self._turn = max(1, round(rate / 50.0)), 0
        self.activate()
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        with contextlib.suppress(ExternalShutdownException, rclpy.executors.ShutdownException):
            self._executor.spin()

    def close(self):
        """The controller's process ends; a second call does nothing."""
        if self._thread is None:
            return
        self._executor.shutdown()
        self._thread.join()
        self._thread = None
        self._server.destroy()
        self.node.destroy_node()

    def activate(self):
        """Begin to run."""
        self.controller.activate(self.position)

    def deactivate(self):
        """Stop running; the node stays."""
        self.controller.deactivate()

    def _now(self):
        return self.node.get_clock().now().nanoseconds

    def _on_message(self, message):
        self.received.append(message)
        self.controller.on_message(message_of(message), self._now())

    def _judge(self, request):
        # the controller judges and takes in one go here: nothing comes between
        self.received.append(request.trajectory)
        goal = self.controller.on_goal(message_of(request.trajectory), self._now())
        if goal is None:
            return GoalResponse.REJECT
        self._taken = goal
        return GoalResponse.ACCEPT

    def _accept(self, handle):
        self._goals[self._taken] = handle, Future()
        handle.execute()

    async def _execute(self, handle):
        future = next(future for one, future in self._goals.values() if one is handle)
        goal = await future
        if goal.status == 'canceled':
            if not handle.is_cancel_requested:
                handle._update_state(GoalEvent.CANCEL_GOAL)
            handle.canceled()
            return FollowJointTrajectory.Result()
        (handle.succeed if goal.status == 'succeeded' else handle.abort)()
        return FollowJointTrajectory.Result(error_code=goal.error, error_string=goal.text)

    def _cancel(self, handle):
        goal = next(goal for goal, (one, _) in self._goals.items() if one.goal_id == handle.goal_id)
        self.controller.on_cancel(goal)
        return CancelResponse.ACCEPT

    def _update(self):
        now, controller = self._now(), self.controller
        command = controller.update(now, self.position)
        if controller.active and np.all(np.isfinite(command)):
            self.position = np.where(self.stuck, self.position, command)
            self.commands.append((now / SECOND, self.position.copy()))
        for goal, (_, future) in list(self._goals.items()):
            if future.done():
                del self._goals[goal]
            elif goal.status != 'executing':
                future.set_result(goal)
        self._turn += 1
        names = list(controller.parameters.joints)
        if self._states is not None and not self.silent:
            self._states.publish(JointState(name=names[::-1], position=self.position[::-1].tolist()))
        if controller.active and self._turn % self._every == 0:
            report = JointTrajectoryControllerState(joint_names=names)
            report.header.stamp = Time(sec=now // SECOND, nanosec=now % SECOND)
            report.reference.positions = controller.command.tolist()
            report.feedback.positions = self.position.tolist()
            self._reports.publish(report)
