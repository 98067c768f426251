"""Scores against values worked out by hand or by sampling, and what a predictor is shown."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core import evaluation
from style_core.baselines import ZeroVelocity
from style_core.errors import MotionError, UsageError
from style_core.motion import Motion

NAMES = ('hip', 'knee', 'ankle')


def ramp(n_frames=40, rate_hz=60.0, slope=(1.0, -2.0, 0.5)):
    times = np.arange(n_frames) / rate_hz
    return Motion(NAMES, times[:, None] * np.array(slope), times)


def test_future_is_the_recording_shifted_and_nan_past_its_end():
    motion = ramp()
    ahead = evaluation.future(motion, evaluation.paper_horizons(5))
    assert ahead.shape == (40, 5, 3)
    for step in range(1, 6):
        np.testing.assert_array_equal(ahead[:-step, step - 1], motion.positions[step:])
        assert np.isnan(ahead[-step:, step - 1]).all()


def test_future_between_frames_and_over_uneven_stamps():
    times = np.array([0.0, 0.1, 0.15, 0.4, 0.5])
    motion = Motion(('a',), times[:, None] * 2.0, times)
    ahead = evaluation.future(motion, [0.0, 0.025, 0.2])
    np.testing.assert_allclose(ahead[:, 0, 0], motion.positions[:, 0])
    np.testing.assert_allclose(ahead[:4, 1, 0], 2 * (times[:4] + 0.025))
    np.testing.assert_allclose(ahead[:3, 2, 0], 2 * (times[:3] + 0.2))
    assert np.isnan(ahead[4, 1, 0]) and np.isnan(ahead[3:, 2, 0]).all()


def test_error_of_zero_velocity_on_a_ramp():
    motion = ramp()
    rollout = evaluation.roll_out(ZeroVelocity(NAMES), motion, evaluation.paper_horizons(10))
    slope_deg = np.degrees([1.0, -2.0, 0.5]) / 60
    steps = np.arange(1, 11)
    by_hand = np.mean(steps[:, None] ** 2 * slope_deg ** 2)
    assert evaluation.error_deg2(rollout.mean, rollout.actual) == pytest.approx(by_hand)
    np.testing.assert_allclose(evaluation.rms_deg(rollout.mean, rollout.actual),
                               steps * np.sqrt(np.mean(slope_deg ** 2)))
    assert rollout.complete.sum() == 30
    np.testing.assert_array_equal(evaluation.zero_velocity_of(rollout), rollout.mean)


def test_joints_are_matched_by_name_in_the_predictors_order():
    motion = ramp()
    rollout = evaluation.roll_out(ZeroVelocity(('ankle', 'hip')), motion, [0.1])
    np.testing.assert_array_equal(rollout.present, motion.positions[:, [2, 0]])
    with pytest.raises(MotionError, match='toe'):
        evaluation.roll_out(ZeroVelocity(('toe', 'hip')), motion, [0.1])


@pytest.mark.parametrize('level', [0.5, 0.9])
def test_coverage_log_score_and_crps_of_a_true_gaussian(level):
    rng = np.random.default_rng(3)
    mean = rng.normal(size=(4000, 2, 5))
    std = np.exp(rng.normal(size=mean.shape) * 0.3) * np.array([0.1, 0.4])[:, None]
    actual = mean + std * rng.normal(size=mean.shape)
    np.testing.assert_allclose(evaluation.coverage(mean, std, actual, level), level, atol=0.01)
    entropy = np.mean(np.log(std) + 0.5 * np.log(2 * np.pi * np.e), axis=(0, 2))
    np.testing.assert_allclose(evaluation.log_score(mean, std, actual), -entropy, atol=0.02)
    np.testing.assert_allclose(evaluation.crps_deg(mean, std, actual),
                               np.degrees(std.mean(axis=(0, 2)) / np.sqrt(np.pi)), rtol=0.02)
    # a proper score: wrong by a factor either way costs
    for factor in (0.6, 1.6):
        assert (evaluation.crps_deg(mean, factor * std, actual) > evaluation.crps_deg(mean, std, actual)).all()
        assert (evaluation.log_score(mean, factor * std, actual) < evaluation.log_score(mean, std, actual)).all()


def test_crps_equals_its_definition_by_sampling():
    rng = np.random.default_rng(8)
    draws = 0.3 + 0.7 * rng.normal(size=20000)
    by_sampling = np.mean(np.abs(draws - 1.0)) - 0.5 * np.mean(np.abs(draws - rng.permutation(draws)))
    one = np.ones((1, 1, 1))
    assert evaluation.crps_deg(0.3 * one, 0.7 * one, one)[0] == pytest.approx(np.degrees(by_sampling), rel=0.03)
    assert evaluation.crps_deg(0.3 * one, np.nan * one, one)[0] == pytest.approx(np.degrees(0.7))


def test_missing_values_are_left_out_of_every_score():
    rng = np.random.default_rng(0)
    mean, actual = rng.normal(size=(2, 50, 3, 4))
    std = np.full(mean.shape, 0.5)
    holes = actual.copy()
    holes[::2, :, 1] = np.nan
    kept = np.isfinite(holes)
    for score in (evaluation.log_score, evaluation.crps_deg):
        by_hand = [score(mean[:, h][kept[:, h]].reshape(-1, 1, 1), std[:, h][kept[:, h]].reshape(-1, 1, 1),
                         actual[:, h][kept[:, h]].reshape(-1, 1, 1))[0] for h in range(3)]
        np.testing.assert_allclose(score(mean, std, holes), by_hand)
    assert evaluation.error_deg2(mean, holes) == pytest.approx(np.nanmean(np.degrees(mean - holes) ** 2))


def test_phase_error_goes_the_short_way_round():
    reference = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    shifted = np.mod(reference - 0.02 * 2 * np.pi, 2 * np.pi)
    assert evaluation.phase_error_percent(shifted, reference) == pytest.approx(2.0)
    assert evaluation.phase_error_percent([0.98, np.nan], [0.01, 0.5], cycle=1.0) == pytest.approx(3.0)
    assert evaluation.event_phase_error_percent([0.1, 2 * np.pi - 0.1], 0.0) == pytest.approx(100 * 0.1 / (2 * np.pi))


def test_masks_hide_what_they_say():
    names = ('lfemur.rx', 'lfemur.ry', 'rfemur.rx')
    shown = evaluation.mask_out(names, ['lfemur.*'], 10, first=4)
    assert shown[:4].all() and not shown[4:, :2].any() and shown[:, 2].all()
    with pytest.raises(UsageError, match='arm'):
        evaluation.mask_out(names, ['arm*'], 10)
    some = evaluation.random_sensors(names, 7, 2, seed=1)
    assert (some.sum(axis=1) == 1).all() and (some == some[0]).all()


@settings(max_examples=15, deadline=None)
@given(share=st.floats(0.0, 0.6), length=st.integers(2, 30), seed=st.integers(0, 100))
def test_bursts_hide_the_share_asked_for(share, length, seed):
    shown = evaluation.random_bursts(tuple('abcdefgh'), 4000, share, length, seed)
    # the mean of a two-state chain: its standard error with correlation time `length`
    slack = 6 * np.sqrt(share * (1 - share) * 2 * length / shown.size) + 1e-9
    assert abs((~shown).mean() - share) <= slack
    np.testing.assert_array_equal(shown, evaluation.random_bursts(tuple('abcdefgh'), 4000, share, length, seed))


def test_a_disturbed_connection_drops_delays_and_jitters():
    times = np.arange(2000) / 100
    order, stamps = evaluation.disturbed_stamps(times, seed=4, jitter=1.0)
    np.testing.assert_array_equal(order, np.arange(2000))
    assert (np.diff(stamps) >= 0).all() and np.abs(stamps - times).max() <= 0.005 + 1e-12
    assert np.std(np.diff(stamps)) > 0.003
    order, stamps = evaluation.disturbed_stamps(times, seed=4, dropped=0.2)
    assert abs(len(order) / 2000 - 0.8) < 0.05 and (np.diff(order) > 0).all()
    order, _ = evaluation.disturbed_stamps(times, seed=4, late=0.1)
    assert sorted(order) == list(range(2000))
    assert abs(np.mean(np.diff(order) < 0) - 0.1) < 0.03
    order, _ = evaluation.disturbed_stamps(times, seed=4, reordered=0.1)
    assert sorted(order) == list(range(2000)) and (np.diff(order) < 0).any()


def test_windows_over_a_seam_are_told():
    times = np.arange(10) / 10
    clear = evaluation.windows_clear_of(times, [0.1, 0.2], [0.5])
    np.testing.assert_array_equal(clear, [1, 1, 1, 0, 0, 1, 1, 1, 1, 1])


def test_summary_is_plain_and_complete():
    import json
    motion = ramp(60)
    shown = evaluation.mask_out(NAMES, ['knee'], 60, first=20)
    rollout = evaluation.roll_out(ZeroVelocity(NAMES), motion, evaluation.paper_horizons(5), observed=shown)
    report = json.loads(json.dumps(evaluation.summary(rollout)))
    held = np.degrees(2.0 * (motion.times[20:] - motion.times[19]))
    assert report['hidden_rms_deg'] == pytest.approx(np.sqrt(np.mean(held ** 2)))
    assert report['error_deg2'] > report['zero_velocity_error_deg2']
    assert len(report['rms_deg']) == 5 and report['instants'] == 60
