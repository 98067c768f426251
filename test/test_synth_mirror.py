"""A person plays from a file, a robot follows on a simulated servo chain: everything from joint states to servos."""
import tempfile
import unittest
from pathlib import Path

import harness
import launch_testing
import numpy as np
import pytest
from harness import Probe, small_model, stamp_of
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from style_core.formats import write_motion
from style_core.synthesis.retargeting import read_robot
from style_core.synthetic import synthetic_people
from style_msgs.msg import BridgeState, SynthesisStatus

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FOLDER = Path(tempfile.mkdtemp(prefix='mirror_test_'))


@pytest.mark.launch_test
def generate_test_description():
    harness.own_domain(__file__)
    write_motion(synthetic_people(1, seed=5, duration_s=60.0)[0], FOLDER / 'person.csv')
    # a busy machine may keep the simulated chain from answering within its milliseconds
    (FOLDER / 'bridge.yaml').write_text('/**:\n  ros__parameters:\n    reply_timeout: 0.2\n    watchdog: 2.0\n'
                                        '    rate: 50.0\n    input_timeout: 1.0\n    error_run: 1000\n'
                                        '    fast_read: false\n    following_time: 5.0\n')
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(harness.ROOT / 'launch' / 'mirror.launch.py')),
            launch_arguments={'model': str(small_model()), 'file': str(FOLDER / 'person.csv'),
                              'bridge_params': str(FOLDER / 'bridge.yaml')}.items()),
        ReadyToTest()])


class TestMirror(unittest.TestCase):
    """The whole chain."""

    def test_the_robot_walks_with_the_person(self):
        probe = Probe('servo_bridge', {
            '/servo_bridge/state': (BridgeState, LATCHED), '/synthesizer/status': (SynthesisStatus, LATCHED),
            '/servo_bridge/command': (JointState, None), '/joint_states': (JointState, None)})
        try:
            states = probe.heard['/servo_bridge/state']
            self.assertTrue(probe.wait(lambda: states and states[-1].state == BridgeState.STREAMING, 60.0),
                            states[-1].reason if states else 'no bridge')
            for messages in probe.heard.values():
                messages.clear()
            probe.spin(4.0)
            commands = probe.heard['/servo_bridge/command']
            robot = read_robot(harness.ROOT / 'config' / 'robots' / 'humanoid20.yaml')
            self.assertEqual(set(commands[-1].name), set(robot.joints))
            positions = np.array([message.position for message in commands])
            times = np.array([1e-9 * stamp_of(message) for message in commands])
            self.assertTrue(np.isfinite(positions).all())
            swing = np.ptp(positions, axis=0)[commands[-1].name.index('l_knee')]
            self.assertGreater(swing, 0.3, 'the knee hardly moves')
            # the servos' own limit of 4.5 rad/s, with room for late stamps
            steps = np.abs(np.diff(positions, axis=0)) / np.maximum(np.diff(times), 0.02)[:, None]
            self.assertLess(np.median(steps.max(axis=1)), 4.6)
            measured = np.array([m.position for m in probe.heard['/joint_states'] if len(m.position) == 20])
            self.assertGreater(np.ptp(measured, axis=0).max(), 0.3, 'the servos do not follow')
            self.assertEqual(probe.heard['/synthesizer/status'][-1].state, SynthesisStatus.PLAYING)
            self.assertGreater(states[-1].accepted, 20)
        finally:
            probe.close()


@launch_testing.post_shutdown_test()
class TestShutdown(unittest.TestCase):
    """Nothing crashes on the way out."""

    def test_exit_codes(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info, allowable_exit_codes=[0, 1, -2, -15, 130])
