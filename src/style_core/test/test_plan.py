"""Plans: what comes next is what would come, and between commands every limit holds."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import UsageError
from style_core.follow.limiter import Limiter
from style_core.follow.plan import Foresight, knots
from style_core.follow.playback import Playback, make_track

JOINTS, PERIOD = 3, 0.005
VELOCITY, ACCELERATION = np.array([4.0, 2.0, 1.0]), np.array([40.0, 60.0, 5.0])


def limiter():
    one = Limiter(-np.ones(JOINTS), np.ones(JOINTS), VELOCITY, ACCELERATION, np.full(JOINTS, 5.0), PERIOD)
    one.reset(np.zeros(JOINTS))
    return one


def random_commands(rng, count, one):
    """Commands of a limiter whose targets jump about."""
    found, target = [one.position.copy()], np.zeros(JOINTS)
    for _ in range(count):
        if rng.random() < 0.1:
            target = rng.uniform(-1.2, 1.2, JOINTS)
        found.append(one.step(target, rng.normal(0, 1, JOINTS)).copy())
    return np.array(found)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_position_velocity_and_acceleration_hold_between_commands(seed):
    one = limiter()
    commands = random_commands(np.random.default_rng(seed), 200, one)
    commands = np.vstack([commands, one.foresee(np.empty((0, JOINTS)), np.empty((0, JOINTS)), 1)])
    times, positions, velocities = knots(commands, PERIOD)
    assert np.all(np.abs(positions) <= 1.0) and np.all(np.abs(velocities) <= VELOCITY)
    span = np.diff(times)[:, None]
    # the cubic between two knots has no third power: the mean velocity is the mean of both ends
    np.testing.assert_allclose(np.diff(positions, axis=0), 0.5 * span * (velocities[1:] + velocities[:-1]), atol=1e-12)
    assert np.all(np.abs(np.diff(velocities, axis=0)) <= ACCELERATION * span * (1 + 1e-9))
    np.testing.assert_array_equal(velocities[-1], 0.0)
    np.testing.assert_array_equal(positions[-1], commands[-1])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_knots_left_out_lie_on_the_curve(seed):
    commands = random_commands(np.random.default_rng(seed), 60, limiter())
    times, positions, velocities = knots(commands, PERIOD)
    steps = np.diff(commands, axis=0)
    for j, step in enumerate(steps):
        moment = (j + 0.5) * PERIOD
        k = min(int(np.searchsorted(times, moment + 1e-9, side='right')) - 1, len(times) - 2)
        rate = (velocities[k + 1] - velocities[k]) / (times[k + 1] - times[k])
        into = moment - times[k]
        np.testing.assert_allclose(velocities[k] + into * rate, step / PERIOD, atol=1e-9)
        np.testing.assert_allclose(positions[k] + into * (velocities[k] + 0.5 * into * rate),
                                   commands[j] + 0.5 * step, atol=1e-9)


def test_standing_takes_two_knots():
    times, positions, velocities = knots(np.zeros((50, JOINTS)), PERIOD)
    assert len(times) == 2 and not positions.any() and not velocities.any()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 20))
def test_what_is_foreseen_is_what_comes_and_changes_nothing(seed, count):
    rng, one = np.random.default_rng(seed), limiter()
    random_commands(rng, 50, one)
    targets, rates = rng.uniform(-1.5, 1.5, (count, JOINTS)), rng.normal(0, 1, (count, JOINTS))
    counts = one.counts.copy()
    foreseen = one.foresee(targets, rates, 5)
    np.testing.assert_array_equal(counts, one.counts)
    assert len(foreseen) >= max(count, 5)
    for k, position in enumerate(foreseen):
        np.testing.assert_array_equal(one.step(targets[k], rates[k]) if k < count else one.brake(), position)
    assert one.stopped


def test_targets_of_another_shape_are_refused():
    with pytest.raises(UsageError, match='3 joints'):
        limiter().foresee(np.zeros((2, 2)), np.zeros((2, 2)), 1)


def test_a_plan_runs_through_past_and_coming_commands_in_time():
    one, playback = limiter(), Playback(JOINTS, VELOCITY, ACCELERATION)
    playback.hold(np.zeros(JOINTS))
    times = np.linspace(0.0, 2.0, 41)
    wave = 0.1 * np.sin(2 * times)[:, None] * np.ones(JOINTS), 0.2 * np.cos(2 * times)[:, None] * np.ones(JOINTS)
    track = make_track(times, *wave, start=0.0, now=0.0, current=(np.zeros(JOINTS), np.zeros(JOINTS)))
    playback.ramp_in(track, 0.0, 0.1, 0.5, np.zeros(JOINTS), np.zeros(JOINTS), np.zeros(JOINTS))
    foresight = Foresight(one, playback, 0.0125)
    foresight.begin()
    said = {}
    for k in range(1, 200):
        time = k * PERIOD
        one.step(*playback.sample(time))
        foresight.note()
        plan = foresight.plan(time, 10, True)
        assert plan[0][0] <= time - 0.0125 - 0.01 + PERIOD and plan[0][-1] >= time + 9 * PERIOD
        # every plan says of a moment what the one before said
        for moment in (time, time + 5 * PERIOD):
            i = int(np.searchsorted(plan[0], moment, side='right')) - 1
            into = moment - plan[0][i]
            bend = (plan[2][i + 1] - plan[2][i]) / (plan[0][i + 1] - plan[0][i])
            there = plan[1][i] + into * (plan[2][i] + 0.5 * into * bend)
            np.testing.assert_allclose(there, said.setdefault(round(moment / PERIOD), there), atol=1e-9)
    np.testing.assert_allclose(foresight.due(), 0.1 * np.sin(2 * (199 * PERIOD - 0.01)), atol=2e-3)
