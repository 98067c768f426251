"""The bridge, its ros2_control back end and a controller in lock step, on simulated time: no middleware, no clock.

The bridge ticks at its rate, messages travel for a while, the controller updates at its own rate, and the joints do
exactly what it commands. What the controller commanded is kept, to be judged against the motion that was sent.
"""
import heapq
from contextlib import suppress
from types import SimpleNamespace
from unittest import mock

import numpy as np
from action_msgs.msg import GoalStatus
from controller_stand_in import SECOND, JointTrajectoryController, Message, Parameters, Point, message_of
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from style_core.errors import MotionError
from style_core.follow.limiter import Limiter
from style_servo import ros2_control_backend
from style_servo.bridge import Bridge, BridgeSettings, Points
from style_servo.chain import Chain, Joint
from style_servo.trajectory_message import TrajectoryReader

__all__ = ['LockStep', 'Motion', 'chain_of', 'judge']

EPOCH = 1_000 * SECOND      # a zero stamp means something else
STATUS = {'succeeded': GoalStatus.STATUS_SUCCEEDED, 'canceled': GoalStatus.STATUS_CANCELED,
          'aborted': GoalStatus.STATUS_ABORTED}


class Motion:
    """A random motion that uses a share of all limits: positions and velocities at any time from 0, by cubics.

    Parameters
    ----------
    chain : Chain
    seconds : float
    seed : int
    share : float
        Of the velocity and acceleration limits.
    period : float
        Of its own grid, s.
    """

    def __init__(self, chain, seconds, seed, share=0.9, period=0.02):
        rng = np.random.default_rng(seed)
        lower, upper = chain.array('lower'), chain.array('upper')
        limiter = Limiter(lower, upper, share * chain.array('velocity'), share * chain.array('acceleration'),
                          np.full(len(lower), 100.0), period)
        limiter.reset((lower + upper) / 2)
        target, still = (lower + upper) / 2, np.zeros(len(lower))
        commands = [limiter.position.copy()] * 3
        for _ in range(int(seconds / period) + 3):
            changes = rng.random(len(lower)) < 0.06
            target = np.where(changes, rng.uniform(lower, upper), target)
            commands.append(limiter.step(target, still).copy())
        steps = np.diff(commands, axis=0)
        self._period = period
        # through the middles of the steps its acceleration is constant and within the limit
        self._positions, self._velocities = np.array(commands[:-1]) + 0.5 * steps, steps / period

    def at(self, times):
        """Positions and velocities, (N, D) each, at times (N,), s."""
        times = np.clip(np.asarray(times, dtype=float), 0.0, self._period * (len(self._positions) - 2))
        k = np.minimum((times / self._period).astype(int), len(self._positions) - 2)
        into = (times - k * self._period)[:, None]
        bend = (self._velocities[k + 1] - self._velocities[k]) / self._period
        return (self._positions[k] + into * (self._velocities[k] + 0.5 * into * bend),
                self._velocities[k] + into * bend)


def chain_of(joints=4, velocity=4.0, acceleration=40.0):
    """A chain without servos."""
    return Chain(tuple(Joint(f'joint_{k}', -1.5, 1.5, velocity, acceleration, 0.25, 0.25) for k in range(joints)))


class _Node:
    """What the back end asks of a node."""

    def __init__(self, step):
        self._step = step

    def create_subscription(self, *args, **kwargs):
        return SimpleNamespace(handle=SimpleNamespace(take_message=lambda kind, raw: None), msg_type=args[0],
                               raw=False, callback=args[2])

    def create_publisher(self, *args):
        return SimpleNamespace(publish=self._step.sent)

    def create_guard_condition(self, callback):
        return SimpleNamespace(trigger=callback)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self._step.now))

    def count_subscribers(self, topic):
        return 1

    def count_publishers(self, topic):
        return int(topic.endswith('joint_trajectory') and self._step.goal_rate is None)

    def get_subscriptions_info_by_topic(self, topic):
        return []


