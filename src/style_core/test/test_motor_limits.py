"""Windows within the limits of motors: exact limits, nearest motion, nothing where nothing is needed, continuous."""
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from style_core.phase_style import load_behaviours
from style_core.synthesis.motor_limits import RETURN_S, SHARE, MotorLimits
from style_core.synthesis.performer import Performer, window_times
from style_core.synthesis.retargeting import read_robot
from style_core.synthesis.sources.phase_style import CycleSource

CONFIG = Path(__file__).resolve().parents[3] / 'config'
AHEAD = window_times(0.02, 0.4)


def one_joint(velocity=4.0, acceleration=40.0, lower=-np.inf, upper=np.inf):
    return MotorLimits(*(np.array([x], dtype=float) for x in (lower, upper, velocity, acceleration)))


def wave(amplitude, frequency, phase=0.0):
    """Position and velocity of a sine as functions of time."""
    turn = 2 * np.pi * frequency
    return (lambda t: amplitude * np.sin(turn * t + phase)[:, None],
            lambda t: amplitude * turn * np.cos(turn * t + phase)[:, None])


def stream(limits, position, velocity, seconds=2.0, seed=0):
    """Windows at random times; (times, what was foreseen before each, windows)."""
    rng, now, foreseen, out = np.random.default_rng(seed), 0.0, None, []
    while now < seconds:
        times = now + AHEAD - AHEAD[0]
        window = limits.window(AHEAD, position(times), velocity(times))
        out.append((now, foreseen, window))
        dt = rng.uniform(0.001, 0.03)
        now += dt
        limits.advance(0.4 * dt)
        limits.advance(0.6 * dt)
        at = np.array([now])
        foreseen = limits.at(np.zeros(1), position(at), velocity(at))
    return out


