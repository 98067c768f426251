"""Interpolation between points and replacement of what plays."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline, PchipInterpolator

from style_core.errors import MotionError
from style_core.follow.playback import Playback, make_track

REST = np.zeros(3), np.zeros(3)


def points(seed, k=8, d=3):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.01, 0.3, k))
    return times, rng.normal(size=(k, d)), rng.normal(size=(k, d)), rng.normal(size=(k, d))


def values(track, times):
    return np.array([track.at(t) for t in times]).swapaxes(0, 1)


def test_cubics_equal_scipys_hermite_spline():
    times, p, v, _ = points(0)
    track = make_track(times, p, v, start=times[0], now=0.0, current=REST)
    at = np.linspace(times[0], times[-1], 300)
    position, velocity = values(track, at)
    reference = CubicHermiteSpline(times, p, v)
    np.testing.assert_allclose(position, reference(at), atol=1e-12)
    np.testing.assert_allclose(velocity[:-1], reference(at, 1)[:-1], atol=1e-9)


def test_quintics_equal_scipys_bernstein_polynomials():
    times, p, v, a = points(1)
    track = make_track(times, p, v, a, start=times[0], now=0.0, current=REST)
    at = np.linspace(times[0], times[-1], 300)
    reference = BPoly.from_derivatives(times, np.stack([p, v, a], axis=1))
    np.testing.assert_allclose(values(track, at)[0], reference(at), atol=1e-9)


def test_points_without_velocities_do_not_overshoot():
    times, p, _, _ = points(2, k=12)
    track = make_track(times, p, start=times[0], now=0.0, current=REST)
    at = np.linspace(times[0], times[-1], 500)
    position, _ = values(track, at)
    np.testing.assert_allclose(position[:, 0][20:-40], PchipInterpolator(times, p)(at)[:, 0][20:-40], atol=0.2)
    k = np.clip(np.searchsorted(times, at) - 1, 0, len(times) - 2)
    low, high = np.minimum(p[k], p[k + 1]), np.maximum(p[k], p[k + 1])
    assert np.all((position >= low - 1e-9) & (position <= high + 1e-9))


def test_a_single_point_in_the_future_is_approached_from_the_current_state():
    track = make_track([2.0], [[1.0, 2.0, 3.0]], start=0.0, now=0.0, current=(np.ones(3), 0.5 * np.ones(3)))
    np.testing.assert_allclose(track.at(0.0)[0], 1.0)
    np.testing.assert_allclose(track.at(0.0)[1], [0.0, 0.5, 0.5])       # 0: it would overshoot otherwise
    path = values(track, np.linspace(0.0, 2.0, 100))[0]
    assert np.all(np.diff(path, axis=0) >= 0)
    np.testing.assert_allclose(track.at(2.0)[0], [1, 2, 3])


def test_a_track_that_ends_moving_coasts_to_rest():
    track = make_track([0.0, 1.0], [[0.0], [1.0]], [[1.0], [1.0]], start=0.0, now=0.0,
                       current=(np.zeros(1), np.zeros(1)), coast=0.2)
    assert track.end == pytest.approx(1.2)
    before, after = track.at(1.0 - 1e-9), track.at(1.0 + 1e-9)
    np.testing.assert_allclose(before, after, atol=1e-6)
    np.testing.assert_allclose(track.at(1.2)[0], 1.1)
    assert track.at(5.0)[1] == 0 and track.at(5.0)[0] == pytest.approx(1.1)


@pytest.mark.parametrize('times, positions, velocities, message', [
    ([], np.zeros((0, 3)), None, 'fit'), ([1.0, 1.0], np.zeros((2, 3)), None, 'increase'),
    ([2.0, 1.0], np.zeros((2, 3)), None, 'increase'), ([1.0, np.nan], np.zeros((2, 3)), None, 'finite'),
    ([1.0], [[np.inf, 0, 0]], None, 'finite'), ([1.0], [[1e300, 0, 0]], None, 'large'),
    ([1.0], [[0.0, 0, 0]], [[np.nan, 0, 0]], 'finite'), ([1.0], [[0.0, 0, 0]], np.zeros((2, 3)), 'fit'),
    ([-2.0, -1.0], np.zeros((2, 3)), None, 'ago')])
def test_impossible_points_are_refused(times, positions, velocities, message):
    with pytest.raises(MotionError, match=message):
        make_track(times, positions, velocities, start=0.0, now=0.0, current=REST)


@given(seed=st.integers(0, 2**32 - 1), shortest=st.floats(0.02, 0.5))
@settings(max_examples=20, deadline=None)
def test_replacement_at_any_moment_is_continuous_in_position_and_velocity(seed, shortest):
    """The largest step in the reference's velocity stays what its accelerations explain, also mid-decay."""
    rng = np.random.default_rng(seed)
    player = Playback(3, np.full(3, 4.0), np.full(3, 30.0))
    player.hold(np.zeros(3))
    h = 2e-4
    now, switches = 0.0, np.sort(rng.uniform(0.05, 1.2, 6))
    player.take_over(sine(rng, 0.0), 0.0, shortest)
    past = []
    for switch in np.append(switches, 1.5):
        while now < switch:
            player.sample(now)
            past.append((player.position.copy(), player.velocity.copy()))
            now += h
        player.take_over(sine(rng, now), now, shortest)
    position, velocity = np.array(past).swapaxes(0, 1)
    # an offset of 1 rad over the shortest decay, and the sines: accelerations below 1e4 rad/s^2 everywhere
    assert np.max(np.abs(np.diff(velocity, axis=0))) < 1e4 * h
    np.testing.assert_allclose(np.diff(position, axis=0), h * velocity[:-1], atol=1e4 * h * h)


