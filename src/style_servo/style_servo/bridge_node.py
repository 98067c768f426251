"""Joint trajectories in, limited servo commands out: the servo bridge as a lifecycle node."""
import array
import gc
import getpass
import math
import os
import sys
import time
import traceback
from collections import deque
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from style_core.errors import MotionError, UsageError
from style_core.follow.limiter import PASS
from style_core.places import find_file
from style_core.stream.health import WARN, Health
from style_core.stream.stamp_policy import NANOSECONDS
from style_msgs.msg import BridgeState
from style_node.diagnostics import diagnostics_message
from style_node.executor import run
from style_node.lifecycle import SoundLifecycleNode, transition
from style_node.qos import overrides
from style_node.ros_parameters import declare, values_of, watch
from style_node.templates import MessageTemplate
from style_servo.backend import BackendFault
from style_servo.backends import BACKENDS
from style_servo.bridge import Bridge
from style_servo.bridge_health import CycleTimes, health_of_bridge, with_the_rest
from style_servo.chain import load_chain
from style_servo.emergency_stop import EmergencyStop
from style_servo.estop_topics import EstopTopics
from style_servo.loop import ServoLoop
from style_servo.parameters import BRIDGE, bridge_settings
from style_servo.recorder import Recorder, record_path
from style_servo.states import State
from style_servo.trajectory_message import TrajectoryReader

__all__ = ['BridgeNode', 'main']

STATE_EVERY_S = 0.1
REPORT_EVERY_S = 1.0
DEAF_S = 2.0        # the executor's thread hears the emergency stop: without a sign of it for so long, the bridge stops
SWITCH_S = 0.0001       # a thread that computes lets the other one in after this long


def _floats(values):
    """What rclpy takes for float64[] without looking at every number."""
    return array.array('d', values.tobytes())


