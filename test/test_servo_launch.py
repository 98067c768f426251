"""The launch file brings up simulated servos and an active bridge; every fault ends as documented, and so does it."""
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import launch_testing
import pytest
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from servo_rig import ROOT, ServoRig, sender_program
from std_msgs.msg import Bool

from style_servo.chain import load_chain
from style_servo.record import read_record, violations
from style_servo.states import State

FOLDER = Path(tempfile.mkdtemp(prefix='servo_launch_'))
CHAIN = Path(ROOT) / 'config' / 'servo' / 'exosuit6.yaml'
# beside the exosuit's servos two that share one ID
TWINS = 7
PARAMETERS = """# a busy machine may keep the simulated servos from answering in time
/**:
  ros__parameters: {reply_timeout: 0.03, watchdog: 1.0, error_run: 30, following_time: 1.0, input_timeout: 0.5,
                    rate: 100.0, ramp_time: 0.1, ramp_speed: 0.6, reboot_servos: true}
"""


@pytest.mark.launch_test
def generate_test_description():
    """The launch file as a user starts it."""
    (FOLDER / 'bridge.yaml').write_text(PARAMETERS)
    servos = ','.join(f'{joint.id}:{joint.model}' for joint in load_chain(CHAIN).joints)
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(Path(ROOT) / 'launch' / 'servo.launch.py')),
            launch_arguments={
                'sim': 'true', 'chain': CHAIN.name, 'params': str(FOLDER / 'bridge.yaml'),
                'sim_link': str(FOLDER / 'port'), 'record': str(FOLDER / 'flight'),
                'sim_options': f'--servos {servos},{TWINS}:XM430-W350,{TWINS}:XM430-W350'}.items()),
        ReadyToTest()])


