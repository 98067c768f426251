"""The limiter: every limit at every tick, without a tolerance, for any input."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import UsageError
from style_core.follow.limiter import CLAMP, LATTICE, PASS, REJECT, Limiter

PERIOD = 0.005


class Checked:
    """A limiter under the eyes of an independent check of every command."""

    def __init__(self, lower, upper, velocity, acceleration, jump, period, start):
        self.limits = lower, upper, velocity, acceleration
        self.period = period
        self.limiter = Limiter(lower, upper, velocity, acceleration, jump, period)
        self.limiter.reset(start)
        self.last = [self.limiter.position.copy()] * 2

    def check(self):
        lower, upper, velocity, acceleration = self.limits
        p, (before, now) = self.limiter.position.copy(), self.last
        # commands lie on a lattice of doubles, so these differences are exact
        step, last_step = p - now, now - before
        assert np.all((lower <= p) & (p <= upper))
        assert np.all(np.abs(step) <= velocity * self.period)
        assert np.all(np.abs(step - last_step) <= acceleration * self.period * self.period)
        self.last = [now, p]
        return p

    def step(self, target, rate):
        self.limiter.step(target, rate)
        return self.check()


def random_limits(rng, n):
    lower = rng.uniform(-3, 0.5, n)
    upper = lower + 10.0 ** rng.uniform(-3, 0.7, n)
    return lower, upper, 10.0 ** rng.uniform(-2, 1.5, n), 10.0 ** rng.uniform(-1, 3, n)


def hostile_targets(rng, n, ticks, lower, upper):
    """Walks, steps, chatter at the limits, far jumps and values that are no numbers."""
    middle, span = (lower + upper) / 2, upper - lower
    kind = rng.integers(0, 6, n)
    for k in range(ticks):
        if k % 40 == 0:
            kind = np.where(rng.random(n) < 0.3, rng.integers(0, 6, n), kind)
            level = rng.uniform(-1, 1, n)
        target = np.select(
            [kind == 0, kind == 1, kind == 2, kind == 3, kind == 4],
            [middle + span * level, middle + span * rng.choice([-1, 1], n), middle + span * np.sin(k * 0.05 * level),
             middle + 0.5 * span * np.sign(level), rng.normal(0, 10, n)], middle + span * rng.normal(0, 100, n))
        rate = rng.normal(0, 5, n) * (rng.random(n) < 0.5)
        bad = rng.random(n) < 0.02
        target[bad] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e300], int(bad.sum()))
        worse = rng.random(n) < 0.01
        rate[worse] = rng.choice([np.nan, np.inf, -np.inf, 1e308], int(worse.sum()))
        yield target, rate


@pytest.mark.parametrize('seed, jump', [(0, 0.1), (1, 1.0), (2, 900.0)])
def test_millions_of_hostile_ticks_obey_every_limit(seed, jump):
    rng = np.random.default_rng(seed)
    n, ticks = 1000, 2000
    limits = random_limits(rng, n)
    start = np.clip(rng.uniform(limits[0], limits[1]), limits[0] + 1e-9, limits[1] - 1e-9)
    checked = Checked(*limits, np.full(n, jump), PERIOD, start)
    for target, rate in hostile_targets(rng, n, ticks, limits[0], limits[1]):
        checked.step(target, rate)
    counts = checked.limiter.counts
    assert counts.sum() == n * ticks and counts[CLAMP] > 0 and counts[REJECT] > 0


@given(seed=st.integers(0, 2**32 - 1), period=st.sampled_from([0.001, 0.0025, 0.005, 0.01, 0.02]),
       jump=st.sampled_from([0.05, 1.0, 100.0]))
@settings(max_examples=60, deadline=None)
def test_any_limits_any_period(seed, period, jump):
    rng = np.random.default_rng(seed)
    limits = random_limits(rng, 20)
    checked = Checked(*limits, np.full(20, jump), period, (limits[0] + limits[1]) / 2)
    for target, rate in hostile_targets(rng, 20, 150, limits[0], limits[1]):
        checked.step(target, rate)


def viable_states(lower, upper, largest, change):
    """All (p, w) from which some sequence of steps stays inside for ever, by elimination (nothing clever)."""
    states = {(p, w) for p in range(lower, upper + 1) for w in range(-largest, largest + 1)}
    while True:
        kept = {(p, w) for p, w in states
                if any((p + z, z) in states for z in range(max(w - change, -largest), min(w + change, largest) + 1))}
        if kept == states:
            return states
        states = kept


@pytest.mark.parametrize('largest, change', [(1, 1), (5, 1), (7, 2), (9, 4), (3, 5), (12, 3)])
def test_the_allowed_steps_are_exactly_the_viable_ones(largest, change):
    """Neither overshoots nor gives away room: the extreme allowed steps equal those found by elimination."""
    lower, upper = -20, 17
    viable = viable_states(lower, upper, largest, change)
    scale = LATTICE
    limiter = Limiter([lower * scale], [upper * scale], [largest * scale], [change * scale], [900.0], 1.0)
    for direction in (1, -1):
        for start in range(lower, upper + 1):
            limiter.reset([start * scale])
            p, w = start, 0
            for _ in range(60):
                options = [z for z in range(max(w - change, -largest), min(w + change, largest) + 1)
                           if (p + z, z) in viable]
                extreme = max(options) if direction > 0 else min(options)
                command = limiter.step(np.array([direction * 100.0]), np.zeros(1))[0] / scale
                assert command == p + extreme
                p, w = p + extreme, extreme
            assert p == (upper if direction > 0 else lower) and w == 0


def test_a_legal_stream_passes_through_unchanged():
    t = np.arange(4000) * PERIOD
    reference = np.stack([0.8 * np.sin(2 * t), 0.3 * np.cos(5 * t)], axis=1)
    rate = np.stack([1.6 * np.cos(2 * t), -1.5 * np.sin(5 * t)], axis=1)
    checked = Checked(*np.array([[-1.0] * 2, [1.0] * 2, [3.0] * 2, [20.0] * 2]), np.full(2, 0.2), PERIOD, reference[0])
    for k in range(1, len(t)):
        out = checked.step(reference[k], rate[k])
        if k > 100:
            assert np.all(np.abs(out - reference[k]) <= LATTICE / 2)
            assert np.all(checked.limiter.bands == PASS)


@pytest.mark.parametrize('acceleration', [1.0, 7.0, 50.0, 1000.0])
def test_a_step_is_reached_without_overshoot_and_kept(acceleration):
    checked = Checked(*np.array([[-2.0], [2.0], [3.0], [acceleration]]), np.array([9.0]), PERIOD, np.array([-1.0]))
    path = np.array([checked.step(np.array([1.0]), np.zeros(1))[0] for _ in range(1500)])
    assert np.all(np.diff(path) >= 0) and path.max() <= 1.0 and path[-1] == 1.0
    fastest = 2 / 3 + 3 / acceleration if acceleration > 4.5 else 2 * np.sqrt(2 / acceleration)
    assert np.argmax(path == 1.0) * PERIOD <= 1.05 * fastest + 3 * PERIOD


def test_a_moving_target_is_caught_and_then_followed_exactly():
    checked = Checked(*np.array([[-9.0], [9.0], [3.0], [10.0]]), np.array([9.0]), PERIOD, np.array([-1.0]))
    error = []
    for k in range(800):
        target = 0.0 + 1.0 * k * PERIOD
        error.append(checked.step(np.array([target]), np.array([1.0]))[0] - target)
    assert max(error) <= 2e-12 and np.max(np.abs(error[-300:])) <= LATTICE


def test_bad_input_brakes_and_is_reported():
    limiter = Limiter([-1.0], [1.0], [2.0], [10.0], [0.5], PERIOD)
    limiter.reset([0.0])
    for k in range(100):
        limiter.step(np.array([0.005 * k]), np.array([1.0]))
    assert limiter.velocity[0] > 0.5
    for bad in (np.nan, np.inf, -np.inf, limiter.position[0] - 0.6):
        limiter.step(np.array([bad]), np.zeros(1))
        assert limiter.bands[0] == REJECT
    for _ in range(100):
        limiter.step(np.array([np.nan]), np.zeros(1))
    assert limiter.stopped and limiter.velocity[0] == 0


def test_a_target_that_outruns_the_limits_is_followed_one_that_jumps_is_not():
    limiter = Limiter([-9.0], [9.0], [1.0], [10.0], [0.5], PERIOD)
    limiter.reset([0.0])
    for k in range(300):        # 5 rad/s, five times the limit: 6 rad behind at the end
        limiter.step(np.array([5 * k * PERIOD]), np.array([5.0]))
        assert limiter.bands[0] == CLAMP
    assert limiter.velocity[0] == pytest.approx(1.0)
    limiter.step(np.array([5 * 300 * PERIOD - 0.6]), np.zeros(1))
    assert limiter.bands[0] == REJECT
    limiter.step(np.array([5 * 300 * PERIOD - 0.6]), np.zeros(1))      # no jump any more, but no sooner trusted
    assert limiter.bands[0] == REJECT
    limiter.step(limiter.position + 0.4, np.zeros(1))
    assert limiter.bands[0] == CLAMP
    for bad in (lambda: limiter.step(np.array([np.nan]), np.zeros(1)), limiter.brake):
        bad()
        limiter.step(limiter.position + 0.6, np.zeros(1))
        assert limiter.bands[0] == REJECT
        limiter.step(limiter.position.copy(), np.zeros(1))


def test_stop_foretells_where_braking_ends():
    rng = np.random.default_rng(3)
    limits = random_limits(rng, 50)
    limiter = Limiter(*limits, np.full(50, 900.0), PERIOD)
    limiter.reset((limits[0] + limits[1]) / 2)
    for target, rate in hostile_targets(rng, 50, 60, limits[0], limits[1]):
        limiter.step(target, rate)
        assert np.all((limits[0] <= limiter.stop()[0]) & (limiter.stop()[0] <= limits[1]))
    end, duration = limiter.stop()
    for _ in range(round(duration / PERIOD)):
        limiter.brake()
    assert limiter.stopped
    np.testing.assert_array_equal(limiter.position, end)


def test_before_reset_nothing_but_nan_comes_out():
    limiter = Limiter([-1.0], [1.0], [2.0], [10.0], [0.5], PERIOD)
    assert np.isnan(limiter.position[0])


def test_a_start_outside_the_limits_only_moves_inwards():
    limiter = Limiter([-1.0], [1.0], [2.0], [10.0], [9.0], PERIOD)
    limiter.reset([1.3])
    path = [limiter.step(np.array([4.0 if k < 50 else 0.0]), np.zeros(1))[0] for k in range(400)]
    assert max(path) <= 1.3 + LATTICE and path[-1] == 0.0 and np.all(np.diff(path) <= 0)


@pytest.mark.parametrize('change', [
    {'lower': [np.nan]}, {'lower': [2.0]}, {'upper': [np.inf]}, {'velocity': [0.0]}, {'velocity': [-1.0]},
    {'acceleration': [np.nan]}, {'discontinuity': [np.inf]}, {'period': 0.0}, {'period': np.nan}, {'velocity': [1e-12]},
    {'lower': [0.0, 0.0]}])
def test_impossible_limits_are_refused(change):
    arguments = {'lower': [-1.0], 'upper': [1.0], 'velocity': [1.0], 'acceleration': [1.0], 'discontinuity': [1.0],
                 'period': PERIOD, **change}
    with pytest.raises(UsageError):
        Limiter(**arguments)


def test_a_start_that_is_no_posture_is_refused():
    limiter = Limiter([-1.0], [1.0], [2.0], [10.0], [0.5], PERIOD)
    for bad in ([np.nan], [1e6], [0.0, 0.0]):
        with pytest.raises(UsageError):
            limiter.reset(bad)
    with pytest.raises(UsageError):
        limiter.step(np.zeros(2), np.zeros(2))
