"""Joints of ros2_control: commands to joint_trajectory_controller, measurements from joint_states.

The controller keeps one message at a time. It samples it at the time of its own update, and a new one takes over at
the update after it has come. Before the first point of a message it moves there from where it is, and at the first
sample it is where it was: a message whose first point lies ahead costs an update without motion. So every message here
is a piece of one timeline that begins a little in the past: the commands of the last moments, those that come next if
nothing new is heard, and the way to a stand. Two messages differ only where something new was commanded in between, and
that is ``lead`` ahead, when the message has come. A bridge that dies leaves the controller with a stop it knows.

A message that comes after all it says is over is refused by the controller, which stands elsewhere by then; so none
says more than it has to.
"""
import math
import time

import numpy as np
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.errors import MotionError
from style_core.stream.stamp_policy import NANOSECONDS
from style_node.message_reading import reader_of
from style_node.templates import MessageTemplate
from style_servo.backend import BackendFault, Measurement

__all__ = ['Ros2ControlBackend']

AHEAD_S = 0.05          # of commands that a message holds beyond the next one: what the bridge may be late
LOOK_EVERY_S = 0.1      # for the controller
POLL_S = 0.005
STANDING_S = 0.001      # between points that fill a message up
STAND_ON_S = 1.0        # a message without motion may come so late
REFUSED = 5             # goals in a row, not one that was late on a busy machine
SMALLEST = 8            # points of a message
# a goal is replaced before its time where the commands have left it by so much (rad, rad/s)
LEFT, LEFT_RATE = 1e-4, 0.02
STEADY_S = 1e-4         # two clocks read further apart than this say nothing about each other


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
        Joint states and reports of the controller older than this are as good as none, s.
    error_run : int
        So many cycles in a row without fresh joint states are a fault.
    transport_time : float
        In which a message is with the controller, s.
    start_wait : float
        Wait this long for the first joint states and for the controller, s.
    clock : callable
        The monotonic clock of the commands.
    """

    def __init__(self, node, chain, period, controller, goal_rate, state_timeout, error_run, transport_time=0.005,
                 start_wait=3.0, clock=time.monotonic):
        self._node, self._names, self._period, self._clock = node, list(chain.names), period, clock
        self._controller, self._state_timeout, self._error_run = controller, state_timeout, error_run
        self._start_wait = start_wait
        # a command bends the way from one and a half periods before it on
        self.lead = 1.5 * period + transport_time
        self._index = {name: i for i, name in enumerate(self._names)}
        self.measurement = Measurement.unknown(len(self._names))
        self.statistics = {'cycles': 0, 'read errors': 0, 'goals sent': 0, 'goals refused': 0,
                           'unreadable joint states': 0, 'unreadable reports': 0}
        self.notes, self.facts, self.warnings = [], {}, []
        self._seen = np.full(len(self._names), -np.inf)
        self._run = 0
        self._problem, self._refused = None, 0
        self._waiting = True
        self._offset = None
        self._templates = {}
        self._topic = f'{controller}/joint_trajectory'
        self._states = reader_of(JointState, 'joint state', ('name', 'position', 'velocity', 'effort'))
        self._subscription = node.create_subscription(JointState, 'joint_states', self._on_state, QoSProfile(depth=5),
                                                      raw=True)
        self._report = reader_of(JointTrajectoryControllerState, "controller's report", ('joint_names',))
        self._reports = node.create_subscription(JointTrajectoryControllerState, f'{controller}/controller_state',
                                                 self._on_report, QoSProfile(depth=1), raw=True)
        self._reported, self._moves, self._looked = -math.inf, None, -math.inf
        self._ahead = AHEAD_S
        self._publisher = self._action = self._goal = self._sent = None
        if goal_rate is None:
            self._publisher = node.create_publisher(JointTrajectory, self._topic, 5)
        else:
            self._action = ActionClient(node, FollowJointTrajectory, f'{controller}/follow_joint_trajectory')
            self._every = max(1, round(1 / (goal_rate * period)))
            self._ahead += self._every * period
            self._left = 0          # cycles until the next goal
            self._latest = 0        # number of the newest goal
            # action clients belong to the executor's thread, cycles to another one
            self._goals_due = node.create_guard_condition(self._send_goal)

    # --- what comes back --------------------------------------------------------------------------------------------

    def _on_state(self, data):
        try:
            message = self._states.read(data)
        except MotionError:
            self.statistics['unreadable joint states'] += 1
            return
        now = self._clock()
        for k, name in enumerate(message.name):
            i = self._index.get(name)
            if i is None or k >= len(message.position):
                continue
            self.measurement.position[i] = message.position[k]
            self.measurement.velocity[i] = message.velocity[k] if k < len(message.velocity) else np.nan
            self.measurement.effort[i] = message.effort[k] if k < len(message.effort) else np.nan
            self._seen[i] = now

    def _on_report(self, raw):
        try:
            joints = self._report.read(raw).joint_names
        except MotionError:
            self.statistics['unreadable reports'] += 1
            return
        self._reported = self._clock()
        if self._moves is None:
            self._moves = joints

    def connect(self):
        """Nothing to open: whether somebody listens is checked when the bridge is activated."""
        self._problem = self._moves = self._sent = None
        self._run = self._refused = 0

    def observe(self):
        """Judge how fresh the joint states are; before the bridge is armed first, wait for them."""
        if self._waiting:
            self._wait(self._is_fresh, lambda: f'no joint states for {self._late()} within {self._start_wait:g} s: is '
                                               'the joint state broadcaster running?')
        self.measurement.fresh = self._is_fresh()
        self._run = 0 if self.measurement.fresh else self._run + 1

    def _is_fresh(self):
        return bool(np.all(self._clock() - self._seen < self._state_timeout)
                    and np.all(np.isfinite(self.measurement.position)))

    def _late(self):
        late = [name for name, seen in zip(self._names, self._seen) if self._clock() - seen >= self._state_timeout]
        return ', '.join(late[:5])

    def _wait(self, condition, reason):
        """Take messages ourselves, as the executor waits for us, until the condition holds; else a BackendFault."""
        end = self._clock() + self._start_wait
        while not condition():
            if self._clock() >= end:
                raise BackendFault(reason())
            for subscription in (self._subscription, self._reports):
                while (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is not None:
                    subscription.callback(taken[0])
            time.sleep(POLL_S)

    # --- the controller ---------------------------------------------------------------------------------------------

    def enable(self):
        """There is no torque to switch; check that the controller is there, alone, and moves these joints."""
        waited, self._waiting = self._waiting, False
        wait = self._start_wait
        if not waited:
            self._start_wait = 0.0      # a reset comes from another thread, which the executor does not wait for
        try:
            self._wait(lambda: not self._absent(), self._absent)
        except BackendFault:
            self._waiting = waited
            raise
        finally:
            self._start_wait = wait
        problem = self._conflict()
        if problem:
            self._waiting = waited
            raise BackendFault(problem)
        foreign = [name for name in self._names if self._moves and name not in self._moves]
        if foreign:
            raise BackendFault(f'{self._controller} does not move {", ".join(foreign[:5])}: its joints and those of '
                               'the chain file must agree')
        others = [name for name in self._moves or () if name not in self._index]
        if others:
            self._node.get_logger().warning(
                f'{self._controller} moves {", ".join(others[:5])} as well, which the chain file does not name: it '
                'takes the commands only where its allow_partial_joints_goal is true')
        self._sent, self._left = None, 0
        self.measurement.fresh = self._is_fresh()

    def _absent(self):
        """What is missing of the controller; '' where it is there and active."""
        if self._node.count_subscribers(self._topic) == 0:
            return f'nobody listens to {self._topic}: is the controller there?'
        if self._action is not None and not self._action.server_is_ready():
            return f'no action server {self._controller}/follow_joint_trajectory: is the controller there?'
        if self._silent():
            return f'{self._controller} does not report its state: is it active?'
        return ''

    def _silent(self):
        """Whether a controller that could report does not: one that is not active does not run."""
        return (self._clock() - self._reported > self._state_timeout
                and self._node.count_publishers(f'{self._controller}/controller_state') > 0)

    def _conflict(self):
        """Who else commands the joints, or would hear the commands; '' for nobody."""
        base = self._controller.rsplit('/', 1)[-1]
        same = sum(info.node_name == base for info in self._node.get_subscriptions_info_by_topic(self._topic))
        if same > 1:
            return f'{same} controllers are named {self._controller}: stop all but one'
        others = self._node.count_publishers(self._topic) - (self._publisher is not None)
        if others > 0:
            return f'{others} more {"nodes command" if others > 1 else "node commands"} {self._topic}: stop them'
        return ''

    def _look(self):
        """Now and then: is the controller still there, and nobody else?"""
        now = self._clock()
        if now - self._looked < LOOK_EVERY_S:
            return
        self._looked = now
        absent = self._absent()
        if absent:
            # whoever comes back holds elsewhere: nothing may be sent to it before the posture is taken anew
            raise BackendFault(f'the controller is gone: {absent}', connection_lost=True)
        conflict = self._conflict()
        if conflict:
            raise BackendFault(conflict, connection_lost=True)

    # --- commands ---------------------------------------------------------------------------------------------------

    def exchange(self, position, velocity, coming):
        """Send the plan that follows from the command; see Backend.exchange."""
        if self._problem:
            problem, self._problem = self._problem, None
            # the controller holds by itself, or obeys somebody else: what is sent now would move it by a jump
            raise BackendFault(problem, connection_lost=True)
        self._look()
        if self._publisher is not None:
            self._publisher.publish(self._message(*coming.plan(self._ahead)))
            self.statistics['goals sent'] += 1
        else:
            self._left -= 1
            if self._left <= 0 or self._has_left(position, velocity, coming.time):
                self._sent = coming.plan(self._ahead)
                self._goal = self._message(*self._sent)
                self._left = self._every
                self._goals_due.trigger()
                self.statistics['goals sent'] += 1
        self.statistics['cycles'] += 1
        self.observe()
        if not self.measurement.fresh:
            self.statistics['read errors'] += 1
            if self._run >= self._error_run:
                raise BackendFault(f'no joint states for {self._late()} for {self._state_timeout:g} s and {self._run} '
                                   'cycles: is the joint state broadcaster running?')

    def _message(self, times, positions, velocities):
        """A serialised JointTrajectory of points that end at rest."""
        if not velocities.any():
            times = np.append(times[:-1], times[-1] + STAND_ON_S)
        count = SMALLEST
        while count < len(times):
            count *= 2
        more = count - len(times)
        if more:
            times = np.concatenate([times, times[-1] + STANDING_S * np.arange(1, more + 1)])
            positions = np.vstack([positions, np.tile(positions[-1], (more, 1))])
            velocities = np.vstack([velocities, np.zeros((more, positions.shape[1]))])
        if count not in self._templates:
            zero = [0.0] * len(self._names)
            self._templates[count] = MessageTemplate(JointTrajectory(joint_names=self._names, points=[
                JointTrajectoryPoint(positions=zero, velocities=zero, time_from_start=Duration())
                for _ in range(count)]))
        start = np.rint((times - times[0]) * NANOSECONDS).astype(np.int64)
        return self._templates[count].write({
            'points.positions': positions, 'points.velocities': velocities,
            'points.time_from_start.sec': start // NANOSECONDS,
            'points.time_from_start.nanosec': start % NANOSECONDS}, self._stamp(times[0]))

    def _stamp(self, moment):
        """The node's time, ns, at a moment of the monotonic clock."""
        before = self._clock()
        offset = self._node.get_clock().now().nanoseconds - round(before * NANOSECONDS)
        # where this thread lost the processor between both clocks, what was known holds
        if self._offset is None or self._clock() - before < STEADY_S:
            self._offset = offset
        return self._offset + round(moment * NANOSECONDS)

    def _has_left(self, position, velocity, moment):
        """Whether a command, half a period before its ``moment``, lies beside the goal that the controller has."""
        times, positions, velocities = self._sent
        moment -= 0.5 * self._period
        k = int(np.clip(np.searchsorted(times, moment, side='right') - 1, 0, len(times) - 2))
        span = times[k + 1] - times[k]
        x = min(max((moment - times[k]) / span, 0.0), 1.0)
        rate = velocities[k] + x * (velocities[k + 1] - velocities[k])      # every segment is a parabola
        there = positions[k] + 0.5 * x * span * (velocities[k] + rate)
        return bool(np.any(np.abs(there - position + 0.5 * self._period * velocity) > LEFT)
                    or np.any(np.abs(rate - velocity) > LEFT_RATE))

    def _send_goal(self):
        goal, self._goal = self._goal, None
        if goal is None or self._action is None:
            return
        self._latest += 1
        number = self._latest
        self._action.send_goal_async(
            FollowJointTrajectory.Goal(trajectory=deserialize_message(goal, JointTrajectory))
        ).add_done_callback(lambda future: self._on_answer(number, future))

    def _on_answer(self, number, future):
        handle = future.result()
        if not handle.accepted:
            self.statistics['goals refused'] += 1
            self._refused += 1
            if self._refused < REFUSED:
                return
            self._problem = (f'{self._controller} refuses goals: is it active, are its joints those of the chain file, '
                             'and do both clocks agree?')
            return
        self._refused = 0
        handle.get_result_async().add_done_callback(lambda future: self._on_result(number, future))

    def _on_result(self, number, future):
        status, result = future.result().status, future.result().result
        if status == GoalStatus.STATUS_ABORTED:
            self._problem = f'{self._controller} reports error {result.error_code}: {result.error_string}'
        elif status == GoalStatus.STATUS_CANCELED and number == self._latest:
            # the goal before the newest one ends like this whenever a newer one replaces it
            self._problem = f'a goal of {self._controller} was cancelled or replaced by somebody else'

    def disable(self):
        """ros2_control keeps its own power; the controller holds after the last stop."""
        return True

    def close(self):
        """Take publishers and subscriptions down."""
        if self._subscription is None:
            return
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_subscription(self._reports)
        self._subscription = None
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        if self._action is not None:
            self._node.destroy_guard_condition(self._goals_due)
            self._action.destroy()
            self._action = None
