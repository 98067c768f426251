"""A person plays from a file, a robot follows on a simulated servo chain: everything from joint states to servos."""
import tempfile
import unittest
from pathlib import Path

import harness
import launch_testing
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from harness import Probe, small_model, stamp_of
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from style_core.formats import write_motion
from style_core.synthesis.retargeting import read_robot
from style_core.synthesis.sources.source import hermite
from style_core.synthetic import synthetic_people
from style_msgs.msg import BridgeState, SynthesisStatus

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WALK_S = 20.0
FOLDER = Path(tempfile.mkdtemp(prefix='mirror_test_'))


@pytest.mark.launch_test
def generate_test_description():
    harness.own_domain(__file__)
    write_motion(synthetic_people(1, seed=5, duration_s=60.0)[0], FOLDER / 'person.csv')
    # a busy machine may keep the simulated chain from answering within its milliseconds
    (FOLDER / 'bridge.yaml').write_text('/**:\n  ros__parameters:\n    reply_timeout: 0.5\n    watchdog: 2.5\n'
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

    def test_the_robot_walks_with_the_person_at_full_speed(self):
        """The knees of this walk are asked for more than the 4.5 rad/s of their servos."""
        probe = Probe('servo_bridge', {
            '/servo_bridge/state': (BridgeState, LATCHED), '/synthesizer/status': (SynthesisStatus, LATCHED),
            '/servo_bridge/command': (JointState, None), '/joint_states': (JointState, None),
            '/joint_trajectory': (JointTrajectory, None), '/diagnostics': (DiagnosticArray, None)})
        try:
            states = probe.heard['/servo_bridge/state']
            for _ in range(3):      # a busy machine may keep the simulated servos from answering when configured
                if probe.wait(lambda: states and states[-1].state == BridgeState.STREAMING, 20.0):
                    break
                if probe.state() == 'unconfigured':
                    probe.transition('configure')
                    probe.transition('activate')
            self.assertTrue(states and states[-1].state == BridgeState.STREAMING,
                            states[-1].reason if states else 'no bridge')
            for messages in probe.heard.values():
                messages.clear()
            probe.spin(WALK_S)
            heard = probe.heard
            self.assertGreater(len(states), 10)
            self.assertEqual({state.state for state in states}, {BridgeState.STREAMING},
                             {state.reason for state in states})
            self.assertGreater(states[-1].accepted, states[0].accepted + 10 * WALK_S)
            self.assertEqual({status.state for status in heard['/synthesizer/status']}, {SynthesisStatus.PLAYING})
            self.check_windows(heard['/joint_trajectory'])
            self.check_commands(heard['/servo_bridge/command'], heard['/joint_states'])
            saturated = [pair.value for message in heard['/diagnostics'] for status in message.status
                         for pair in status.values if pair.key.startswith('saturated')]
            self.assertTrue(any('knee' in value for value in saturated), saturated)
        finally:
            probe.close()

    def check_windows(self, windows):
        """No motor is asked for more than it can do, and every window goes on where the one before is by then."""
        robot = read_robot(harness.ROOT / 'config' / 'robots' / 'humanoid20.yaml')
        joints = [robot.joints[name] for name in windows[0].joint_names]
        most, bend = (np.array([getattr(joint, key) for joint in joints]) for key in ('velocity', 'acceleration'))
        before = None
        for message in windows:
            times = 1e-9 * stamp_of(message) + np.array([
                p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points])
            q, v = (np.array([getattr(p, key) for p in message.points]) for key in ('positions', 'velocities'))
            self.assertTrue((np.abs(v) <= most).all())
            self.assertTrue((np.abs(np.diff(v, axis=0)) <= 1.01 * bend * np.diff(times)[:, None]).all())
            if before is not None and times[0] < before[0][-1]:
                for now, then in zip((q, v), hermite(*before, times[:1])):
                    gap = np.abs(now[0] - then[0]).max()
                    self.assertLess(gap, 2e-3 if now is q else 0.1)
            before = times, q, v

    def check_commands(self, commands, reports):
        """The servos get them, and follow."""
        positions = np.array([message.position for message in commands])
        self.assertEqual(len(commands[-1].name), 20)
        self.assertTrue(np.isfinite(positions).all())
        swing = np.ptp(positions, axis=0)[commands[-1].name.index('l_knee')]
        self.assertGreater(swing, 0.5, 'the knee hardly moves')
        measured = np.array([m.position for m in reports if len(m.position) == 20])
        self.assertGreater(np.ptp(measured, axis=0).max(), 0.5, 'the servos do not follow')


@launch_testing.post_shutdown_test()
class TestShutdown(unittest.TestCase):
    """Nothing crashes on the way out."""

    def test_exit_codes(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info, allowable_exit_codes=[0, -2, -15, 130])