class TestLaunch(unittest.TestCase):
    """While it runs; in the order of their names."""

    @classmethod
    def setUpClass(cls):
        cls.rig = ServoRig(str(FOLDER), chain=CHAIN.name, link=str(FOLDER / 'port'))
        cls.rig.until(lambda: cls.rig.state is State.READY, 60)

    @classmethod
    def tearDownClass(cls):
        cls.rig.close()

    def fault(self, *words, **how):
        """Something happens while the bridge streams: a fault, latched, whose reason says what; then a reset."""
        rig = self.rig
        rig.stream_until(State.STREAMING)
        rig.tell(**how)
        rig.until(lambda: rig.state is State.FAULT, 20, rig.send_legal)
        for word in words:
            self.assertIn(word, rig.reason)
        rig.stream(0.1)
        self.assertIs(rig.state, State.FAULT)

    def recover(self):
        self.rig.until(lambda: self.rig.trigger('reset').success, 20)
        self.rig.wait_for(State.READY)

    def test_01_a_goal_is_reached_by_the_servos(self):
        rig = self.rig
        goal = (rig.chain.array('lower') + rig.chain.array('upper')) / 2
        rig.send({'names': list(rig.chain.names), 'times': [1.0], 'positions': goal[None], 'velocities': None,
                  'stamp': 0.0})
        rig.until(lambda: rig.states[-1].accepted > 0 and rig.state is State.READY)
        rig.until(lambda: max(abs(a - b) for a, b in zip(rig.states[-1].measured, goal)) < 0.02)

    def test_02_overload(self):
        self.fault('left_hip (ID 1', 'hardware error: overload', do='fail', id=1, kind='overload')
        self.recover()

    def test_03_over_temperature(self):
        self.fault('left_knee (ID 2', 'overheating', do='heat', id=2, celsius=95)
        self.rig.tell('heat', id=2, celsius=30)
        self.recover()

    def test_04_a_silent_servo(self):
        self.fault('right_ankle (ID 6', 'no longer answers', do='silent', id=6)
        self.rig.tell('silent', id=6, on=False)
        self.recover()

    def test_05_a_servo_reboots(self):
        self.fault('right_hip (ID 4', 'rebooted', do='reboot', id=4)
        self.recover()

    def test_06_the_adapter_is_unplugged(self):
        self.fault('is gone', 'unplugged', do='unplug')
        self.assertFalse(self.rig.trigger('reset').success)
        self.rig.tell('plug')
        self.recover()

    def test_07_emergency_stop_by_service_and_by_topic(self):
        rig = self.rig
        rig.stream_until(State.STREAMING)
        self.assertTrue(rig.trigger('estop').success)
        rig.wait_for(State.ESTOP)
        self.recover()
        rig.stream_until(State.STREAMING)
        rig.estop.publish(Bool(data=True))
        rig.wait_for(State.ESTOP)
        self.assertIn('still pressed', rig.trigger('reset').message)
        rig.estop.publish(Bool(data=False))
        rig.until(lambda: not rig.states[-1].estop_held)
        self.recover()

    def test_08_the_sender_is_killed(self):
        rig = self.rig
        rig.stream_until(State.STREAMING)       # so that only the sender's own motion is left to ramp into
        rig.wait_for(State.HOLDING)
        sender = subprocess.Popen([sys.executable, '-c', sender_program(rig.chain_path)])
        try:
            rig.wait_for(State.STREAMING, 40)
        finally:
            sender.kill()
            sender.wait()
        rig.wait_for(State.HOLDING, 3)
        self.recover()

    def test_09_what_configuring_refuses(self, proc_output):
        rig = self.rig
        twins = FOLDER / 'twins.yaml'
        twins.write_text(f'joints:\n  twin: {{id: {TWINS}, model: XM430-W350, lower: -1, upper: 1, velocity: 3, '
                         'acceleration: 20}\n')
        self.assertTrue(rig.change(Transition.TRANSITION_DEACTIVATE))
        self.assertTrue(rig.change(Transition.TRANSITION_CLEANUP))
        port, chain = str(FOLDER / 'port'), str(CHAIN)
        for values, words in (
                ({'port': '/dev/nothing'}, 'there is no such device'), ({'port': '/dev/null'}, 'is not a serial port'),
                ({'port': port, 'chain': str(CHAIN.parent / 'humanoid20.yaml')}, 'is a XM540-W270'),
                ({'chain': str(twins)}, 'share that ID'), ({'chain': chain, 'baud': 57600}, 'no servo answers')):
            self.set(**values)
            self.assertFalse(rig.change(Transition.TRANSITION_CONFIGURE))
            proc_output.assertWaitFor(words, timeout=10)
        self.set(baud=1000000, record=str(FOLDER / 'flight_2'))
        rig.up()

    def set(self, **values):
        """Set parameters of the bridge."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()
                                                    for name, value in values.items()])
        for result in self.rig.call(SetParameters, '/servo_bridge/set_parameters', request).results:
            self.assertTrue(result.successful, result.reason)

    def test_10_the_bridge_is_killed(self):
        """The servos stop by themselves: Bus Watchdog."""
        rig = self.rig
        rig.stream_until(State.STREAMING)
        processes = Path('/proc').glob('[0-9]*/cmdline')
        mine = [int(path.parent.name) for path in processes if str(FOLDER).encode() in read(path)
                and b'__node:=servo_bridge' in read(path)]
        self.assertEqual(len(mine), 1)
        os.kill(mine[0], signal.SIGKILL)
        rig.until(lambda: all(servo['halted'] for servo in rig.tell('state')['servos'] if servo['id'] != TWINS), 5)


def read(path):
    """Content of a file of /proc, which may vanish."""
    try:
        return path.read_bytes()
    except OSError:
        return b''


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """After it."""

    def test_everything_ends_in_order_and_nothing_was_outside_the_limits(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info, allowable_exit_codes=[0, -signal.SIGKILL])
        for name in ('flight', 'flight_2'):
            counts = violations(read_record(FOLDER / name))
            self.assertGreater(counts.pop('commands'), 100)
            self.assertEqual({name: count for name, count in counts.items() if count}, {})
