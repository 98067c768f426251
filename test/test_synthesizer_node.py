"""The synthesizer as a process of its own: every mode, style changes, the action, bad input, its life."""
import json
import pty
import subprocess
import threading
import unittest
from pathlib import Path

import harness
import launch_testing
import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from harness import Probe, stamp_of
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from style_core.formats import write_motion
from style_core.phase_style import load_behaviours
from style_core.synthesis.sources.phase_style import CycleSource
from style_core.synthetic import synthetic_gait
from style_msgs.action import Synthesize
from style_msgs.msg import StateSequence, StyleEstimate, StyleVector, SynthesisStatus
from style_msgs.srv import ListStyles, LoadModel, SetStyle


def training_bend():
    """Largest acceleration of any joint in the training styles at their mean cadence, rad/s^2."""
    behaviour = load_behaviours(MODELS / 'locomotion.npz')[0]
    times = np.arange(0.0, 2.0, 0.01)
    return max(np.abs(np.diff(CycleSource(behaviour, style).window(times)[1], axis=0)).max() / 0.01
               for style in behaviour.styles)


LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MODELS = harness.ROOT / 'config' / 'models'
STATES = SynthesisStatus


@pytest.mark.launch_test
def generate_test_description():
    harness.own_domain(__file__)
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(harness.ROOT / 'launch' / 'synthesize.launch.py')),
            launch_arguments={'model': 'locomotion.npz', 'robot': 'humanoid20.yaml', 'autostart': 'false'}.items()),
        ReadyToTest()])


