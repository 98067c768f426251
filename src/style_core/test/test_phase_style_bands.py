"""Bands: the level of a person, predictions checked in time, joints in the dark."""
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.phase_style import bands as bands_module
from style_core.phase_style.bands import FAR_S, LEAD_S, MEMORY_S, MOST, Bands, Level

HORIZON, SCALE = np.array([1, 5, 25]) / 60, np.array([0.6, 1.0, 1.2])


def made(channels=4, median=0.5, weight=2.0):
    residual = SimpleNamespace(calibration_horizon=HORIZON, calibration_scale=SCALE, check_median=median,
                               check_weight=weight)
    return Bands([SimpleNamespace(joint_names=tuple('abcd'[:channels]), residual=residual)])


def factors(bands, horizons, channels=4):
    """Of each joint, shape (H, D)."""
    std = np.ones((len(horizons), channels))
    bands.widen(0, horizons, std)
    return std


def present(bands):
    return factors(bands, np.zeros(1))[0]


class Prophet:
    """Predicts a constant with a constant standard deviation."""

    def __init__(self, std):
        self.std = std

    def forecast_into(self, horizons, mean, std, velocity):
        mean[:], std[:], velocity[:] = 0.0, self.std, 0.0


def led(std=1.0):
    return SimpleNamespace(behaviour=0, filter=Prophet(std))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 20), st.floats(0.01, 1)), max_size=20), st.floats(0.1, 5), st.floats(0.1, 50))
def test_level_is_the_mean_of_checks_that_starts_at_one(checks, median, weight):
    level = Level(median, weight)
    for value, share in checks:
        level.add(value, share, elapsed=0.0)
    top = weight + sum(share * min(max(value / median, 1 / MOST), MOST) for value, share in checks)
    assert level.factor == pytest.approx(np.sqrt(top / (weight + sum(share for _, share in checks))))
    level.reset()
    assert level.factor == 1


def test_old_checks_fade():
    level = Level(1.0, 1.0)
    for _ in range(1000):
        level.add(4.0)
    assert level.factor == pytest.approx(2.0, rel=0.02)
    level.add(1.0, elapsed=20 * MEMORY_S)
    assert level.factor == pytest.approx(1.0)


@pytest.mark.parametrize('rate', [13.0, 25.0, 30.0, 60.0, 100.0, 1000.0])
def test_the_band_follows_the_person_at_any_rate(rate):
    rng, seen, horizons = np.random.default_rng(0), np.ones(4, np.uint8), np.array([5 / 60])
    bands, track = made(median=1.0), led()
    for frame in range(int(20 * rate)):
        bands.observe(seen, 1 / rate)
        bands.follow(track, frame / rate, 0.5 * rng.standard_normal(4), seen)
    assert factors(bands, horizons) == pytest.approx(0.5, rel=0.25)
    bands.forget()
    assert np.all(factors(bands, horizons) == 1.0)


def test_a_new_leader_is_not_judged_by_the_predictions_of_the_last():
    seen, bands = np.ones(4, np.uint8), made(median=1.0)
    one, two = led(), led()
    bands.observe(seen, 0.0)
    bands.follow(one, 0.0, np.zeros(4), seen)
    bands.follow(two, LEAD_S, np.full(4, 100.0), seen)
    assert np.all(present(bands) == SCALE[0])
    bands.follow(two, 2 * LEAD_S, np.full(4, 2.0), seen)
    assert present(bands) == pytest.approx(SCALE[0] * np.sqrt((2 + 4) / 3), rel=1e-2)


def test_a_joint_in_the_dark_is_as_uncertain_as_a_prediction_from_when_it_was_seen():
    bands, seen = made(), np.array([1, 1, 1, 0], np.uint8)
    np.testing.assert_array_equal(present(bands), np.full(4, SCALE[-1]))  # nothing was ever seen
    bands.observe(np.ones(4, np.uint8), 0.01)
    assert np.all(present(bands) == SCALE[0])
    for _ in range(5):
        bands.observe(seen, 1 / 60)
    now, ahead = present(bands), factors(bands, HORIZON)
    np.testing.assert_allclose(now, [SCALE[0]] * 3 + [SCALE[1]])
    np.testing.assert_allclose(ahead[:, 0], SCALE)
    np.testing.assert_allclose(ahead[:, 3], np.interp(HORIZON + 5 / 60, HORIZON, SCALE))
    bands.observe(np.ones(4, np.uint8), 1 / 60)
    np.testing.assert_allclose(factors(bands, HORIZON), np.repeat(SCALE[:, None], 4, axis=1))


def test_hidden_joints_do_not_judge_and_are_judged_less_and_less():
    bands, seen, track = made(median=1.0), np.array([1, 1, 1, 0], np.uint8), led()
    for frame in range(1200):
        bands.observe(seen, 1 / 60)
        bands.follow(track, frame / 60, np.array([0.5, 0.5, 0.5, np.nan]), seen)
    now = present(bands)
    assert now[0] == pytest.approx(SCALE[0] * 0.5, rel=0.05)
    assert now[3] == pytest.approx(SCALE[-1])
    assert np.isfinite(now).all()
    bands.observe(np.ones(4, np.uint8), 1 / 60)
    bands.observe(seen, FAR_S)
    level = present(bands)[0] / SCALE[0]
    assert present(bands)[3] == pytest.approx(SCALE[-1] * (1 + (level - 1) / np.e))


@pytest.mark.parametrize('name', ['MOST', 'MEMORY_S', 'FAR_S'])
def test_a_constant_that_is_tried_is_the_one_that_counts(monkeypatch, name):  # prediction_constants.py tries them
    def measured():
        bands, track, seen = made(median=1.0), led(), np.ones(4, np.uint8)
        for frame in range(300):
            bands.observe(seen, 1 / 60)
            bands.follow(track, frame / 60, np.full(4, 5.0 if frame % 20 < 10 else 0.1), seen)
        bands.observe(np.array([1, 1, 1, 0], np.uint8), 0.2)
        return present(bands)

    usual = measured()
    monkeypatch.setattr(bands_module, name, 0.5 * getattr(bands_module, name))
    assert np.any(measured() != usual)
