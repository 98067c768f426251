"""The predictor as a process of its own: its life, its outputs, and everything that can be wrong with its input."""
import json
import math
import os
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
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from style_core.synthetic import synthetic_people
from style_msgs.msg import MotionPrediction, StyleEstimate
from style_msgs.srv import LoadModel, ResetEstimate, SetMask

MS = 1_000_000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LEG = ('lfemur', 'ltibia', 'lfoot', 'ltoes')


@pytest.mark.launch_test
def generate_test_description():
    harness.own_domain(__file__)
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(harness.ROOT / 'launch' / 'predict.launch.py')),
            launch_arguments={'model': str(small_model()), 'autostart': 'false'}.items()),
        ReadyToTest()])


class TestPredictor(unittest.TestCase):
    """One node through all of its life; the tests run in the order of their names."""

    @classmethod
    def setUpClass(cls):
        cls.walk = synthetic_people(1, seed=77, duration_s=200.0)[0]
        cls.names = list(cls.walk.joint_names)
        cls.start = None
        cls.probe = Probe('predictor', {
            '/predictor/trajectory': (JointTrajectory, None), '/predictor/prediction': (MotionPrediction, None),
            '/predictor/estimate': (StyleEstimate, None), '/predictor/filled': (JointState, None),
            '/diagnostics': (DiagnosticArray, None)})

    @classmethod
    def tearDownClass(cls):
        cls.probe.close()

    def heard(self, topic):
        return self.probe.heard[f'/predictor/{topic}']

    def play(self, frames, change=None, answered=True):
        """Send the walk at about 100 Hz, waiting for the answer to each pose; returns the stamps."""
        stamps = []
        for _ in range(frames):
            stamp = self.probe.now()
            names, positions = self.names, self.pose(stamp)
            if change:
                names, positions, stamp = change(names, positions, stamp)
            before = len(self.heard('filled'))
            self.probe.send(names, positions, stamp)
            stamps.append(stamp)
            if answered:
                if not self.probe.wait(lambda n=before: len(self.heard('filled')) > n, 10.0):
                    self.fail(f'no answer within 10 s; the node reports {self.diagnostics()}')
                self.probe.spin(0.004)
            else:
                self.probe.spin(0.008)
        return stamps

    def pose(self, stamp):
        """Where the walker is at a time, however fast this machine gets on."""
        type(self).start = self.start or stamp
        self.last = self.walk.at([1e-9 * (stamp - self.start)]).positions[0]
        return self.last

    def clear(self):
        self.probe.spin(0.1)
        for messages in self.probe.heard.values():
            messages.clear()

    def diagnostics(self):
        """The next report's level, summary and facts."""
        self.probe.heard['/diagnostics'].clear()
        self.assertTrue(self.probe.wait(lambda: self.probe.heard['/diagnostics'], 5.0), 'no diagnostics')
        status = self.probe.heard['/diagnostics'][-1].status[0]
        return status.level[0], status.message, {pair.key: pair.value for pair in status.values}

    def fact(self, name):
        return int(self.diagnostics()[2][name])

    def test_01_every_transition(self):
        probe = self.probe
        self.assertTrue(probe.wait(lambda: probe.state() == 'unconfigured', 60.0))
        self.assertFalse(probe.transition('activate'), 'activated without being configured')
        good = str(small_model())
        broken = Path(good + '.broken.npz')
        broken.write_bytes(Path(good).read_bytes()[:1000])
        for path in ('', '/absent.npz', str(broken)):
            self.assertEqual(probe.set_parameters(model=path), '')
            self.assertFalse(probe.transition('configure'), f'configured with {path!r}')
            self.assertEqual(probe.state(), 'unconfigured')
        broken.unlink()
        # a busy machine may take its time: only what is older than 5 s is stale here
        self.assertEqual(probe.set_parameters(model=good, max_stamp_age=5.0), '')
        for label, state in (('configure', 'inactive'), ('activate', 'active'), ('deactivate', 'inactive'),
                             ('cleanup', 'unconfigured'), ('configure', 'inactive')):
            self.assertTrue(probe.transition(label), label)
            self.assertEqual(probe.state(), state)
        self.play(5, answered=False)
        self.assertEqual(self.heard('trajectory'), [], 'an inactive node published')
        self.assertTrue(probe.transition('activate'))
        self.assertTrue(probe.wait(lambda: probe.publisher.get_subscription_count() > 0))

    def test_02_horizon_stamps_and_content(self):
        self.clear()
        self.play(150)
        self.clear()
        stamps = self.play(60)
        self.assertTrue(self.probe.wait(lambda: len(self.heard('trajectory')) == 60))
        for topic in ('trajectory', 'prediction', 'estimate', 'filled'):
            self.assertEqual([stamp_of(message) for message in self.heard(topic)], stamps, topic)
        self.assertTrue((np.diff(stamps) > 0).all())
        trajectory, prediction = self.heard('trajectory')[-1], self.heard('prediction')[-1]
        self.assertEqual(trajectory.joint_names, self.names)
        ahead = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in trajectory.points]
        np.testing.assert_allclose(ahead, np.arange(25) / 60, atol=1e-8)
        mean = np.array([p.positions for p in trajectory.points])
        self.assertEqual(mean.shape, (25, 50))
        np.testing.assert_array_equal(mean, [p.positions for p in prediction.mean.points])
        # velocities are the derivative of positions
        velocity = np.array([p.velocities for p in trajectory.points])
        np.testing.assert_allclose(np.gradient(mean, 1 / 60, axis=0)[1:-1], velocity[1:-1], atol=0.4)
        std = np.array(prediction.standard_deviation).reshape(25, 50)
        self.assertTrue((std > 0).all() and np.isfinite(std).all())
        np.testing.assert_array_equal(self.heard('filled')[-1].position, self.last)
        estimate = self.heard('estimate')[-1]
        self.assertEqual((estimate.status, estimate.discrete), (StyleEstimate.TRACKING, False))
        self.assertTrue(all(estimate.observed) and len(estimate.observed) == 50)
        self.assertEqual(len(estimate.style_covariance), len(estimate.style)**2)

    def test_03_a_leg_goes_dark(self):
        dark = np.array([name.startswith(LEG) for name in self.names])
        lit = [name for name, out in zip(self.names, dark) if not out]
        self.clear()
        self.play(40, lambda names, positions, stamp: (lit, positions[~dark], stamp))
        np.testing.assert_array_equal(self.heard('estimate')[-1].observed, ~dark)
        filled = np.array(self.heard('filled')[-1].position)
        # one frame may still be on its way into the answer: compare with the neighbourhood
        error = np.degrees(np.abs(filled - self.last))
        self.assertLess(error[dark].max(), 25.0)
        self.assertLess(np.sqrt(np.mean(error[dark]**2)), 8.0)
        self.assertIn('timed out', ' '.join(self.diagnostics()[2]))
        self.play(5)

    def test_03b_a_sensor_that_lies(self):
        self.play(60)
        self.clear()
        wrong = self.names.index('rtibia.rx')

        def lie(names, positions, stamp):
            positions = positions.copy()
            positions[wrong] = 5.0
            return names, positions, stamp
        self.play(30, lie)
        while not self.probe.heard['/diagnostics']:
            self.play(5, lie)
        for estimate in self.heard('estimate'):
            self.assertEqual(estimate.status, StyleEstimate.TRACKING)
            self.assertEqual(list(np.flatnonzero(~np.array(estimate.observed))), [wrong])
        self.assertLess(np.degrees(abs(self.heard('filled')[-1].position[wrong] - self.last[wrong])), 25.0)
        facts = {pair.key: pair.value for pair in self.probe.heard['/diagnostics'][-1].status[0].values}
        self.assertEqual(facts['joints not believed'], 'rtibia.rx')
        self.assertGreater(int(facts['rejected: values not believed']), 0)
        self.clear()
        self.play(10)
        self.assertTrue(all(self.heard('estimate')[-1].observed))

    def test_04_nan_and_nonsense_never_come_out(self):
        self.clear()

        def spoil(names, positions, stamp):
            positions = positions.copy()
            positions[::3] = math.nan
            positions[1] = math.inf
            positions[2] = 1e300
            return names, positions, stamp
        self.play(30, spoil)
        observed = np.array(self.heard('estimate')[-1].observed)
        self.assertEqual(list(np.flatnonzero(~observed)[:4]), [0, 1, 2, 3])
        for message in self.heard('filled'):
            self.assertTrue(np.isfinite(message.position).all())
        for message in self.heard('trajectory'):
            self.assertTrue(np.isfinite([p.positions for p in message.points]).all())
        self.assertGreaterEqual(self.fact('rejected: NaN values'), 30 * 16)
        self.assertEqual(self.fact('rejected: implausible values'), 60)
        self.play(5, lambda names, positions, stamp: (names, positions * math.nan, stamp))
        self.assertFalse(any(self.heard('estimate')[-1].observed))

    def test_05_unknown_joints_and_broken_messages(self):
        self.play(10)
        self.clear()
        self.play(5, lambda names, positions, stamp: (['gripper', *names], [0.5, *positions], stamp))
        self.assertEqual(len(self.heard('filled')), 5)
        self.clear()
        wrong = [lambda n, p, s: (n, p[:-1], s), lambda n, p, s: (n[:-1], p, s), lambda n, p, s: (n, [], s),
                 lambda n, p, s: ([], [], s), lambda n, p, s: ([n[0], n[0]], [0.1, 0.2], s),
                 lambda n, p, s: (['gripper'], [0.5], s)]
        for change in wrong:
            self.play(1, change, answered=False)
        self.probe.spin(0.2)
        self.assertEqual(self.heard('filled'), [])
        facts = self.diagnostics()[2]
        self.assertEqual(facts['unknown joints'], 'gripper')
        self.assertEqual([facts[f'rejected: {reason}'] for reason in
                          ('wrong length', 'no positions', 'duplicate names', 'no known joint')], ['2', '2', '1', '1'])
        self.play(5)

    def test_06_zero_stale_future_and_repeated_stamps(self):
        self.clear()
        before = self.probe.now()
        self.play(5, lambda n, p, s: (n, p, 0))
        stamps = [stamp_of(message) for message in self.heard('trajectory')]
        self.assertTrue((np.diff(stamps) > 0).all() and stamps[0] > before)
        self.clear()
        for offset in (-7000 * MS, 9000 * MS):
            self.play(3, lambda n, p, s, o=offset: (n, p, s + o), answered=False)
        again = self.play(1)[0]
        self.play(3, lambda n, p, s: (n, p, again), answered=False)
        self.play(1, lambda n, p, s: (n, p, again - 20 * MS), answered=False)
        self.probe.spin(0.2)
        self.assertEqual(len(self.heard('trajectory')), 1)
        facts = self.diagnostics()[2]
        self.assertEqual([facts[f'rejected: {reason}'] for reason in ('stale', 'future', 'out of order')],
                         ['3', '3', '4'])

    def test_07_the_clock_jumps(self):
        # a busy machine may pause for seconds; that is not what is counted here
        self.assertEqual(self.probe.set_parameters(max_stamp_age=0.0, max_gap=10.0), '')
        self.play(30)
        self.clear()
        resets = self.fact('clock resets')
        for offset in (-50_000 * MS, 0):  # back, as a bag that starts again, and forth
            self.play(1, lambda n, p, s, o=offset: (n, p, s + o), answered=False)
            self.play(30, lambda n, p, s, o=offset: (n, p, s + o))
        stamps = np.array([stamp_of(message) for message in self.heard('trajectory')])
        self.assertEqual(len(stamps), 60)
        self.assertTrue((np.diff(stamps) > 0).all())
        self.assertLess(stamps[0], self.probe.now() - 40_000 * MS)
        self.play(1, lambda n, p, s: (n, p, s - 50_000 * MS), answered=False)  # a single broken stamp
        self.play(5)
        self.assertEqual(self.fact('clock resets'), resets + 2)
        self.assertEqual(self.probe.set_parameters(max_stamp_age=5.0, max_gap=1.0), '')

    def test_08_partial_messages_of_two_publishers_are_one(self):
        half = len(self.names) // 2
        self.assertEqual(self.probe.set_parameters(max_stamp_age=0.0), '')  # these stamps may fall behind the clock
        self.clear()
        start = self.probe.now()
        for number in range(20):
            stamp = start + 10 * number * MS
            positions = self.pose(stamp)
            self.probe.send(self.names[:half], positions[:half], stamp)
            self.probe.send(self.names[half:], positions[half:], stamp + MS)
            self.probe.spin(0.012)
        wanted = [start + (10 * number + 1) * MS for number in range(5, 20)]
        self.assertTrue(self.probe.wait(lambda: self.heard('estimate') and stamp_of(
            self.heard('estimate')[-1]) == wanted[-1]))
        whole = [message for message in self.heard('estimate') if stamp_of(message) >= start + 50 * MS]
        self.assertEqual([stamp_of(message) for message in whole], wanted)
        self.assertTrue(all(all(message.observed) for message in whole))
        self.assertEqual(self.probe.set_parameters(max_stamp_age=5.0), '')

    def test_09_mask_and_reset(self):
        self.play(2, answered=False)  # the stamps of the test before may have fallen far behind the clock
        response = self.probe.call(SetMask, 'set_mask', joints=['r*'], masked=True)
        self.assertTrue(response.success and set(response.masked_joints) == {n for n in self.names if n[0] == 'r'})
        self.play(5)
        observed = dict(zip(self.names, self.heard('estimate')[-1].observed))
        self.assertFalse(any(seen for name, seen in observed.items() if name[0] == 'r'))
        self.assertFalse(self.probe.call(SetMask, 'set_mask', joints=['wheel'], masked=True).success)
        response = self.probe.call(SetMask, 'set_mask', joints=['*'], masked=False)
        self.assertTrue(response.success and not response.masked_joints)
        self.play(100)
        self.assertEqual(self.heard('estimate')[-1].status, StyleEstimate.TRACKING)
        self.assertTrue(self.probe.call(ResetEstimate, 'reset').success)
        self.play(1)
        self.assertEqual(self.heard('estimate')[-1].status, StyleEstimate.ACQUIRING)

    def test_10_another_model_without_a_stall(self):
        path = str(small_model())
        response = self.probe.call(LoadModel, 'load_model', path='/absent.npz')
        self.assertFalse(response.success)
        self.assertIn('absent', response.message)
        self.assertEqual(response.joint_names, self.names)
        self.clear()
        client = self.probe.node.create_client(LoadModel, '/predictor/load_model')
        self.assertTrue(self.probe.wait(client.service_is_ready))
        future = client.call_async(LoadModel.Request(path=path))
        sent = 0
        while not future.done() and sent < 1000:  # every message is answered while the model loads
            sent += len(self.play(1))
        self.assertTrue(future.result().success, future.result().message)
        self.play(50)
        self.assertEqual(len(self.heard('filled')), sent + 50)

    def test_11_parameters_are_refused_as_a_whole_with_the_reason(self):
        refused = self.probe.set_parameters
        self.assertIn('horizon', refused(horizon=-1.0))
        self.assertIn('step', refused(horizon=0.1, step=0.2))
        self.assertIn('longer than merge_window', refused(joint_timeout=0.01, merge_window=0.5))
        self.assertIn('clean it up', refused(model='/other.npz'))
        self.assertIn('merge_window', refused(horizon=0.2, merge_window=5.0))
        self.assertEqual(refused(horizon=0.2, step=0.1), '')
        self.clear()
        self.play(2)
        self.assertEqual(len(self.heard('trajectory')[-1].points), 3)

    def test_12_latched_topics_reach_a_late_joiner(self):
        self.probe.listen('/predictor/model', String, LATCHED)
        self.assertTrue(self.probe.wait(lambda: self.heard('model')))
        description = json.loads(self.heard('model')[-1].data)
        self.assertEqual(description['robot_joints'], self.names)
        self.assertEqual(description['horizons_s'], [0.0, 0.1, 0.2])

    def test_13_silence_is_reported(self):
        self.probe.spin(1.2)
        level, message, _ = self.diagnostics()
        self.assertEqual((level, message), (2, 'no joint states arrive'))
        self.play(5)

    def test_14_shutdown(self):
        self.assertTrue(self.probe.transition('shutdown'))
        self.assertEqual(self.probe.state(), 'finalized')


@launch_testing.post_shutdown_test()
class TestAfterwards(unittest.TestCase):
    """The process ends well."""

    def test_exit_status(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)

    def test_domain_was_own(self):
        self.assertEqual(os.environ['ROS_LOCALHOST_ONLY'], '1')