@given(st.floats(0.0, 2.0), st.floats(0.1, 4.0), st.floats(0, 6), st.floats(1.0, 8.0), st.floats(10.0, 100.0),
       st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_limits_are_exact_and_windows_continuous(amplitude, frequency, phase, velocity, acceleration, seed):
    limits = one_joint(velocity, acceleration)
    steps = np.diff(AHEAD)[:, None]
    for _, foreseen, (q, v) in stream(limits, *wave(amplitude, frequency, phase), seed=seed):
        assert np.abs(v).max() <= SHARE * velocity + 1e-9
        # motors that can do it are left alone: then the bend between points is that of the motion
        assert np.abs(np.diff(v, axis=0) / steps).max() <= SHARE * acceleration + 3.0
        if foreseen is not None:
            assert abs(foreseen[0] - q[:1]) < 1e-6
            assert abs(foreseen[1] - v[:1]) < 0.02 * velocity


@given(st.floats(0.1, 2.0), st.floats(0.1, 4.0), st.floats(0.3, 0.95), st.integers(0, 999))
@settings(max_examples=25, deadline=None)
def test_positions_stay_inside_their_limits(amplitude, frequency, part, seed):
    """Also where braking as hard as allowed is what keeps the joint inside."""
    bound = part * amplitude
    limits = one_joint(lower=-bound, upper=bound)
    position, velocity = wave(amplitude, frequency)

    def cut(t):
        return np.clip(position(t), -bound, bound)

    def cut_velocity(t):
        return np.where(np.abs(position(t)) < bound, velocity(t), 0.0)
    for _, _, (q, v) in stream(limits, cut, cut_velocity, seed=seed):
        assert np.abs(q).max() <= bound
        assert np.abs(v).max() <= SHARE * 4.0 + 1e-9


def test_what_motors_can_do_is_left_as_it_is():
    limits = one_joint()
    position, velocity = wave(0.5, 1.0)
    for now, _, (q, v) in stream(limits, position, velocity):
        np.testing.assert_array_equal(q, position(now + AHEAD - AHEAD[0]))
        np.testing.assert_array_equal(v, velocity(now + AHEAD - AHEAD[0]))
    assert limits.settled and not limits.take_most().any()
    free = one_joint(np.inf, np.inf)
    q = np.random.default_rng(0).normal(size=(len(AHEAD), 1))
    assert free.window(AHEAD, q, 100 * q)[0] is q


@pytest.mark.parametrize('amplitude, frequency, phase, velocity, acceleration',
                         [(0.8, 1.5, 0.0, 4.0, 40.0), (0.6, 2.0, 1.0, 4.5, 60.0), (1.5, 0.8, 2.0, 4.0, 1e9),
                          (0.3, 2.5, 4.0, 1e9, 30.0)])
def test_the_motion_is_the_nearest(amplitude, frequency, phase, velocity, acceleration):
    """Against a general solver of scipy."""
    limits, (position, rate) = one_joint(velocity, acceleration), wave(amplitude, frequency, phase)
    r, v = position(AHEAD), rate(AHEAD)
    q, u = (x[:, 0] for x in limits.window(AHEAD, r, v))
    steps, r, v = np.diff(AHEAD), r[:, 0], v[:, 0]
    scale = RETURN_S**2

    def cost(rest):
        rates = np.concatenate([u[:1], rest])
        way = np.concatenate([[0.0], np.cumsum(0.5 * steps * (rates[1:] + rates[:-1]))])
        return 100 * (np.sum((q[0] + way - r)**2) + np.sum((scale * np.diff(rates - v) / steps)**2))
    most, bend = SHARE * velocity, SHARE * acceleration
    best = minimize(cost, np.clip(v[1:], -most, most), method='SLSQP', bounds=[(-most, most)] * len(steps),
                    constraints={'type': 'ineq', 'fun': lambda x: np.concatenate([
                        bend - np.diff(x, prepend=u[0]) / steps, bend + np.diff(x, prepend=u[0]) / steps])},
                    options={'maxiter': 1000, 'ftol': 1e-10})
    assert best.success
    assert cost(u[1:]) <= 1.01 * best.fun + 1e-6
    assert np.abs(q - r).max() > 0.02, 'nothing to do'


def test_a_deviation_is_given_up_and_reported():
    limits = one_joint()
    position, velocity = wave(1.0, 1.5)

    def until(t):
        return np.where(t < 1.0, t, 1.0)
    out = stream(limits, lambda t: position(until(t)), lambda t: velocity(t) * (t < 1.0)[:, None], 3.0)
    assert limits.take_most()[0] > 0.1
    assert not limits.take_most()[0]
    np.testing.assert_allclose(out[-1][2][0], position(np.ones(len(AHEAD))), atol=1e-6)
    assert limits.settled


def test_look_ahead_halves_what_a_swing_loses():
    """Beside following as fast as allowed without looking ahead."""
    position, velocity = wave(0.8, 1.5)
    out = stream(one_joint(), position, velocity, 4.0)
    times = np.array([now for now, _, _ in out])
    ours = np.array([window[0][0, 0] for _, _, window in out]) - position(times)[:, 0]
    tick = 0.001
    grid = np.arange(0.0, 4.0, tick)
    wanted, q, u, behind = position(grid)[:, 0], 0.0, 0.0, []
    for target in wanted:       # fastest approach that does not overshoot a standing target
        gap = target - q
        v = np.sign(gap) * min(np.sqrt(2 * 40.0 * abs(gap)), abs(gap) / tick, 4.0)
        u += np.clip(v - u, -40.0 * tick, 40.0 * tick)
        q += tick * u
        behind.append(q - target)
    assert np.sqrt(np.mean(ours[times > 1]**2)) < 0.6 * np.sqrt(np.mean(np.square(behind)[1000:]))


@pytest.mark.parametrize('name', ['humanoid20', 'exosuit6'])
def test_a_walk_at_full_speed_stays_within_what_the_servos_can_do(name):
    robot = read_robot(CONFIG / 'robots' / f'{name}.yaml')
    source = CycleSource(load_behaviours(CONFIG / 'models' / 'locomotion.npz')[0])
    performer, rng = Performer(source, robot), np.random.default_rng(1)
    bound, free = performer._bound, []
    for k in range(300):
        if k % 40 == 0:
            source.set_style(source.styles[rng.choice(list(source.styles))], 0.5)
        q, v = performer.window(AHEAD)
        free.append(np.abs(performer._free(AHEAD)[1]).max(axis=0))
        assert (np.abs(v) <= bound.velocity).all()
        assert (np.abs(np.diff(v, axis=0) / np.diff(AHEAD)[:, None]) <= bound.acceleration).all()
        assert ((q >= bound.lower) & (q <= bound.upper)).all()
        performer.advance(rng.uniform(0.005, 0.02))
    assert (np.max(free, axis=0) > bound.velocity).any(), 'the walk is no test'
    most = performer.limits.take_most()
    assert 0.05 < most.max() < 0.6
