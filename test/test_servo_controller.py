"""What a joint_trajectory_controller makes of the bridge's messages, and of windows sent to it, in lock step."""
import numpy as np
import pytest
from controller_stand_in import SECOND, JointTrajectoryController, Message, Parameters, Point, Trajectory
from harness import ROOT, small_model
from lock_step import LockStep, Motion, chain_of, judge

from style_core.phase_style import load_behaviours
from style_core.predictor_file import read_predictor
from style_core.synthesis.performer import Performer, window_times
from style_core.synthesis.retargeting import read_robot
from style_core.synthesis.sources.phase_style import CycleSource
from style_core.synthetic import synthetic_people
from style_predictor.parameters import horizons_of

pytestmark = pytest.mark.no_middleware
CHAIN = chain_of()
SECONDS, SETTLED = 4.0, 1.5
CONTROLLERS = (100, 200, 500, 1000)
ROUNDING = 1e-5     # of times to nanoseconds


@pytest.fixture(scope='module')
def motion():
    return Motion(CHAIN, SECONDS + 1.0, seed=1)


def within_all_goals(found, acceleration=1.05):
    """Never still while it should move, near the motion, and within the limits."""
    assert found['still'] == 0.0
    assert found['error'] < 0.01
    assert found['speed'] <= 1.05 and found['acceleration'] <= acceleration, found


# --- the stand-in is what the controller's source says ---------------------------------------------------------------

def trajectory(stamp, *points, before=0.0, now=SECOND):
    one = Trajectory()
    one.update(Message(stamp, ['a'], [Point(round(t * SECOND), *map(np.atleast_1d, values)) for t, *values in points]))
    one.set_point_before(now, Point(0, np.atleast_1d(before)))
    return one


def test_a_message_whose_first_point_lies_ahead_stands_still_at_its_first_sample():
    one = trajectory(0, (0.01, 1.0, 2.0), (0.1, 1.1, 0.0), before=0.5)
    assert one.sample(SECOND)[0].positions == 0.5
    # and the next sample counts from that first one, from rest
    assert 0.5 < one.sample(SECOND + SECOND // 200)[0].positions < 1.0


def test_the_degree_of_a_segment_follows_from_what_both_its_ends_have():
    ends = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0))
    quarter = SECOND + SECOND // 4
    assert trajectory(SECOND, *(e[:2] for e in ends)).sample(quarter)[0].positions == 0.25
    assert trajectory(SECOND, *(e[:3] for e in ends)).sample(quarter)[0].positions == 0.15625
    assert trajectory(SECOND, *ends).sample(quarter)[0].positions == pytest.approx(0.103515625)
    assert trajectory(SECOND, ends[0][:2], ends[1][:3]).sample(quarter)[0].positions == 0.25