class TestSynthesizer(unittest.TestCase):
    """One node through all its modes; the tests run in the order of their names."""

    @classmethod
    def setUpClass(cls):
        cls.probe = Probe('synthesizer', {
            '/joint_trajectory': (JointTrajectory, None), '/synthesizer/status': (SynthesisStatus, LATCHED),
            '/synthesizer/models': (String, LATCHED), '/synthesizer/styles': (String, LATCHED),
            '/diagnostics': (DiagnosticArray, None)})
        node = cls.probe.node
        cls.sequence = node.create_publisher(StateSequence, '/synthesizer/sequence', 5)
        cls.style = node.create_publisher(StyleVector, '/synthesizer/style', 5)
        cls.estimate = node.create_publisher(StyleEstimate, '/predictor/estimate', 5)

    @classmethod
    def tearDownClass(cls):
        cls.probe.close()

    def windows(self):
        return self.probe.heard['/joint_trajectory']

    def status(self):
        heard = self.probe.heard['/synthesizer/status']
        return heard[-1] if heard else STATES(state=255)

    def wait_state(self, state, timeout=8.0):
        self.assertTrue(self.probe.wait(lambda: self.status().state == state, timeout),
                        f'state {self.status().state} ({self.status().message}), not {state}')

    def begin(self, **parameters):
        """Configure anew with these parameters, and activate."""
        probe = self.probe
        if probe.state() == 'active':
            self.assertTrue(probe.transition('deactivate'))
        if probe.state() == 'inactive':
            self.assertTrue(probe.transition('cleanup'))
        probe.spin(0.1)
        for messages in probe.heard.values():
            messages.clear()
        self.assertEqual(probe.set_parameters(**parameters), '')
        self.assertTrue(probe.transition('configure'), parameters)
        self.assertTrue(probe.transition('activate'))

    def collect(self, seconds):
        """Windows of the next seconds: stamps (s), first points and velocities, checked one by one."""
        self.windows().clear()
        self.probe.spin(seconds)
        messages = list(self.windows())
        self.assertGreater(len(messages), 5)
        stamps = np.array([stamp_of(message) for message in messages])
        self.assertTrue((np.diff(stamps) > 0).all())
        for message in messages:
            times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
            self.assertEqual(times[0], 0)
            self.assertTrue((np.diff(times) > 0).all())
            values = np.array([[p.positions, p.velocities] for p in message.points])
            self.assertTrue(np.isfinite(values).all())
            self.assertEqual(values.shape[2], len(message.joint_names))
        first = np.array([m.points[0].positions for m in messages])
        velocity = np.array([m.points[0].velocities for m in messages])
        return 1e-9 * stamps, first, velocity

    def smooth(self, stamps, positions, velocities, most=0.02):
        """Every window starts where the one before said it would be: position follows velocity."""
        step = np.diff(stamps)[:, None]
        near = step[:, 0] < 0.035       # a window that came late says nothing about continuity
        error = np.diff(positions, axis=0) - 0.5 * step * (velocities[1:] + velocities[:-1])
        self.assertGreater(near.sum(), 5)
        self.assertLess(np.abs(error[near]).max(), most)
        self.assertGreater(np.abs(velocities).max(), 0.05, 'nothing moves')

    def test_01_life_and_cycle(self):
        probe = self.probe
        self.assertTrue(probe.wait(lambda: probe.state() == 'unconfigured', 20.0))
        self.assertFalse(probe.transition('activate'))
        for wrong in ({'model': '/absent.npz'}, {'robot': '/absent.yaml'}, {'style': 'nobody'}, {'mode': 'file'}):
            right = {'model': 'locomotion.npz', 'robot': 'humanoid20.yaml', 'style': '', 'mode': 'cycle'}
            self.assertEqual(probe.set_parameters(**{**right, **wrong}), '')
            self.assertFalse(probe.transition('configure'), wrong)
            self.assertEqual(probe.state(), 'unconfigured')
        self.begin(**right)
        self.smooth(*self.collect(1.5))
        self.assertEqual(len(self.windows()[-1].joint_names), 20)
        self.wait_state(STATES.PLAYING)
        self.assertEqual(self.status().model, 'locomotion')
        self.assertTrue(probe.wait(lambda: probe.heard['/synthesizer/models'] and probe.heard['/synthesizer/styles']))
        described = json.loads(probe.heard['/synthesizer/models'][-1].data)
        self.assertIn('locomotion.npz', [model['file'] for model in described['models']])
        self.assertEqual(described['modes'], ['cycle', 'follow'])
        self.assertIn('mean', json.loads(probe.heard['/synthesizer/styles'][-1].data)['styles'])

    def test_02_styles_by_service_topic_and_parameter(self):
        probe = self.probe
        listed = probe.call(ListStyles, 'list_styles')
        names = [style.name for style in listed.styles]
        self.assertEqual(len(listed.labels), len(listed.lower))
        self.windows().clear()
        first = probe.call(SetStyle, 'set_style', style=StyleVector(name=f'"{names[0]}"'), transition_time=0.6)
        self.assertTrue(first.success, first.message)
        self.probe.spin(0.3)    # and on the way another
        second = probe.call(SetStyle, 'set_style', style=StyleVector(values=listed.styles[1].values))
        self.assertTrue(second.success, second.message)
        self.assertEqual(second.style.name, names[1])
        self.smooth(*self.collect(1.2))
        self.wait_state(STATES.PLAYING)
        np.testing.assert_allclose(self.status().style.values, listed.styles[1].values)
        self.style.publish(StyleVector(name=f'0.5*"{names[2]}" + 0.5*mean'))
        wanted = 0.5 * (np.array(listed.styles[2].values) + np.array(listed.styles[names.index('mean')].values))
        self.assertTrue(probe.wait(lambda: np.allclose(self.status().style.values, wanted), 5.0))
        self.assertEqual(probe.set_parameters(style='mean'), '')
        self.assertTrue(probe.wait(lambda: self.status().style.name == 'mean', 5.0))
        self.assertIn('nobody', probe.set_parameters(style='nobody'))
        for bad in (StyleVector(), StyleVector(name='nobody'), StyleVector(values=[1.0]),
                    StyleVector(values=[float('nan')] * len(listed.labels)),
                    StyleVector(values=[1e9] * len(listed.labels))):
            answer = probe.call(SetStyle, 'set_style', style=bad)
            self.assertFalse(answer.success)
            self.assertTrue(answer.message)
        self.assertEqual(self.status().target.name, 'mean')

    def test_02b_style_changes_at_any_time_bend_no_more_than_the_training_data(self):
        """On what is received, for a robot without limits: most changes come while another is on its way."""
        probe, rng = self.probe, np.random.default_rng(7)
        self.begin(model='locomotion.npz', robot='cmu.yaml', mode='cycle', style='')
        names = [style.name for style in probe.call(ListStyles, 'list_styles').styles]
        probe.spin(0.3)
        self.windows().clear()
        for _ in range(10):
            self.style.publish(StyleVector(name=f'"{rng.choice(names)}"'))
            probe.spin(rng.uniform(0.1, 0.7))
        messages = list(self.windows())
        stamps = 1e-9 * np.array([stamp_of(message) for message in messages])
        here, rate = (np.array([getattr(m.points[0], key) for m in messages]) for key in ('positions', 'velocities'))
        step = np.diff(stamps)[:, None]
        near = step[:, 0] < 0.05        # a window that came late says nothing about what was before it
        self.assertGreater(near.sum(), 20)
        bend = np.abs(np.diff(rate, axis=0)[near] / step[near]).max()
        self.assertLess(bend, 1.5 * training_bend())
        error = np.diff(here, axis=0) - 0.5 * step * (rate[1:] + rate[:-1])
        # what a parabola misses at the greatest bend
        self.assertLess(np.abs(error[near] / step[near]**2).max(), training_bend())
        self.assertGreater(bend, 0.2 * training_bend(), 'nothing moves')
        self.begin(model='locomotion.npz', robot='humanoid20.yaml', mode='cycle', style='')

    def test_02c_keys_of_the_slider_change_the_style(self):
        """The program of the terminal, on a pseudo-terminal, against this node."""
        probe = self.probe
        listed = probe.call(ListStyles, 'list_styles').styles
        keyboard, terminal = pty.openpty()
        slider = subprocess.Popen(['ros2', 'run', 'style_synth', 'style_slider', '--seconds', '0.2'], stdin=terminal,
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)  # a middleware talks there
        try:
            shown = threading.Event()
            threading.Thread(target=lambda: shown.set() if slider.stdout.read(20) else None, daemon=True).start()
            self.assertTrue(probe.wait(shown.is_set, 20.0), 'nothing is drawn')
            harness.os.write(keyboard, b'2')
            self.assertTrue(probe.wait(lambda: self.status().target.name == listed[1].name, 10.0))
            harness.os.write(keyboard, b'\x1b[C\x1b[C')      # right, twice: more of it
            centre = np.mean([style.values for style in listed], axis=0)
            more = centre + 1.2 * (np.array(listed[1].values) - centre)
            self.assertTrue(probe.wait(lambda: np.allclose(self.status().style.values, more), 10.0))
            harness.os.write(keyboard, b'0')
            self.assertTrue(probe.wait(lambda: np.allclose(self.status().style.values, centre), 10.0))
            harness.os.write(keyboard, b'q')
            self.assertTrue(probe.wait(lambda: slider.poll() is not None, 10.0))
            self.assertEqual(slider.returncode, 0)
        finally:
            slider.kill()
            slider.wait()
            harness.os.close(keyboard)
            harness.os.close(terminal)

    def test_02d_bad_styles_and_sequences_are_counted_and_change_nothing(self):
        probe, before = self.probe, self.status().target.values
        for bad in (StyleVector(name='nobody'), StyleVector(values=[float('nan')] * len(before)),
                    StyleVector(values=[0.0] * (len(before) + 1)), StyleVector()):
            self.style.publish(bad)
        for bad in (StateSequence(), StateSequence(states=[0], dwell_times=[1.0])):      # no style machine here
            self.sequence.publish(bad)
        for path in ('', '/absent.npz', str(Path(__file__))):
            answer = probe.call(LoadModel, 'load_model', path=path, timeout=20.0)
            self.assertFalse(answer.success)
            self.assertTrue(answer.message)
        for seconds in (-1.0, float('nan')):
            self.assertFalse(probe.call(SetStyle, 'set_style', style=StyleVector(name='mean'),
                                        transition_time=seconds).success)

        def told(key):
            heard = [status for message in probe.heard['/diagnostics'] for status in message.status]
            return {pair.key: pair.value for pair in heard[-1].values}.get(key) if heard else None
        self.assertTrue(probe.wait(lambda: told('style refused') == '4' and told('sequence refused') == '2', 8.0),
                        (told('style refused'), told('sequence refused')))
        np.testing.assert_array_equal(self.status().target.values, before)
        self.smooth(*self.collect(0.5))

    def test_03_speed_and_another_model_while_it_moves(self):
        probe = self.probe
        self.assertEqual(probe.set_parameters(speed=0.0), '')
        self.assertTrue(probe.wait(lambda: self.status().speed == 0.0, 5.0))
        probe.spin(0.7)     # what was left over from limits of the motors fades
        velocities = self.collect(0.4)[2]
        self.assertLess(np.abs(velocities).max(), 1e-6)
        self.assertEqual(probe.set_parameters(speed=1.0), '')
        self.assertTrue(probe.wait(lambda: self.status().speed == 1.0, 5.0))
        refused = probe.call(LoadModel, 'load_model', path='/absent.npz', timeout=20.0)
        self.assertFalse(refused.success)
        self.assertEqual(refused.model, 'locomotion')
        taken = probe.call(LoadModel, 'load_model', path='everyday.npz', timeout=20.0)
        self.assertTrue(taken.success, taken.message)
        self.assertEqual(taken.model, 'everyday')
        self.smooth(*self.collect(1.0))

    def test_04_action_computes_streams_and_cancels(self):
        probe = self.probe
        client = ActionClient(probe.node, Synthesize, '/synthesizer/synthesize')
        self.assertTrue(probe.wait(client.server_is_ready, 10.0))
        feedback = []

        def send(**fields):
            future = client.send_goal_async(Synthesize.Goal(**fields), feedback_callback=feedback.append)
            self.assertTrue(probe.wait(future.done, 10.0))
            return future.result()

        def result(handle, timeout=20.0):
            future = handle.get_result_async()
            self.assertTrue(probe.wait(future.done, timeout))
            return future.result()
        done = result(send(behaviour='locomotion', duration=2.0))
        self.assertEqual(done.status, GoalStatus.STATUS_SUCCEEDED, done.result.message)
        self.assertEqual(len(done.result.trajectory.points), 100)
        again = result(send(behaviour='locomotion', duration=2.0))
        self.assertEqual(done.result.trajectory, again.result.trajectory)
        refused = result(send(behaviour='flying'))
        self.assertEqual(refused.status, GoalStatus.STATUS_ABORTED)
        self.assertIn('flying', refused.result.message)
        for bad in ({'duration': float('nan')}, {'duration': -1.0}, {'speed': 9.0, 'duration': 1.0},
                    {'duration': 1.0, 'style': StyleVector(name='nobody')},
                    {'duration': 1.0, 'sequence': StateSequence(states=[0], dwell_times=[1.0])}):
            answer = result(send(**bad))
            self.assertEqual(answer.status, GoalStatus.STATUS_ABORTED, bad)
            self.assertTrue(answer.result.message)
        feedback.clear()
        jump = result(send(behaviour='jump', stream=True))
        self.assertTrue(jump.result.success, jump.result.message)
        self.assertGreater(len(feedback), 3)
        progress = [one.feedback.progress for one in feedback]
        self.assertTrue((np.diff(progress) >= 0).all() and progress[-1] > 0.5)
        last = jump.result.trajectory.points[-1]
        self.assertLess(np.abs(last.velocities).max(), 0.3)
        handle = send(behaviour='locomotion', duration=60.0, stream=True)
        second = send(behaviour='locomotion')
        self.assertFalse(second.accepted, 'two goals at a time')
        probe.spin(0.5)
        probe.wait(handle.cancel_goal_async().done, 5.0)
        self.assertEqual(result(handle).status, GoalStatus.STATUS_CANCELED)
        self.wait_state(STATES.PLAYING)     # what was performed before goes on
        client.destroy()

    def test_05_follow(self):
        probe = self.probe
        self.begin(model='everyday.npz', mode='follow', robot='exosuit6.yaml', style='')
        probe.spin(0.5)
        self.assertEqual(self.windows(), [], 'moved without a person')
        self.assertEqual(self.status().message, 'waits for estimates')
        message = StyleEstimate(model='everyday', status=StyleEstimate.TRACKING, phase_velocity=6.0,
                                behaviours=['locomotion', 'jump'], behaviour_probabilities=[0.9, 0.1])

        def person(seconds, status=StyleEstimate.TRACKING):
            start = probe.now()
            while probe.now() - start < seconds * 1e9:
                now = probe.now()
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
                message.phase, message.status = (6e-9 * now) % (2 * np.pi), status
                self.estimate.publish(message)
                probe.spin(0.01)
        person(1.0)
        self.windows().clear()
        person(1.0)
        self.assertGreater(len(self.windows()), 15)
        now = 6e-9 * stamp_of(self.status())
        self.assertLess(abs((self.status().phase - now + np.pi) % (2 * np.pi) - np.pi), 0.5)
        message.header.stamp.sec -= 1       # of the past: overtaken, not followed
        message.header.stamp.nanosec = 999_999_999
        message.phase = 0.0
        self.estimate.publish(message)
        for bad in ('phase', 'phase_velocity'):
            now = probe.now()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
            right = getattr(message, bad)
            setattr(message, bad, float('nan'))
            self.estimate.publish(message)
            probe.spin(0.02)
            setattr(message, bad, right)
        person(0.3, StyleEstimate.LOST)
        probe.heard['/diagnostics'].clear()
        self.assertTrue(probe.wait(lambda: probe.heard['/diagnostics'], 5.0))
        facts = {pair.key: pair.value for pair in probe.heard['/diagnostics'][-1].status[0].values}
        self.assertEqual((facts.get('estimates overtaken'), facts.get('estimate refused')), ('1', '2'))
        self.assertTrue(probe.wait(lambda: 'standing still' in self.status().message, 5.0))
        velocities = self.collect(0.4)[2]
        self.assertLess(np.abs(velocities).max(), 1e-3)
        person(1.0)
        self.assertTrue(probe.wait(lambda: self.status().message == '' or person(0.1), 5.0))

    def test_06_random_walk_and_sequence(self):
        probe = self.probe
        self.begin(model='locomotion_styles.npz', mode='random_walk', robot='exosuit6.yaml', seed=4)
        self.smooth(*self.collect(1.5), most=0.05)    # 60 frames a second, and steps of the foot in them
        self.assertEqual(probe.set_parameters(mode='sequence'), '')
        self.sequence.publish(StateSequence(states=[0, 1, 2], dwell_times=[0.3, 0.3, 0.3]))
        self.wait_state(STATES.FINISHED)
        probe.spin(0.5)
        self.windows().clear()
        probe.spin(0.3)
        self.assertEqual(self.windows(), [], 'goes on after the end')
        for bad in (StateSequence(), StateSequence(states=[9999], dwell_times=[0.3]),
                    StateSequence(states=[0], dwell_times=[float('nan')]),
                    StateSequence(n_states=3, occupancy=[1.0] * 4, step=0.1)):
            self.sequence.publish(bad)
        probe.spin(0.3)
        self.assertEqual(self.status().state, STATES.FINISHED)
        self.probe.heard['/diagnostics'].clear()
        self.assertTrue(probe.wait(lambda: probe.heard['/diagnostics'], 5.0))
        facts = {pair.key: pair.value for pair in probe.heard['/diagnostics'][-1].status[0].values}
        self.assertEqual(facts['sequence refused'], '4')

    def test_07_motion_file(self):
        path = Path('/tmp') / f'synthesizer_test_{harness.os.getpid()}.csv'
        write_motion(synthetic_gait(4.0)[0], path)
        try:
            self.begin(model='', mode='file', robot='humanoid20.yaml', file=str(path), loop=True)
            self.smooth(*self.collect(1.5))
            self.assertIn('no styles', self.probe.call(
                SetStyle, 'set_style', style=StyleVector(name='mean')).message + ' no styles')
            self.assertFalse(self.probe.call(SetStyle, 'set_style', style=StyleVector(name='mean')).success)
        finally:
            path.unlink()

    def test_08_parameters_are_checked_together(self):
        probe = self.probe
        for wrong in ({'mode': 'cycle'}, {'mode': 'dancing'}, {'speed': -1.0}, {'rate': 10.0}, {'blend_time': 0.0}):
            self.assertNotEqual(probe.set_parameters(**wrong), '', wrong)
        self.assertTrue(probe.transition('deactivate'))
        self.assertTrue(probe.transition('cleanup'))
        self.assertNotEqual(probe.set_parameters(step=0.5, horizon=0.4), '')
        self.assertNotEqual(probe.set_parameters(rate=2.0, horizon=0.4), '')


@launch_testing.post_shutdown_test()
class TestShutdown(unittest.TestCase):
    """The process ends by itself and cleanly."""

    def test_exit_codes(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info, allowable_exit_codes=[0, -2, 130])