class BridgeNode(SoundLifecycleNode):
    """See ``docs/servo.md`` for topics, services, parameters and the state diagram.

    While active, a ServoLoop runs the bridge and publishes commands and measurements. The executor's thread takes
    messages apart, hands them over, and reports; of the bridge it only reads numbers. The emergency stop is heard from
    the node's first moment to its last, whatever state of its life cycle it is in.

    Attributes
    ----------
    finished : bool
        The program that started this one has ended, and the parameter ``stop_with_parent`` says to end then.
    """

    def __init__(self, **options):
        super().__init__('servo_bridge', **options)
        self._bridge = self._loop = self._recorder = None
        self._made = []     # what configuring made: how to destroy it, and it
        self._mishaps, self._last_mishap = 0, ''
        self._executor_waits, self._listened_at = False, -math.inf
        declare(self, BRIDGE)
        watch(self, BRIDGE, lambda: self._bridge is not None, lambda values: None)
        values = values_of(self, BRIDGE)
        self._parent = os.getppid() if values['stop_with_parent'] else None
        self._stop = EmergencyStop(values['estop_topics'], values['estop_required'], values['estop_heartbeat'])
        if self._stop.required and not self._stop.buttons:
            raise UsageError('an emergency stop is required, but estop_topics names none')
        try:
            self._buttons = EstopTopics(self, self._stop, self._on_pressed)
        except (InvalidTopicNameException, RuntimeError, ValueError) as error:
            raise UsageError(f'estop_topics: {error}') from None

    @property
    def finished(self):
        """See the class."""
        if self._parent in (None, os.getppid()):
            return False
        self.get_logger().error('the program that started this bridge has ended: braking, then torque off')
        return True

    def mishap(self, error):
        """Count and report what a callback raised: it is no reason to let go of a robot."""
        if not self.context.ok():
            return      # nothing can be made while the program is being ended
        self._mishaps += 1
        self._last_mishap = repr(error)[:200]
        text = ''.join(traceback.format_exception(type(error), error, error.__traceback__))
        self.get_logger().error(text, throttle_duration_sec=1.0)

    # --- lifecycle ----------------------------------------------------------------------------------------------

    @transition
    def on_configure(self, state):
        """Read the chain file, open and check the motors (torque stays off), make the interfaces."""
        self._values = values = values_of(self, BRIDGE)
        chain = load_chain(self._chain_path(values['chain']))
        path = record_path(values['record_folder'], values['record']) if values['record'] else None
        self._period = period = 1.0 / values['rate']
        backend = BACKENDS[values['backend']](self, chain, values, period)
        try:
            self._bring_up(chain, backend, path)
        except BaseException:
            backend.close()
            self._tear_down()
            raise
        self.get_logger().info(f'{chain.name}: {len(chain.joints)} joints on {values["backend"]}, '
                               f'{values["rate"]:g} commands a second, torque off')
        return TransitionCallbackReturn.SUCCESS

    def _bring_up(self, chain, backend, path):
        values, period = self._values, self._period
        bridge = Bridge(chain, backend, bridge_settings(values))
        bridge.pressed = self._pressed
        try:
            backend.connect()
        except BackendFault as error:
            raise UsageError(str(error)) from None
        for note in backend.notes:
            self.get_logger().warning(note)
        self._times, self._reader = CycleTimes(period), TrajectoryReader()
        self._taken = self._flood = 0
        self._told, self._changes = None, deque()
        self._problem_told = False
        self._make_interfaces(chain)
        self._take_priority(values['realtime_priority'])
        self._lead = round(getattr(backend, 'lead', 0.0) * NANOSECONDS)     # a command's time is so far from now
        if path is not None:
            self._recorder = Recorder(path, chain, period, 1e6 * values['record_size'], values['record_files'])
            bridge.trace = self._recorder.write
        self._bridge = bridge

    def _take_priority(self, priority):
        # the servo thread inherits it; this one needs it too, as each may have to wait for the other's Python
        if not priority:
            return
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except PermissionError:
            self.get_logger().warning(
                f'real-time priority {priority} is not permitted: put "{getpass.getuser()} - rtprio {priority}" into '
                '/etc/security/limits.d/realtime.conf and log in again')

    def _chain_path(self, path):
        if not path:
            raise UsageError('the parameter chain is empty: give a chain file (config/servo/ has examples)')
        return find_file(path, 'chain')

    def _make_interfaces(self, chain):
        self._names = list(chain.names)
        zero = [0.0] * len(self._names)
        self._command_message = MessageTemplate(JointState(name=self._names, position=zero, velocity=zero))
        self._measured_message = MessageTemplate(JointState(name=self._names, position=zero, velocity=zero,
                                                            effort=zero))
        def made(destroy, one):
            self._made.append((destroy, one))
            return one
        publisher = partial(made, self.destroy_lifecycle_publisher)
        self._commanded = publisher(self.create_lifecycle_publisher(JointState, '~/command', 50))
        # with ros2_control the joint state broadcaster publishes these
        self._joint_states = None
        if self._values['backend'] == 'dynamixel':
            self._joint_states = publisher(self.create_lifecycle_publisher(JointState, 'joint_states', 10))
        self._state = publisher(self.create_lifecycle_publisher(
            BridgeState, '~/state', QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)))
        self._diagnostics = made(self.destroy_publisher, self.create_publisher(DiagnosticArray, '/diagnostics', 10))
        self._trajectories = made(self.destroy_subscription, self.create_subscription(
            JointTrajectory, 'joint_trajectory', self._on_trajectory, 8, raw=True,
            qos_overriding_options=overrides()))
        for name, answer in (('estop', self._on_estop), ('reset', self._on_reset),
                             ('release_estop', self._on_release)):
            made(self.destroy_service, self.create_service(Trigger, f'~/{name}', partial(self._answer, answer)))
        # the steady clock: a motor bus must not follow a simulated or corrected time
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for every, call in ((STATE_EVERY_S, self._publish_state), (REPORT_EVERY_S, self._report)):
            made(self.destroy_timer, self.create_timer(every, call, clock=steady))
        self._news = made(self.destroy_guard_condition, self.create_guard_condition(self._on_news))

    @transition
    def on_activate(self, state):
        """Torque on at the measured posture."""
        gc.collect()
        gc.freeze()     # what is there now stays; the collector need not look at it again
        self._buttons.settle()
        bridge = self._bridge
        try:
            bridge.arm(time.monotonic())
        except BackendFault as error:
            raise UsageError(str(error)) from None
        try:
            result = super().on_activate(state)
            self._times = CycleTimes(self._period)
            self._note_state()
            self._listened_at = time.monotonic()
            self._refuse_what_waits()
            self._loop = ServoLoop(self._cycle, bridge.ticked, self._period, self._news.trigger)
        except BaseException:
            bridge.disarm(time.monotonic())
            raise
        return result

    @transition
    def on_deactivate(self, state):
        """Brake, then torque off."""
        self._disarm()
        self._publish_changes()
        return super().on_deactivate(state)

    def _disarm(self):
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.stop()
            self._bridge.stop(time.monotonic())
            self._bridge.disarm(time.monotonic())
            self._note_state()

    def release(self):
        """Brake and torque off, whatever state the node is in; for the end of the program."""
        if self._bridge is not None:
            self._disarm()
            self._bridge.backend.close()
        if self._recorder is not None:
            self._recorder.close()

    def _tear_down(self):
        self.release()
        self._bridge = self._recorder = None
        while self._made:
            destroy, one = self._made.pop()
            destroy(one)

    # --- input --------------------------------------------------------------------------------------------------

    def _in_turn(self, call):
        """Call ``call()`` where the bridge runs, and return its result."""
        return call() if self._loop is None else self._loop.ask(call)

    def _post(self, call, *arguments):
        """Have something called where the bridge runs, between two cycles."""
        self._loop.post(partial(self._safely, call, *arguments))

    def _safely(self, call, *arguments):
        try:
            call(*arguments)
        except Exception as error:
            self.mishap(error)

    def _on_trajectory(self, raw):
        if self._loop is None:
            self._refuse('not active', 'the bridge is not active')
            return
        self._taken += 1        # since the last cycle
        if self._taken > self._values['messages_per_cycle']:
            self._flood += 1
            return
        try:
            if len(raw) > self._values['max_message_bytes']:
                self._refuse('size', f'a message of {len(raw)} bytes is refused unread')
                return
            stamp, points = self._reader.read(raw)
        except MotionError as error:
            self._refuse(getattr(error, 'kind', 'unusable'), str(error))
            return
        start = time.monotonic()
        if stamp:
            start += (stamp - self.get_clock().now().nanoseconds) / NANOSECONDS
        self._post(self._submit, points, start, stamp / NANOSECONDS)

    def _submit(self, points, start, stamp):
        try:
            self._bridge.submit(points, start, time.monotonic(), stamp)
        except MotionError as error:
            self._tell_rejection(error)

    def _refuse(self, kind, reason):
        error = MotionError(reason)
        error.kind = kind
        if self._loop is None:
            self._bridge.count_rejection(error)
        else:
            self._post(self._bridge.count_rejection, error)
        self._tell_rejection(error)

    def _refuse_what_waits(self):
        """Trajectories that came while nothing was to move are not played because they are looked at later."""
        with self._trajectories.handle:
            while self._trajectories.handle.take_message(JointTrajectory, True) is not None:
                self._refuse('wrong state', 'it came before the bridge was ready')

    def _tell_rejection(self, error):
        self.get_logger().warning(f'trajectory refused: {error}', throttle_duration_sec=1.0)

    def _pressed(self, now):
        """Why the emergency stop counts as pressed, or ''; before every command, in whatever thread the bridge runs."""
        if self._loop is not None and now - self._listened_at > DEAF_S and not self._executor_waits:
            return f'the node has heard nothing for {DEAF_S:g} s, no emergency stop either: it hangs or has no time'
        if self._loop is None or self._executor_waits:
            try:
                self._buttons.catch_up()        # the executor is busy with a transition
            except Exception as error:
                self.mishap(error)
        return self._stop.reason(now)

    def _on_pressed(self):
        if self._loop is not None and self._bridge.state is not State.ESTOP:
            self._post(self._stop_now)      # the next command asks anyway; where torque is to go off, it goes at once

    def _stop_now(self):
        now = time.monotonic()
        reason = self._stop.reason(now)
        if reason:
            self._bridge.estop(now, reason)

    def _answer(self, how, request, response):
        """Serve a Trigger: ``how()`` returns a message, and raises with the reason where it is refused."""
        try:
            response.message = how()
            response.success = True
        except (UsageError, BackendFault) as error:
            response.message = str(error)
        except Exception as error:
            self.mishap(error)
            response.message = f'error of the program: {error!r}'
        return response

    def _on_estop(self):
        self._stop.by_service = True
        self._in_turn(self._stop_now)
        return self._bridge.state.name      # where there is nothing to stop, it is stopped already: FAULT, DISARMED

    def _on_reset(self):
        self._buttons.catch_up()
        lifted, self._stop.by_service = self._stop.by_service, False
        if self._loop is None and lifted:
            return 'the stop by service is lifted'
        self._executor_waits = True
        try:
            self._in_turn(lambda: self._bridge.reset(time.monotonic()))
        except BaseException:
            self._stop.by_service = lifted
            raise
        else:
            self._refuse_what_waits()
        finally:
            self._listened_at = time.monotonic()
            self._executor_waits = False
        return ''

    def _on_release(self):
        reason = self._stop.reason(time.monotonic())
        self._buttons.override()
        self.get_logger().warning(f'released by the operator: {reason or "nothing was pressed"}')
        return self._stop.reason(time.monotonic())

    # --- output: in the servo thread ----------------------------------------------------------------------------

    def _cycle(self, now):
        self._taken = 0
        bridge = self._bridge
        try:
            periods = bridge.tick(now)
            self._times.done(now, periods, time.monotonic() - now)
            if bridge.state is not self._told:
                self._note_state()
            self._publish_cycle()
        except Exception as error:
            self.mishap(error)

    def _note_state(self):
        """Have every change of state published, however short it was."""
        self._told = self._bridge.state
        self._changes.append((self._bridge.state, self._bridge.reason))
        self._news.trigger()

    def _publish_cycle(self):
        measurement = self._bridge.backend.measurement
        stamp = self.get_clock().now().nanoseconds
        # nothing is made that nobody hears
        if self._commanded.get_subscription_count():
            self._commanded.publish(self._command_message.write(
                {'position': self._bridge.command, 'velocity': self._bridge.command_velocity},
                stamp + self._lead))
        if self._joint_states is not None and measurement.fresh and self._joint_states.get_subscription_count():
            self._joint_states.publish(self._measured_message.write(
                {'position': measurement.position, 'velocity': measurement.velocity, 'effort': measurement.effort},
                stamp))

    # --- output: in the executor's thread -----------------------------------------------------------------------

    def _on_news(self):
        if self._loop is not None and self._loop.failure is not None:
            self.mishap(self._loop.failure)
            raise SystemExit(1)     # nobody drives the motors any more: release them and end
        self._publish_changes()

    def _publish_changes(self):
        while self._changes:
            state, reason = self._changes.popleft()
            if reason:
                self.get_logger().warning(f'{state.name}: {reason}{self._way_out(state)}')
            else:
                self.get_logger().info(state.name)
            self._publish(state, reason)

    def _way_out(self, state):
        latched = (State.ESTOP, State.FAULT, State.RELAXED) + (State.HOLDING,) * self._values['latch_hold']
        if state not in latched:
            return ''
        return (f' (once the cause is gone: ros2 service call {self.get_fully_qualified_name()}/reset '
                'std_srvs/srv/Trigger)')

    def _publish_state(self):
        self._listened_at = time.monotonic()
        recorder = self._recorder
        if recorder is not None and recorder.problem and not self._problem_told:
            self._problem_told = True
            self.get_logger().error(f'the flight record has ended: {recorder.problem}; the bridge drives on')
        if self._loop is None:
            return
        self._publish_changes()
        self._publish(self._bridge.state, self._bridge.reason)

    def _publish(self, state, reason):
        bridge, measurement = self._bridge, self._bridge.backend.measurement
        now = time.monotonic()
        statistics = bridge.backend.statistics
        message = BridgeState(
            state=int(state), reason=reason, estop_held=bool(self._stop.reason(now)),
            joint_names=self._names, commanded=_floats(bridge.command),
            measured=_floats(measurement.position), limited=(bridge.bands != PASS).tolist(),
            input_age=float(bridge.input_age(now)), cycle_time=self._times.last, cycles=self._times.cycles,
            accepted=bridge.counts['accepted'], rejected=bridge.counts['rejected'] + self._flood,
            clamped=bridge.counts['clamped'], missed_deadlines=self._times.missed,
            bus_errors=sum(count for name, count in statistics.items() if 'errors' in name))
        message.header.stamp = self.get_clock().now().to_msg()
        self._state.publish(message)

    def _report(self):
        health = Health(WARN, 'not active', {})
        if self._loop is not None:
            health = health_of_bridge(self._bridge, self._times, self._flood, time.monotonic())
        health = with_the_rest(health, self._bridge, self._stop.reason(time.monotonic()), self._recorder, self._mishaps,
                               self._last_mishap)
        self._diagnostics.publish(diagnostics_message(self, f'{self.get_name()}: motors', health,
                                                      self._bridge.chain.name))


def main(args=None):
    """Run the node until it is told to stop; the motors are released on every way out that Python sees."""
    return run(BridgeNode, 'servo_bridge', until=lambda node: node.finished, args=args, switch_interval=SWITCH_S,
               services_wait=False, must_let_go=True)


if __name__ == '__main__':
    sys.exit(main())