def test_a_window_that_ends_moving_stands_still_after_its_end():
    one = trajectory(SECOND, (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
    assert one.sample(3 * SECOND)[0].positions == 1.0


def test_what_the_controller_refuses():
    controller = JointTrajectoryController(Parameters(['a', 'b'], allow_nonzero_velocity_at_trajectory_end=False))
    controller.activate(np.zeros(2))

    def refused(message, word):
        assert not controller.on_message(message, 10 * SECOND)
        assert word in controller.log[-1]
    good = Point(SECOND, np.zeros(2))
    refused(Message(0, ['a'], [Point(0, np.zeros(1))]), 'match')
    refused(Message(0, ['a', 'c'], [good]), 'match')
    refused(Message(0, ['a', 'b'], []), 'Empty')
    refused(Message(SECOND, ['a', 'b'], [good]), 'in the past')
    refused(Message(0, ['a', 'b'], [Point(0, np.zeros(2), np.ones(2))]), 'not zero')
    refused(Message(0, ['a', 'b'], [good, good]), 'increasing')
    assert controller.on_message(Message(0, ['b', 'a'], [Point(0, np.array([1.0, 2.0]))]), 0)
    np.testing.assert_array_equal(controller.update(11 * SECOND, np.zeros(2)), [2.0, 1.0])


def test_a_goal_ends_as_its_motion_does():
    controller = JointTrajectoryController(Parameters(['a'], trajectory=0.1, goal=0.05, goal_time=0.5))
    controller.activate(np.zeros(1))

    def goal():
        return controller.on_goal(Message(0, ['a'], [Point(0, np.zeros(1)), Point(SECOND, np.ones(1))]), 0)
    first, second = goal(), goal()
    assert first.status == 'canceled' and second.status == 'executing'
    controller.update(SECOND, np.zeros(1))
    controller.update(SECOND + SECOND // 2, np.zeros(1))
    assert (second.status, second.error) == ('aborted', -4)
    third = goal()
    controller.update(2 * SECOND, np.zeros(1))
    controller.update(3 * SECOND, np.array([0.97]))
    assert third.status == 'succeeded'
    fourth = goal()
    controller.update(4 * SECOND, np.zeros(1))
    controller.update(5 * SECOND, np.array([0.92]))
    assert fourth.status == 'executing'
    controller.update(6 * SECOND, np.array([0.92]))
    assert (fourth.status, fourth.error) == ('aborted', -5)


# --- the bridge's messages -------------------------------------------------------------------------------------------

@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
@pytest.mark.parametrize('controller_hz', CONTROLLERS)
@pytest.mark.parametrize('bridge_hz', [100, 200])
def test_a_motion_at_the_limits_is_followed(bridge_hz, controller_hz, goal_rate, motion):
    step = LockStep(CHAIN, bridge_hz, controller_hz, goal_rate).run(SECONDS, motion)
    within_all_goals(judge(step, motion, SETTLED))
    assert not step.reasons
    if goal_rate:
        assert step.goals <= 1.1 * goal_rate * SECONDS


@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
def test_half_a_minute_at_the_limits_without_a_false_fault(goal_rate):
    long = Motion(CHAIN, 31.0, seed=2)
    step = LockStep(CHAIN, 100, 200, goal_rate).run(30.0, long)
    within_all_goals(judge(step, long, SETTLED))
    assert not step.reasons and step.bridge.counts['rejected'] == 0


@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
@pytest.mark.parametrize('controller_hz', [200, 1000])
def test_an_emergency_stop_brakes_within_the_limits(controller_hz, goal_rate, motion):
    when = 2.5131
    step = LockStep(CHAIN, 200, controller_hz, goal_rate)
    step.run(3.0, motion, during={when: lambda: step.bridge.estop(step.seconds)})
    found = judge(step, motion, SETTLED)
    assert found['speed'] <= 1.0 + ROUNDING and found['acceleration'] <= 1.0 + ROUNDING, found
    # at rest after the lead, two cycles and the time that braking takes
    stopped = when + step.backend.lead + 2 / 200 + 4.0 / 40.0 + 0.01
    after = np.array(step.commands)[np.array(step.times) > stopped]
    assert np.ptp(after, axis=0).max() == 0.0


@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
def test_messages_and_ticks_that_come_late_are_not_felt(goal_rate, motion):
    rng = np.random.default_rng(0)
    step = LockStep(CHAIN, 200, 1000, goal_rate, transport=lambda: rng.uniform(0.0005, 0.003),
                    lateness=lambda: 0.04 if rng.random() < 0.01 else rng.uniform(0.0, 0.002))
    within_all_goals(judge(step.run(SECONDS, motion), motion, SETTLED))


@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
def test_a_bridge_that_is_late_beyond_its_plan_goes_on_within_the_limits(goal_rate, motion):
    rng = np.random.default_rng(0)
    step = LockStep(CHAIN, 200, 1000, goal_rate, lateness=lambda: 0.3 if rng.random() < 0.01 else 0.0)
    found = judge(step.run(SECONDS, motion), motion, 0.0)
    assert found['speed'] <= 1.0 + ROUNDING and found['acceleration'] <= 1.0 + ROUNDING, found
    assert found['still'] > 0       # it has stopped meanwhile


@pytest.mark.parametrize('goal_rate', [None, 20.0], ids=['topic', 'action'])
def test_the_controller_stops_by_itself_within_the_limits_where_the_bridge_dies(goal_rate, motion):
    when = 2.5131
    step = LockStep(CHAIN, 200, 1000, goal_rate)
    step.run(3.0, motion, during={when: lambda: setattr(step.bridge, 'tick', lambda now: 0)})
    found = judge(step, motion, SETTLED)
    assert found['speed'] <= 1.0 + ROUNDING and found['acceleration'] <= 1.0 + ROUNDING, found
    longest = 0.05 + (1 / 20.0 if goal_rate else 0.0) + step.backend.lead + 4.0 / 40.0 + 0.02
    after = np.array(step.commands)[np.array(step.times) > when + longest]
    assert np.ptp(after, axis=0).max() == 0.0


def test_a_controller_that_measures_where_a_motion_starts_follows_as_well(motion):
    step = LockStep(CHAIN, 200, 200, controller={'open_loop_control': False}).run(SECONDS, motion)
    within_all_goals(judge(step, motion, SETTLED))
    step = LockStep(CHAIN, 200, 200, controller={'open_loop_control': True}).run(SECONDS, motion)
    within_all_goals(judge(step, motion, SETTLED))


def test_tolerances_and_time_outs_of_the_controller_are_kept(motion):
    step = LockStep(CHAIN, 200, 200, 20.0, controller={'trajectory': 0.05, 'goal': 0.02, 'goal_time': 0.2,
                                                       'cmd_timeout': 0.5,
                                                       'allow_nonzero_velocity_at_trajectory_end': False})
    step.run(SECONDS, motion)
    within_all_goals(judge(step, motion, SETTLED))
    assert not step.controller.log and not step.reasons


# --- windows straight to the controller ------------------------------------------------------------------------------

@pytest.mark.parametrize('controller_hz', CONTROLLERS)
def test_windows_that_begin_at_time_0_are_followed(controller_hz, motion):
    step = LockStep(CHAIN, 200, controller_hz).run(SECONDS, motion, straight=True)
    # the cubics between points round off where the motion changes its acceleration between them
    within_all_goals(judge(step, motion, 0.1), acceleration=1.5)


def test_windows_that_begin_later_would_not_be(motion):
    step = LockStep(CHAIN, 200, 200).run(SECONDS, motion, straight=True, first=1 / 60)
    assert judge(step, motion, 0.1)['still'] > 0.2


def driven_by(windows, names, controller_hz, latency=0.004):
    """Commands of a controller, one row an update, that gets windows ((time, ahead, positions, velocities), ...)."""
    controller = JointTrajectoryController(Parameters(list(names)))
    waiting, commands, times = list(windows), [], []
    begin, position = waiting[0][0] + latency, waiting[0][2][0]
    controller.activate(position)
    for k in range(int((waiting[-1][0] - begin) * controller_hz)):
        now = begin + k / controller_hz
        while waiting and waiting[0][0] + latency <= now:
            time, ahead, positions, velocities = waiting.pop(0)
            assert controller.on_message(Message(round((100 + time) * SECOND), list(names), [
                Point(round(t * SECOND), p, v) for t, p, v in zip(ahead, positions, velocities)]),
                round((100 + now) * SECOND))
        position = controller.update(round((100 + now) * SECOND), position)
        commands.append(position)
        times.append(now)
    return np.array(times), np.array(commands)


@pytest.mark.parametrize('controller_hz', CONTROLLERS)
def test_the_synthesizers_windows_keep_the_controller_moving_within_the_motors_limits(controller_hz):
    config = ROOT / 'config'
    robot = read_robot(config / 'robots' / 'humanoid20.yaml')
    behaviours = load_behaviours(config / 'models' / 'locomotion.npz')
    performer = Performer(CycleSource(behaviours[0]), robot)
    ahead, windows = window_times(1 / 60, 0.4), []
    for k in range(120):
        windows.append((k / 60, ahead, *performer.window(ahead)))
        performer.advance(1 / 60)
    names = performer.joint_names
    _, commands = driven_by(windows, names, controller_hz)
    speed = np.abs(np.diff(commands, axis=0)) * controller_hz
    # a joint that moves before and after an update moves in it
    moving = np.minimum(speed[:-2], speed[2:]) > 0.3
    assert moving.any() and not np.any(speed[1:-1][moving] == 0.0)
    most = np.array([robot.joints[name].velocity for name in names])
    assert np.all(speed <= 1.05 * most)


@pytest.mark.parametrize('controller_hz', CONTROLLERS)
def test_the_predictors_windows_keep_the_controller_moving(controller_hz):
    person = synthetic_people(1, seed=5, duration_s=5.0)[0]
    predictor = read_predictor(small_model()).predictor
    ahead, windows = horizons_of({'step': 1 / 60, 'horizon': 0.4}), []
    poses = person.joints(predictor.joint_names).positions
    for time, pose in zip(person.times, poses):
        predictor.update(time, pose)
        found = predictor.predict(ahead)
        windows.append((time, ahead, found.mean.copy(), found.velocity.copy()))
    settled = 120
    times, commands = driven_by(windows[settled:], predictor.joint_names, controller_hz)
    speed = np.abs(np.diff(commands, axis=0)) * controller_hz
    moving = np.minimum(speed[:-2], speed[2:]) > 0.5
    assert moving.any() and not np.any(speed[1:-1][moving] == 0.0)
    truth = np.stack([np.interp(times, person.times, column) for column in poses.T], axis=1)
    # the noise of the sensors is 0.01 rad; the command is where the person is now, not one window ago
    assert np.sqrt(np.mean((commands - truth) ** 2)) < 0.02