class _Future:
    def __init__(self, value=None):
        self._value, self._calls = value, []

    def result(self):
        return self._value

    def add_done_callback(self, call):
        self._calls.append(call)
        if self._value is not None:
            call(self)

    def set(self, value):
        self._value = value
        for call in self._calls:
            call(self)


class LockStep:
    """Run a motion through bridge and controller.

    Parameters
    ----------
    chain : Chain
    bridge_hz, controller_hz : float
    goal_rate : float or None
        None for the topic.
    transport : callable
        Time that a message, goal or answer travels, s, one value a call.
    lateness : callable
        Time that a tick of the bridge is late, s.
    settings : of the bridge
    controller : of the controller, besides its joints
    backend : class of the back end
    """

    def __init__(self, chain, bridge_hz, controller_hz, goal_rate=None, transport=lambda: 0.001, lateness=lambda: 0.0,
                 settings=None, controller=None, backend=ros2_control_backend.Ros2ControlBackend):
        self.chain, self.goal_rate = chain, goal_rate
        self.now = EPOCH
        self._transport, self._lateness = transport, lateness
        self._bridge_hz, self._controller_hz = bridge_hz, controller_hz
        self._events, self._count = [], 0
        self._reader = TrajectoryReader()
        self.controller = JointTrajectoryController(Parameters(list(chain.names), **(controller or {})))
        with mock.patch.object(ros2_control_backend, 'ActionClient', self._client):
            self.backend = backend(
                _Node(self), chain, 1.0 / bridge_hz, '/controller', goal_rate, 0.2, 10, start_wait=0.0,
                clock=lambda: self.seconds)
        self.bridge = Bridge(chain, self.backend, BridgeSettings(rate=bridge_hz, **(settings or {})))
        self.position = (chain.array('lower') + chain.array('upper')) / 2
        self.controller.activate(self.position)
        self.times, self.commands, self.reasons, self.goals = [], [], [], 0

    def _client(self, node, kind, name):
        return SimpleNamespace(server_is_ready=lambda: True, send_goal_async=self._send_goal)

    def at(self, when, call):
        """Have something happen at a time, ns."""
        self._count += 1
        heapq.heappush(self._events, (when, self._count, call))

    def _later(self, call):
        self.at(self.now + round(self._transport() * SECOND), call)

    def sent(self, raw):
        """A message of the bridge's topic."""
        # rclpy takes longer to read it than everything else here together; both read the same (test_trajectory_message)
        stamp, points = self._reader.read(raw)
        message = Message(stamp, list(points.joint_names), [
            Point(round(time * SECOND), position, velocity) for time, position, velocity in zip(
                points.times, points.positions, points.velocities)])
        self._later(lambda: self.controller.on_message(message, self.now))

    def _send_goal(self, goal):
        answer, result, message = _Future(), _Future(), message_of(goal.trajectory)
        self.goals += 1

        def arrive():
            taken = self.controller.on_goal(message, self.now)
            if taken is not None:
                self._running.append((taken, result))
            self._later(lambda: answer.set(SimpleNamespace(accepted=taken is not None,
                                                           get_result_async=lambda: result)))
        self._later(arrive)
        return answer

    _running = ()

    @property
    def seconds(self):
        """The time now, s."""
        return (self.now - EPOCH) / SECOND

    def run(self, seconds, motion=None, window_hz=60.0, straight=False, first=0.0, during=None):
        """Stream a motion's windows for a while.

        Parameters
        ----------
        seconds : float
        motion : Motion, optional
        window_hz : float
            Windows a second; each 0.4 s long with a point every 1 / 60 s.
        straight : bool
            To the controller, without the bridge.
        first : float
            Time of a window's first point, s.
        during : dict of float to callable, optional
            What else happens, and when, s.
        """
        self._running, self._busy = [], self.now
        end = self.now + round(seconds * SECOND)
        for when, call in (during or {}).items():
            self.at(self.now + round(when * SECOND), call)
        if not straight:
            self._measure()
            self.bridge.arm(self.seconds)
            self._every(self._bridge_hz, self._tick, end)
        if motion is not None:
            ahead = first + np.arange(25) / 60.0
            self._every(window_hz, lambda: self._window(motion, ahead, straight), end)
        self._every(self._controller_hz, self._update, end)
        while self._events and self._events[0][0] < end:
            self.now, _, call = heapq.heappop(self._events)
            call()
        self.now = end
        return self

    def _every(self, rate, call, end, k=0):
        begin = self.now

        def turn(k):
            call()
            if begin + round((k + 1) / rate * SECOND) < end:
                self.at(begin + round((k + 1) / rate * SECOND), lambda: turn(k + 1))
        self.at(begin, lambda: turn(0))

    def _tick(self):
        def tick():
            self.bridge.tick(self.seconds)
            if self.bridge.reason and (not self.reasons or self.reasons[-1] != self.bridge.reason):
                self.reasons.append(self.bridge.reason)
        # a late tick makes those after it wait
        self._busy = max(self._busy, self.now + round(self._lateness() * SECOND))
        self.at(self._busy, tick)

    def _window(self, motion, ahead, straight):
        now = self.seconds
        positions, velocities = motion.at(now + ahead)
        stamp = self.now

        def arrive():
            if straight:
                self.controller.on_message(Message(stamp, list(self.chain.names), [
                    Point(round(t * SECOND), p, v) for t, p, v in zip(ahead, positions, velocities)]), self.now)
            else:
                with suppress(MotionError):     # the bridge counts it
                    self.bridge.submit(Points(self.chain.names, ahead, positions, velocities), now,
                                       self.seconds, stamp / SECOND)
        self._later(arrive)

    def _update(self):
        command = self.controller.update(self.now, self.position)
        if np.all(np.isfinite(command)):
            self.position = command.copy()      # perfect hardware
        self._measure()
        self.times.append(self.seconds)
        self.commands.append(self.position)
        for pair in [pair for pair in self._running if pair[0].status != 'executing']:
            self._running.remove(pair)
            self._tell(*pair)

    def _measure(self):
        self.backend._on_state(serialize_message(JointState(name=list(self.chain.names), position=self.position)))

    def _tell(self, goal, result):
        # the controller drops the reason of a goal that a newer one replaces
        error = 0 if goal.status == 'canceled' else goal.error
        self._later(lambda: result.set(SimpleNamespace(status=STATUS[goal.status], result=SimpleNamespace(
            error_code=error, error_string=goal.text))))


def judge(step, motion, begin, end=np.inf):
    """What the controller commanded against the motion, from ``begin`` to ``end`` (s).

    Returns
    -------
    dict
        ``still``: share of updates of a joint without motion though it should move faster than 0.1 rad/s;
        ``error``, ``rms``: rad; ``speed``, ``acceleration``: largest step and change of step as a share of the limits.
    """
    times, commands = np.array(step.times), np.array(step.commands)
    chosen = (times >= begin) & (times < end)
    times, commands = times[chosen], commands[chosen]
    period = times[1] - times[0]
    positions, velocities = motion.at(times)
    steps = np.diff(commands, axis=0)
    moving = np.minimum(np.abs(velocities[1:]), np.abs(velocities[:-1])) > 0.1
    error = np.abs(commands - positions)
    return {'still': float(np.mean(np.abs(steps[moving]) < 1e-9)), 'error': float(error.max()),
            'rms': float(np.sqrt(np.mean(error**2))),
            'speed': float(np.max(np.abs(steps) / period / step.chain.array('velocity'))),
            'acceleration': float(np.max(np.abs(np.diff(steps, axis=0)) / period**2
                                         / step.chain.array('acceleration')))}
