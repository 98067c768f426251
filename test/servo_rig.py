"""A simulated chain and the bridge as processes of their own, and a node that talks to the bridge."""
import array
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_msgs.msg import BridgeState
from style_servo.chain import load_chain
from style_servo.dynamixel_sim import tell
from style_servo.hostile import legal_fields
from style_servo.states import State

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
# a busy machine can keep the simulator from answering for a while; real servos answer in time
PATIENT = {'reply_timeout': 0.03, 'watchdog': 2.0, 'error_run': 50}


# nothing that is sent may get lost unseen
DEEP = {'qos_overrides./joint_trajectory.subscription.depth': 1000, 'messages_per_cycle': 1000}


class ServoRig:
    """Start everything; ``close`` ends it.

    Parameters
    ----------
    folder : path-like
        For the port's link and the record.
    chain : str
        Name in config/servo.
    simulate : bool
        Start the simulated bus.
    sim_options : sequence of str
    listen : bool
        Keep commands and joint states as they come.
    link : path-like, optional
        Of a chain and a bridge that a launch file has started; then nothing is started here.
    parameters : of the bridge
    """

    def __init__(self, folder, chain='exosuit6.yaml', simulate=True, sim_options=(), listen=True, link=None,
                 **parameters):
        self.folder = Path(folder)
        self.link, self.record, self.wire = (os.path.join(folder, name) for name in ('port', 'record', 'wire'))
        self.chain_path = os.path.join(ROOT, 'config', 'servo', chain)
        self.chain = load_chain(self.chain_path)
        self.parameters = {**PATIENT, 'chain': self.chain_path, 'port': self.link,
                           'record_folder': str(folder), 'record': 'record', **parameters}
        self.link = link or self.link
        self._options, self._processes = list(sim_options), []
        self._log = open(os.path.join(folder, 'log'), 'w')      # noqa: SIM115  (open as long as the rig)
        self.simulator = self._start_simulator() if simulate and not link else None
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('rig', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.states, self.commands, self.joint_states, self.diagnostics = [], [], [], []
        node, latched = self.node, QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(BridgeState, '/servo_bridge/state', self.states.append, latched)
        if listen:
            node.create_subscription(JointState, '/servo_bridge/command', self.commands.append, 1000)
            node.create_subscription(JointState, '/joint_states', self.joint_states.append, 100)
        node.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics.append, 10)
        self.trajectories = node.create_publisher(JointTrajectory, '/joint_trajectory', 100)
        self.estop = node.create_publisher(Bool, '/estop', 10)
        self.bridge = None if link else self.start_bridge()

    # --- processes ----------------------------------------------------------------------------------------------

    def _start_simulator(self):
        servos = ','.join(f'{joint.id}:{joint.model}' for joint in self.chain.joints)
        process = subprocess.Popen(
            [sys.executable, '-m', 'style_servo.dynamixel_sim', '--link', self.link, '--servos', servos,
             '--record', self.wire, *self._options], stdout=subprocess.PIPE, text=True)
        assert 'simulated servos' in process.stdout.readline()
        self._processes.append(process)
        return process

    def start_bridge(self, limit=None, **parameters):
        """Start the bridge's process (unconfigured); ``limit``: size that no file may outgrow, bytes."""
        arguments = []
        for name, value in {**self.parameters, **parameters}.items():
            text = str(value).lower() if isinstance(value, bool) else str(value) or "''"
            arguments += ['-p', f'{name}:={text}']
        process = subprocess.Popen([sys.executable, '-m', 'style_servo.bridge_node', '--ros-args', *arguments],
                                   stderr=self._log, preexec_fn=limit and (lambda: resource.setrlimit(
                                       resource.RLIMIT_FSIZE, (limit, limit))))
        self._processes.append(process)
        return process

    def close(self):
        """End every process, kindly first; a second call does nothing."""
        if self.node is None:
            return
        for process in reversed(self._processes):
            if process.poll() is None:
                process.send_signal(signal.SIGINT if process is not self.simulator else signal.SIGTERM)
                try:
                    process.wait(15)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            if process.stdout:
                process.stdout.close()
        self._log.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.node = None
        rclpy.shutdown(context=self.context)

    # --- talking ------------------------------------------------------------------------------------------------

    def tell(self, do, **options):
        """A command for the simulator."""
        return tell(self.link, do=do, **options)

    def spin(self, seconds):
        """Receive for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=max(0.0, min(0.01, end - time.monotonic())))

    def until(self, condition, seconds=20.0, doing=None):
        """Receive until a condition holds; ``doing`` is called about every 20 ms meanwhile."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, (self.state_name, self.reason, self.log()[-800:])
            if doing:
                doing()
            self.spin(0.02)

    def log(self):
        """What the bridge has written so far."""
        return Path(self._log.name).read_text()

    def call(self, kind, name, request=None, seconds=60.0):
        """Call a service."""
        client = self.node.create_client(kind, name)
        try:
            assert client.wait_for_service(30.0), name
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                # the server found may be the shadow of a process that was killed: ask again
                future = client.call_async(request or kind.Request())
                self.executor.spin_until_future_complete(future, 8.0)
                if future.done():
                    return future.result()
            raise AssertionError(f'{name} does not answer: {self.log()[-800:]}')
        finally:
            self.node.destroy_client(client)

    def trigger(self, name):
        """Call a Trigger service of the bridge: 'estop' or 'reset'."""
        return self.call(Trigger, f'/servo_bridge/{name}')

    def change(self, transition):
        """A lifecycle transition; returns whether it succeeded."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(ChangeState, '/servo_bridge/change_state', request).success

    def up(self):
        """Configure and activate; again where a busy machine kept the simulated servos from answering."""
        assert any(self.change(Transition.TRANSITION_CONFIGURE) for _ in range(4)), self.log()
        # a launch file may activate what has been configured before we do
        assert any(self.change(Transition.TRANSITION_ACTIVATE) or self.spin(0.1) or self.state is State.READY
                   for _ in range(4)), self.log()
        self.until(lambda: self.state is State.READY)
        return self

    @property
    def state(self):
        """The last state heard."""
        return State(self.states[-1].state) if self.states else None

    @property
    def state_name(self):
        return self.state.name if self.states else 'nothing heard'

    @property
    def reason(self):
        return self.states[-1].reason if self.states else ''

    def send(self, fields):
        """Publish a trajectory from fields as in style_servo.hostile."""
        self.trajectories.publish(message_of(fields, self.node.get_clock().now().nanoseconds))

    def send_legal(self):
        """One window of an endless legal motion."""
        self.send(legal_fields(self.chain, time.monotonic()))

    def stream(self, seconds):
        """Stream the legal motion for a while."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, seconds + 10, self.send_legal)

    def stream_until(self, state, seconds=20.0):
        """Stream the legal motion until the bridge is in a state."""
        self.until(lambda: self.state is state, seconds, self.send_legal)

    def wait_for(self, state, seconds=20.0):
        """Wait, sending nothing, until the bridge is in a state."""
        self.until(lambda: self.state is state, seconds)


