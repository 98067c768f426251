"""Joint trajectories in, limited servo commands out: the servo bridge as a lifecycle node."""
import array
import gc
import getpass
import os
import sys
import time
from collections import deque
from functools import partial
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from style_core.errors import MotionError, UsageError
from style_core.follow.limiter import PASS
from style_core.stream.health import WARN, Health
from style_core.stream.stamp_policy import NANOSECONDS
from style_msgs.msg import BridgeState
from style_node.diagnostics import diagnostics_message
from style_node.executor import run
from style_node.lifecycle import SoundLifecycleNode, transition
from style_node.ros_parameters import declare, values_of, watch
from style_node.templates import MessageTemplate
from style_servo.backend import BackendFault
from style_servo.backends import BACKENDS
from style_servo.bridge import Bridge
from style_servo.bridge_health import CycleTimes, health_of_bridge
from style_servo.chain import load_chain
from style_servo.loop import ServoLoop
from style_servo.parameters import BRIDGE, bridge_settings
from style_servo.record import Recorder
from style_servo.trajectory_message import TrajectoryReader

__all__ = ['BridgeNode', 'main']

STATE_EVERY_S = 0.1
REPORT_EVERY_S = 1.0
SWITCH_S = 0.0001       # a thread that computes lets the other one in after this long


def _floats(values):
    """What rclpy takes for float64[] without looking at every number."""
    return array.array('d', values.tobytes())


