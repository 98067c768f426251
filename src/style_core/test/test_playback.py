"""Interpolation between points and replacement of what plays."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline, PchipInterpolator

from style_core.errors import MotionError
from style_core.live.playback import Playback, make_track

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
    np.testing.assert_allclose(track.at(0.0)[1], 0.5)
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