def sine(rng, now):
    times = now + np.linspace(0, 2, 80)
    frequency, amplitude, phase = rng.uniform(1, 6, 3), rng.uniform(0.1, 0.5, 3), rng.uniform(0, 6, 3)
    angle = frequency * times[:, None] + phase
    return make_track(times, amplitude * np.sin(angle), amplitude * frequency * np.cos(angle), start=now, now=now,
                      current=REST)


def test_the_decay_ends_on_the_new_track():
    rng = np.random.default_rng(4)
    player = Playback(3, np.full(3, 4.0), np.full(3, 30.0))
    player.hold(np.array([1.0, -1.0, 0.5]))
    track = sine(rng, 0.0)
    duration = player.take_over(track, 0.0, 0.1)
    assert duration >= 1.875 * np.max(np.abs(np.array([1.0, -1.0, 0.5]) - track.at(0.0)[0])) / 4.0
    player.sample(0.0)
    np.testing.assert_allclose(player.position, [1.0, -1.0, 0.5], atol=1e-12)
    player.sample(duration)
    np.testing.assert_allclose(player.position, track.at(duration)[0], atol=1e-12)


def test_windows_of_one_motion_sent_over_and_over_change_nothing():
    """A receding horizon whose windows agree plays as the motion itself."""
    rng = np.random.default_rng(5)
    motion = sine(rng, 0.0)
    player = Playback(3, np.full(3, 4.0), np.full(3, 30.0))
    player.hold(motion.at(0.0)[0])
    worst = 0.0
    for k in range(150):
        now = 0.005 * k
        if k % 2 == 0:
            current = player.sample(now)
            times = now + np.linspace(0, 0.3, 25)
            p, v = values(motion, times)
            player.take_over(make_track(times, p, v, start=now, now=now, current=current), now, 0.05)
        player.sample(now)
        if now > 0.4:       # the ramp from standing is over
            worst = max(worst, np.max(np.abs(player.position - motion.at(now)[0])))
    assert worst < 1e-5