class BridgeNode(SoundLifecycleNode):
    """See ``docs/servo.md`` for topics, services, parameters and the state diagram.

    While active, a ServoLoop runs the bridge and publishes commands and measurements. The executor's thread takes
    messages apart, hands them over, and reports; of the bridge it only reads numbers.
    """

    def __init__(self, **options):
        super().__init__('servo_bridge', **options)
        self._bridge = None
        self._loop = None
        declare(self, BRIDGE)
        watch(self, BRIDGE, lambda: self._bridge is not None, lambda values: None)

    # --- lifecycle ----------------------------------------------------------------------------------------------

    @transition
    def on_configure(self, state):
        """Read the chain file, open and check the motors (torque stays off), make the interfaces."""
        self._values = values = values_of(self, BRIDGE)
        chain = load_chain(self._chain_path(values['chain']))
        self._period = period = 1.0 / values['rate']
        backend = BACKENDS[values['backend']](self, chain, values, period)
        bridge = Bridge(chain, backend, bridge_settings(values))
        try:
            backend.connect()
        except BackendFault as error:
            backend.close()
            raise UsageError(str(error)) from None
        for note in backend.notes:
            self.get_logger().warning(note)
        self._make_interfaces(chain)
        self._bridge = bridge
        self._recorder = Recorder(values['record'], chain, period) if values['record'] else None
        if self._recorder is not None:
            bridge.trace = self._recorder.write
        self._times, self._reader = CycleTimes(period), TrajectoryReader()
        self._taken = self._flood = 0
        self._told, self._changes = None, deque()
        self._take_priority(values['realtime_priority'])
        self.get_logger().info(f'{chain.name}: {len(chain.joints)} joints on {values["backend"]}, '
                               f'{values["rate"]:g} commands a second, torque off')
        return TransitionCallbackReturn.SUCCESS

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
        try:
            folder = Path(get_package_share_directory('style_bringup'))
        except PackageNotFoundError:
            folder = Path.cwd()
        return folder / 'config' / 'servo' / path

    def _make_interfaces(self, chain):
        self._names = list(chain.names)
        zero = [0.0] * len(self._names)
        self._command_message = MessageTemplate(JointState(name=self._names, position=zero, velocity=zero))
        self._measured_message = MessageTemplate(JointState(name=self._names, position=zero, velocity=zero,
                                                            effort=zero))
        overrides = QoSOverridingOptions.with_default_policies()
        self._commanded = self.create_lifecycle_publisher(JointState, '~/command', 50)
        # with ros2_control the joint state broadcaster publishes these
        self._joint_states = None
        if self._values['backend'] == 'dynamixel':
            self._joint_states = self.create_lifecycle_publisher(JointState, 'joint_states', 10)
        self._state = self.create_lifecycle_publisher(
            BridgeState, '~/state', QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._subscriptions_made = [
            self.create_subscription(JointTrajectory, 'joint_trajectory', self._on_trajectory, 8, raw=True,
                                     qos_overriding_options=overrides),
            self.create_subscription(Bool, 'estop', self._on_estop_topic, 10, qos_overriding_options=overrides)]
        self._services_made = [self.create_service(Trigger, '~/estop', self._on_estop),
                               self.create_service(Trigger, '~/reset', self._on_reset)]
        # the steady clock: a motor bus must not follow a simulated or corrected time
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers_made = [self.create_timer(STATE_EVERY_S, self._publish_state, clock=steady),
                             self.create_timer(REPORT_EVERY_S, self._report, clock=steady)]
        self._news = self.create_guard_condition(self._on_news)

    @transition
    def on_activate(self, state):
        """Torque on at the measured posture."""
        gc.collect()
        gc.freeze()     # what is there now stays; the collector need not look at it again
        try:
            self._bridge.arm(time.monotonic())
        except BackendFault as error:
            raise UsageError(str(error)) from None
        result = super().on_activate(state)
        self._times = CycleTimes(self._period)
        self._note_state()
        self._loop = ServoLoop(self._cycle, self._bridge.ticked, self._period, self._news.trigger)
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
        if self._bridge is None:
            return
        self.release()
        self._bridge = None
        for one in self._subscriptions_made:
            self.destroy_subscription(one)
        for one in self._services_made:
            self.destroy_service(one)
        for one in self._timers_made:
            self.destroy_timer(one)
        self.destroy_guard_condition(self._news)
        for one in (self._commanded, self._joint_states, self._state):
            if one is not None:
                self.destroy_lifecycle_publisher(one)
        self.destroy_publisher(self._diagnostics)

    # --- input --------------------------------------------------------------------------------------------------

    def _in_turn(self, call):
        """Call ``call()`` where the bridge runs, and return its result."""
        return call() if self._loop is None else self._loop.ask(call)

    def _on_trajectory(self, raw):
        if self._loop is None:
            return
        self._taken += 1        # since the last cycle
        if self._taken > self._values['messages_per_cycle']:
            self._flood += 1
            return
        try:
            if len(raw) > self._values['max_message_bytes']:
                error = MotionError(f'a message of {len(raw)} bytes is refused unread')
                error.kind = 'size'
                raise error
            stamp, points = self._reader.read(raw)
        except MotionError as error:
            self._loop.post(partial(self._bridge.count_rejection, error))
            self._tell_rejection(error)
            return
        start = time.monotonic()
        if stamp:
            start += (stamp - self.get_clock().now().nanoseconds) / NANOSECONDS
        self._loop.post(partial(self._submit, points, start, stamp / NANOSECONDS))

    def _submit(self, points, start, stamp):
        try:
            self._bridge.submit(points, start, time.monotonic(), stamp)
        except MotionError as error:
            self._tell_rejection(error)

    def _tell_rejection(self, error):
        self.get_logger().warning(f'trajectory refused: {error}', throttle_duration_sec=1.0)

    def _on_estop_topic(self, message):
        self._bridge.estop_held = message.data
        if message.data:
            self._in_turn(lambda: self._bridge.estop(time.monotonic(), 'emergency stop by topic'))

    def _on_estop(self, request, response):
        self._in_turn(lambda: self._bridge.estop(time.monotonic(), 'emergency stop by service'))
        response.success = True     # where there is nothing to stop, it is stopped already: FAULT, DISARMED
        response.message = self._bridge.state.name
        return response

    def _on_reset(self, request, response):
        try:
            self._in_turn(lambda: self._bridge.reset(time.monotonic()))
            response.success = True
        except (UsageError, BackendFault) as error:
            response.message = str(error)
        return response

    # --- output: in the servo thread ----------------------------------------------------------------------------

    def _cycle(self, now):
        self._taken = 0
        bridge = self._bridge
        periods = bridge.tick(now)
        self._times.done(now, periods, time.monotonic() - now)
        if bridge.state is not self._told:
            self._note_state()
        try:
            self._publish_cycle()
        except Exception:
            if self.context.ok():       # nothing can be published while the program is being ended
                raise

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
                {'position': self._bridge.command, 'velocity': self._bridge.command_velocity}, stamp))
        if self._joint_states is not None and measurement.fresh and self._joint_states.get_subscription_count():
            self._joint_states.publish(self._measured_message.write(
                {'position': measurement.position, 'velocity': measurement.velocity, 'effort': measurement.effort},
                stamp))

    # --- output: in the executor's thread -----------------------------------------------------------------------

    def _on_news(self):
        if self._loop is not None and self._loop.failure is not None:
            raise self._loop.failure
        self._publish_changes()

    def _publish_changes(self):
        while self._changes:
            state, reason = self._changes.popleft()
            if reason:
                self.get_logger().warning(f'{state.name}: {reason}')
            else:
                self.get_logger().info(state.name)
            self._publish(state, reason)

    def _publish_state(self):
        if self._loop is None:
            return
        self._publish_changes()
        self._publish(self._bridge.state, self._bridge.reason)
        if self._recorder is not None:
            self._recorder.flush()

    def _publish(self, state, reason):
        bridge, measurement = self._bridge, self._bridge.backend.measurement
        now = time.monotonic()
        statistics = bridge.backend.statistics
        message = BridgeState(
            state=int(state), reason=reason, estop_held=bridge.estop_held,
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
        self._diagnostics.publish(diagnostics_message(self.get_clock().now().to_msg(),
                                                      f'{self.get_name()}: motors', health, self._bridge.chain.name))


def main(args=None):
    """Run the node until it is told to stop; the motors are released on every way out that Python sees."""
    return run(BridgeNode, 'servo_bridge', args=args, switch_interval=SWITCH_S, services_wait=False)


if __name__ == '__main__':
    sys.exit(main())