def message_of(fields, now_ns):
    """A JointTrajectory message."""
    message = JointTrajectory(joint_names=fields['names'])
    if fields['stamp']:
        stamp = max(0, now_ns + int(fields['stamp'] * 1e9))
        message.header.stamp.sec, message.header.stamp.nanosec = min(stamp // 10**9, 2**31 - 1), stamp % 10**9
    for k, seconds in enumerate(fields['times']):
        point = JointTrajectoryPoint()
        nanoseconds = round(seconds * 1e9)
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(nanoseconds, 10**9)
        point.positions = array.array('d', fields['positions'][k].tobytes())
        if fields['velocities'] is not None:
            point.velocities = array.array('d', fields['velocities'][k].tobytes())
        message.points.append(point)
    return message


SENDER = """
import sys, time
sys.path[:0] = {path!r}
from servo_rig import message_of
import rclpy
from trajectory_msgs.msg import JointTrajectory
from style_servo.chain import load_chain
from style_servo.hostile import legal_fields
rclpy.init()
node = rclpy.create_node('sender')
publisher = node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
chain = load_chain({chain!r})
while True:
    publisher.publish(message_of(legal_fields(chain, time.monotonic()), 0))
    time.sleep(0.02)
"""


def sender_program(chain_path):
    """Source of a program that streams the legal motion until it is killed."""
    return SENDER.format(path=[os.path.dirname(os.path.abspath(__file__)), *sys.path], chain=chain_path)
