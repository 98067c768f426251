"""Player and predictor together over launch/replay.launch.py: faults, a looping recording, a player that is killed."""
import os
import signal
import subprocess
import tempfile
import time
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
from sensor_msgs.msg import JointState

from style_core.formats import read_motion, write_motion
from style_core.synthetic import synthetic_people
from style_msgs.msg import StyleEstimate

DARK_FROM, DARK_UNTIL = 3.0, 4.5


def recording():
    """A motion file of a person the model has not seen."""
    path = Path(tempfile.gettempdir()) / f'style_test_walk_{os.getuid()}_{os.getpid()}.npz'
    if not path.exists():
        write_motion(synthetic_people(1, seed=31, duration_s=6.0)[0], path)
    return path


@pytest.mark.launch_test
def generate_test_description():
    harness.own_domain(__file__)
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(harness.ROOT / 'launch' / 'replay.launch.py')),
            launch_arguments={'model': str(small_model()), 'file': str(recording()), 'drop': '["lfemur.*", "ltibia.*"]',
                              'drop_from': str(DARK_FROM), 'drop_until': str(DARK_UNTIL), 'jitter': '0.5',
                              'lose': '0.05', 'noise_std': '0.005', 'seed': '3'}.items()),
        ReadyToTest()])


def play(**parameters):
    """A player as a process of its own."""
    arguments = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    return subprocess.Popen(['ros2', 'run', 'style_predictor', 'motion_player', '--ros-args', *arguments],
                            start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def kill(process):
    """kill -9, the player itself and not only the command that started it."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class TestReplay(unittest.TestCase):
    """The first player comes from the launch file; later ones are started here."""

    @classmethod
    def setUpClass(cls):
        cls.probe = Probe('predictor', {
            '/predictor/estimate': (StyleEstimate, None), '/predictor/filled': (JointState, None),
            '/motion_player/truth': (JointState, None),
            '/diagnostics': (DiagnosticArray, None)})

    @classmethod
    def tearDownClass(cls):
        cls.probe.close()

    def heard(self, topic):
        return self.probe.heard[topic]

    def summary(self):
        """Summary of the newest diagnostics."""
        reports = self.heard('/diagnostics')
        return reports[-1].status[0].message if reports else ''

    def facts(self):
        return {pair.key: pair.value for pair in self.heard('/diagnostics')[-1].status[0].values}

    def test_1_a_leg_goes_dark_and_comes_back(self):
        probe = self.probe
        self.assertTrue(probe.wait(lambda: len(self.heard('/predictor/estimate')) > 100, 20.0))
        probe.wait(lambda: self.summary() == 'no joint states arrive', 15.0)  # everything has been played
        truth = {stamp_of(message): dict(zip(message.name, message.position))
                 for message in self.heard('/motion_player/truth')}
        # the first of them that reached us tells when the file began: the truth is the file's own frames
        first, poses = min(truth), read_motion(recording()).positions
        frame = np.argmin(np.abs(poses - [truth[first][name] for name in truth[first]]).sum(axis=1))
        start = first - int(frame) * 1_000_000_000 / 60
        filled = {stamp_of(message): message for message in self.heard('/predictor/filled')}
        dark_errors, phases, statuses = [], [], []
        for message in self.heard('/predictor/estimate'):
            stamp, at = stamp_of(message), 1e-9 * (stamp_of(message) - start)
            seen = dict(zip(message.joint_names, message.observed))
            leg = [name for name in seen if name.startswith(('lfemur', 'ltibia'))]
            if stamp not in truth:
                continue
            if DARK_FROM + 0.1 < at < DARK_UNTIL - 0.1:
                self.assertFalse(any(seen[name] for name in leg))
                self.assertTrue(all(seen[name] for name in seen if name not in leg))
                pose = dict(zip(filled[stamp].name, filled[stamp].position))
                dark_errors.append([pose[name] - truth[stamp][name] for name in leg])
            elif at > DARK_UNTIL + 0.2 or 0.1 < at < DARK_FROM - 0.1:
                self.assertTrue(all(seen.values()))
            if at > 2.0:
                statuses.append(message.status)
                phases.append((at, message.phase))
        self.assertGreater(np.mean(np.array(statuses) == StyleEstimate.TRACKING), 0.9)
        self.assertGreater(len(dark_errors), 50)
        self.assertLess(np.degrees(np.sqrt(np.mean(np.square(dark_errors)))), 8.0)
        at, phase = np.array(phases).T
        self.assertTrue((np.diff(np.unwrap(phase)) > -0.1).all(), 'the phase went backwards')

    def test_2_loops_of_a_recording_with_its_own_stamps(self):
        self.assertEqual(self.probe.set_parameters(max_stamp_age=0.0), '')
        self.heard('/predictor/estimate').clear()
        player = play(file=recording(), loop='repeat', stamps='file', start=0.0, stop=1.5, delay=0.0)
        try:
            self.assertTrue(self.probe.wait(lambda: len(self.heard('/predictor/estimate')) > 300, 25.0))
        finally:
            kill(player)
        stamps = np.array([stamp_of(message) for message in self.heard('/predictor/estimate')])
        laps = (np.diff(stamps) < 0).sum()
        self.assertGreaterEqual(laps, 3)
        self.assertTrue(self.probe.wait(lambda: int(self.facts()['clock resets']) >= laps, 4.0))
        # one message a lap goes into being sure that the clock has jumped; the last lap may have ended before that
        self.assertIn(int(self.facts()['rejected: jump']) - int(self.facts()['clock resets']), (0, 1))
        self.assertEqual(self.probe.set_parameters(max_stamp_age=0.5), '')

    def test_3_the_player_is_killed_and_comes_back(self):
        for lap in range(2):
            self.heard('/predictor/estimate').clear()
            player = play(file=recording(), loop='seamless', delay=0.0)
            try:
                self.assertTrue(self.probe.wait(
                    lambda: any(m.status == StyleEstimate.TRACKING for m in self.heard('/predictor/estimate')), 20.0),
                    f'not tracking, lap {lap}')
            finally:
                kill(player)
            self.heard('/diagnostics').clear()
            self.assertTrue(self.probe.wait(lambda: self.summary() == 'no joint states arrive', 5.0))
        self.assertEqual(self.probe.state(), 'active')

    def test_4_wrong_use_of_the_player_is_one_clear_line(self):
        for arguments, text in (([], 'parameter file is empty'), (['-p', 'file:=/absent.npz'], 'absent'),
                                (['-p', f'file:={recording()}', '-p', 'drop:=["wing*"]'], 'wing'),
                                (['-p', f'file:={recording()}', '-p', 'jitter:=3.0'], 'jitter'),
                                (['-p', f'file:={recording()}', '-p', 'loop:=maybe'], 'one of no, repeat, seamless')):
            started = time.monotonic()
            done = subprocess.run(['ros2', 'run', 'style_predictor', 'motion_player', '--ros-args', *arguments],
                                  capture_output=True, text=True, timeout=30)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(text, done.stderr)
            self.assertNotIn('Traceback', done.stderr)
            self.assertLess(time.monotonic() - started, 25)


@launch_testing.post_shutdown_test()
class TestAfterwards(unittest.TestCase):
    """Both processes end well."""

    def test_exit_status(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