@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0.05, 1.0), shortest=st.floats(0.01, 1.0),
       moving=st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_ramp_stays_between_posture_and_motion_and_below_its_stated_speeds(seed, speed, shortest, moving):
    rng = np.random.default_rng(seed)
    limit_v, limit_a = rng.uniform(1, 6, 3), rng.uniform(10, 80, 3)
    times = 5.0 + np.linspace(0, 30, 1500)
    # a motion within the limits, of three sines
    frequency = rng.uniform(0.5, 12, (3, 3))
    weight = rng.dirichlet(np.ones(3), 3).T
    amplitude = weight * np.minimum(limit_v / frequency, limit_a / frequency**2)
    angle = frequency * times[:, None, None] + rng.uniform(0, 6, (3, 3))
    track = make_track(times, (amplitude * np.sin(angle)).sum(axis=1),
                       (amplitude * frequency * np.cos(angle)).sum(axis=1), start=times[0], now=times[0], current=REST)
    player = Playback(3, limit_v, limit_a)
    position = rng.uniform(-1.5, 1.5, 3)
    velocity = rng.uniform(-1, 1, 3) * limit_v if moving else np.zeros(3)
    rest = position + np.sign(velocity) * velocity**2 / (2 * limit_a)
    begin = 5.0 + rng.uniform(0, 5)
    duration = player.ramp_in(track, begin, shortest, speed, position, velocity, rest)
    at = np.append(np.linspace(begin, begin + duration, 800), begin + duration + 0.1)
    reference = np.array([[array.copy() for array in player.sample(t)] for t in at]).swapaxes(0, 1)
    motion = values(track, at)[0]
    np.testing.assert_allclose(reference[0][0], position, atol=1e-12)
    np.testing.assert_allclose(reference[1][0], velocity, atol=1e-9)
    np.testing.assert_allclose(reference[0][-1], motion[-1], atol=1e-12)
    low, high = np.minimum(np.minimum(position, rest), motion), np.maximum(np.maximum(position, rest), motion)
    assert np.all((low - 1e-12 <= reference[0]) & (reference[0] <= high + 1e-12))
    # velocities are those of the positions
    step = at[1] - at[0]
    mean = 0.5 * (reference[1][1:-1] + reference[1][:-2])
    np.testing.assert_allclose(np.diff(reference[0][:-1], axis=0), step * mean,
                               atol=20 * step**2 * limit_a.max() + 1e-9)
    if not moving:
        assert np.all(np.abs(reference[1]) <= (1.78 + speed) * limit_v * 1.01)
        bend = np.diff(reference[1][:-1], axis=0) / step
        assert np.all(np.abs(bend) <= (2.41 + 2 * speed) * limit_a * 1.02)


def test_a_trajectory_that_begins_at_the_posture_is_played_as_it_is():
    track = make_track([0.0, 0.5, 1.0], [[0.0], [0.5], [0.6]], start=0.0, now=0.0, current=(np.zeros(1), np.zeros(1)))
    player = Playback(1, [4.0], [30.0])
    assert player.ramp_in(track, 0.0, 2.0, 0.3, np.zeros(1), np.zeros(1), np.zeros(1)) == 0.0
    for t in np.linspace(0, 1, 50):
        np.testing.assert_array_equal(player.sample(t)[0], track.at(t)[0])


def test_a_first_point_too_near_in_time_is_met_as_a_moving_one():
    """The way there would need 50 rad/s: the track runs through its first point instead, as if it came from before."""
    here = np.zeros(1), np.zeros(1)
    within = np.array([4.0]), np.array([30.0])
    track = make_track([0.02, 0.5], [[0.5], [0.6]], [[1.0], [0.0]], start=0.0, now=0.0, current=here, within=within)
    np.testing.assert_allclose(track.at(0.0)[0], 0.48)
    np.testing.assert_allclose(track.at(0.01), [[0.49], [1.0]])
    # more than the coasting time ahead: it waits at rest before
    track = make_track([0.2, 0.5], [[1.5], [1.6]], [[1.0], [0.0]], start=0.0, now=0.0, current=here, within=within)
    np.testing.assert_allclose(track.at(0.0), [[1.45], [0.0]])
    np.testing.assert_allclose(track.at(0.2), [[1.5], [1.0]])
    # time enough: from where the joint is
    track = make_track([1.0], [[0.5]], start=0.0, now=0.0, current=here, within=within)
    np.testing.assert_allclose(track.at(0.0), [[0.0], [0.0]])


def test_a_contradiction_in_velocity_does_not_throw_the_reference_about():
    """One window claims 1000 rad/s at the posture that plays; the next is right again."""
    player = Playback(1, [4.0], [40.0])
    here = np.zeros(1), np.zeros(1)
    still = make_track([0.0, 9.0], [[0.0], [0.0]], [[0.0], [0.0]], start=0.0, now=0.0, current=here)
    player.take_over(still, 0.0, 0.06)
    player.take_over(make_track([1.0, 1.3], [[0.0], [0.0]], [[1000.0], [0.0]], start=1.0, now=1.0, current=here),
                     1.0, 0.06)
    player.sample(1.0)
    player.take_over(still, 1.0, 0.06)
    path = [player.sample(t)[0][0] for t in np.linspace(1.0, 3.0, 500)]
    assert np.ptp(path) < 1.0 and path[-1] == 0.0
