"""The contract of `style_core.predictor.OnlinePredictor`: every kind of model through the same sequences, same rules.

The kinds come from the registry of those that predict; a new one needs a model in ``made_models.py`` and nothing here.
"""
from functools import cache

import numpy as np
import pytest
from made_models import LOADERS

from style_core import baselines
from style_core.cli.registry import KIND_COMMANDS
from style_core.formats import read_motion
from style_core.phase_style import METHODS
from style_core.predictor import Status
from style_core.predictor_file import KINDS, read_predictor

#: what every sequence is run with: each kind, each method of it, and recorded motion where a file can hold it
CASES = [(kind, METHODS[0], '') for kind in KINDS] + [('phase-style', method, '') for method in METHODS[1:]] \
    + [('phase-style', METHODS[0], '_histories')]
#: those that keep what does not fit out; the published method is as published
DOUBTING = [case for case in CASES if case[1] == METHODS[0]]
HORIZONS = np.array([0.0, 0.02, 0.2, 1.0])
WILD = (3.0, 99.0, 9_999.0, 10_001.0, 1e10, 1e200, 1e308)
RATE = 60.0


@pytest.fixture(scope='module')
def made(models):
    """Function ``made(case) -> (predictor, poses)``: a predictor that is reset, and poses at 60 Hz it has not seen."""
    @cache
    def load(kind, method, more):
        path = models[kind].with_name(f'{kind}{more}.npz')
        predictor = read_predictor(path, method).predictor
        motion = read_motion(models[kind].with_name(f'{kind}.csv')).joints(list(predictor.joint_names)).resample(RATE)
        return predictor, motion.positions

    def fresh(case):
        predictor, poses = load(*case)
        predictor.reset()
        return predictor, poses.copy()
    return fresh


@pytest.fixture(scope='module')
def undisturbed(made):
    """Function ``undisturbed(case, frames)``: `follow` without any disturbance, each once."""
    @cache
    def clean(case, frames):
        predictor, poses = made(case)
        found = follow(predictor, poses[:frames])
        predictor.reset()
        return found

    def run(case, frames):
        found = clean(case, frames)
        made(case)
        return found
    return run


def sound(estimate, joints):
    assert estimate.mean.shape == estimate.std.shape == estimate.observed.shape == (joints,)
    assert np.isfinite(estimate.mean).all() and np.abs(estimate.mean).max() < 2e4
    assert np.isfinite(estimate.std).all() and (estimate.std > 0).all(), estimate.std
    assert estimate.observed.dtype == bool and isinstance(estimate.status, Status)


def sound_ahead(ahead, now, horizons=HORIZONS):
    assert ahead.mean.shape == ahead.std.shape == ahead.velocity.shape == (len(horizons), ahead.mean.shape[1])
    np.testing.assert_allclose(ahead.times, now + horizons)
    assert all(np.isfinite(values).all() for values in (ahead.mean, ahead.std, ahead.velocity))
    assert (ahead.std > 0).all(), ahead.std.min(axis=1)


def follow(predictor, poses, times=None, masks=None):
    """Poses estimated, statuses, and every sixth frame what is predicted a fifth of a second ahead; all checked."""
    times = np.arange(len(poses)) / RATE if times is None else times
    means, statuses, ahead = [], [], []
    for k, (time, y) in enumerate(zip(times, poses)):
        found = predictor.update(time, y, None if masks is None else masks[k])
        sound(found, len(y))
        means.append(found.mean)
        statuses.append(found.status)
        if k % 6 == 5:
            predicted = predictor.predict(HORIZONS)
            sound_ahead(predicted, time)
            ahead.append(predicted.mean[2])
    return np.array(means), statuses, np.array(ahead)


def test_every_kind_that_predicts_is_here():
    assert set(KINDS) == set(KIND_COMMANDS['predict']) == set(KIND_COMMANDS['evaluate'])
    assert set(KINDS) <= set(LOADERS), 'made_models.py lacks a model of a kind that predicts'


@pytest.mark.parametrize('case', CASES, ids=str)
def test_before_anything_was_seen_it_says_what_to_expect_of_anyone(made, case):
    predictor, poses = made(case)
    sound_ahead(predictor.predict(HORIZONS), 0.0)
    sound(predictor.update(3.0, np.full(len(poses[0]), np.nan)), len(poses[0]))
    sound_ahead(predictor.predict(HORIZONS), 3.0)


@pytest.mark.parametrize('case', CASES, ids=str)
def test_what_makes_no_sense_is_refused_and_changes_nothing(made, case):
    predictor, poses = made(case)
    clean, _, _ = follow(predictor, poses[:40])
    predictor.reset()
    joints = len(poses[0])
    infinite = poses[20].copy()
    infinite[0] = -np.inf
    for k, y in enumerate(poses[:40]):
        if k == 20:
            for time, wrong, mask in (
                    (k / RATE, infinite, None), (k / RATE, infinite, np.zeros(joints, dtype=bool)), (np.nan, y, None),
                    (np.inf, y, None), ((k - 1) / RATE, y, None), (0.0, y, None), (k / RATE, y[:-1], None),
                    (k / RATE, y[None], None), (k / RATE, y, np.ones(joints)),
                    (k / RATE, y, np.ones(joints + 1, bool))):
                with pytest.raises(ValueError):
                    predictor.update(time, wrong, mask)
            for horizons in ([-0.1], [np.nan], [0.1, -np.inf], [[0.1]], 0.1):
                with pytest.raises(ValueError):
                    predictor.predict(np.array(horizons))
        found = predictor.update(k / RATE, y)
        np.testing.assert_array_equal(found.mean, clean[k])
        assert predictor.predict(np.zeros(0)).mean.shape == (0, joints)


@pytest.mark.parametrize('case', CASES, ids=str)
def test_what_is_not_observed_has_no_influence(made, case):
    predictor, poses = made(case)
    masks = np.random.default_rng(1).random(poses[:60].shape) > 0.3
    masks[30:35] = False
    results = []
    for junk in (np.nan, 0.0, 3.0, 1e5, 1e308):
        predictor.reset()
        means, _, ahead = follow(predictor, np.where(masks, poses[:60], junk), masks=masks)
        results.append((means, ahead))
    for junk in (np.nan, 10_001.0, -1e308):     # without a mask: not observed for what it is
        predictor.reset()
        results.append(follow(predictor, np.where(masks, poses[:60], junk))[::2])
    for means, ahead in results[1:]:
        np.testing.assert_array_equal(means, results[0][0])
        np.testing.assert_array_equal(ahead, results[0][1])


@pytest.mark.parametrize('case', CASES, ids=str)
def test_a_reset_leaves_nothing_behind(made, case):
    predictor, poses = made(case)
    first = follow(predictor, poses[:40])
    follow(predictor, 2.0 * poses[60:90], times=5.0 + np.arange(30) / RATE)
    predictor.reset()
    second = follow(predictor, poses[:40])
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[2], second[2])


@pytest.mark.parametrize('gap_s', [0.5, 2.1, 60.0, 1e9])
@pytest.mark.parametrize('case', CASES, ids=str)
def test_silences_of_any_length(made, case, gap_s):
    predictor, poses = made(case)
    times = np.arange(150) / RATE
    times[60:] += gap_s
    _, statuses, _ = follow(predictor, poses[:150], times)
    if gap_s < 1e6 and case[1] == METHODS[0]:     # stamps further out are too coarse for frames at 60 Hz
        assert statuses[-1] is not Status.LOST


@pytest.mark.parametrize('step_s', [1e-4, 0.5, 1.0])
@pytest.mark.parametrize('case', CASES, ids=str)
def test_rates_of_any_height(made, case, step_s):
    predictor, poses = made(case)
    follow(predictor, poses[:80], times=step_s * np.arange(80))


@pytest.mark.parametrize('horizon', [1e-12, 1e3, 1e15])
@pytest.mark.parametrize('case', CASES, ids=str)
def test_horizons_of_any_length(made, case, horizon):
    predictor, poses = made(case)
    follow(predictor, poses[:60])
    horizons = np.array([0.0, horizon])
    sound_ahead(predictor.predict(horizons), 59 / RATE, horizons)


@pytest.mark.parametrize('case', [
    pytest.param(case, marks=pytest.mark.xfail(case[0] == 'phase-style', reason='its kernels take any horizon >= 0'))
    for case in CASES], ids=str)
def test_horizons_beyond_all_bounds(made, case):
    predictor, poses = made(case)
    follow(predictor, poses[:60])
    horizons = np.array([0.0, 1e300])
    sound_ahead(predictor.predict(horizons), 59 / RATE, horizons)
    with pytest.raises(ValueError):
        predictor.predict(np.array([np.inf]))


@pytest.mark.parametrize('at', [0, 5, 90], ids=['first', 'searching', 'tracking'])
@pytest.mark.parametrize('wild', WILD, ids=str)
@pytest.mark.parametrize('joints', ['one', 'all', 'signs'])
@pytest.mark.parametrize('case', DOUBTING, ids=str)
def test_a_wild_sample_does_no_harm_a_second_later(made, undisturbed, case, wild, at, joints):
    predictor, poses = made(case)
    poses = poses[:at + 80]
    clean, statuses, ahead = undisturbed(case, at + 80)
    spoiled = poses.copy()
    if joints == 'one':
        spoiled[at, 1] = wild
    else:
        spoiled[at] = wild * (1 if joints == 'all' else (-1.0) ** np.arange(len(poses[at])))
    means, after, guesses = follow(predictor, spoiled)
    back = at + 60
    off = np.degrees(np.abs(guesses - ahead)[back // 6:]).max()
    assert np.degrees(np.abs(means - clean)[back:]).max() < 1.0 and off < 5.0, off
    assert after[-1] is statuses[-1]
    if at == 90 and statuses[at - 1] is Status.TRACKING:     # and hardly any meanwhile
        assert np.degrees(np.abs(means - clean)[at]).max() < 30.0


@pytest.mark.parametrize('wild', WILD[:3], ids=str)
@pytest.mark.parametrize('case', DOUBTING, ids=str)
def test_garbage_for_a_while_is_over_a_second_after_it_ends(made, case, wild):
    predictor, poses = made(case)
    poses = np.concatenate([poses, poses])[:240]
    spoiled = poses.copy()
    rng = np.random.default_rng(2)
    spoiled[90:150] = wild * rng.standard_normal(spoiled[90:150].shape)
    means, _, _ = follow(predictor, spoiled)
    assert np.degrees(np.sqrt(np.mean((means[215:] - poses[215:])**2))) < 3.0


@pytest.mark.parametrize('case', DOUBTING, ids=str)
def test_a_joint_that_has_moved_is_believed(made, case):
    """An exchanged sensor: off by half a radian from some frame on, and moving with the joint."""
    predictor, poses = made(case)
    poses[90:, 1] += 0.5
    for k, y in enumerate(poses[:130]):
        found = predictor.update(k / RATE, y)
    assert found.observed[1] and abs(found.mean[1] - poses[129, 1]) < 0.1


@pytest.mark.parametrize('name', ['ZeroVelocity', 'ConstantVelocity', 'LinearLeastSquares'])
def test_baselines_keep_the_rules_but_for_bands(name):
    predictor = getattr(baselines, name)(('a', 'b'))
    assert np.isfinite(predictor.predict(HORIZONS).mean).all()
    for wrong in (np.array([0.0, np.inf]), np.zeros(3)):
        with pytest.raises(ValueError):
            predictor.update(0.0, wrong)
    for k in range(20):
        found = predictor.update(k / RATE, np.array([0.1 * k, 1e5 if k > 3 else 0.5]))
    assert found.observed.tolist() == [True, False]
    assert np.isfinite(predictor.predict(HORIZONS).mean).all() and np.isnan(predictor.predict(HORIZONS).std).all()
    for horizons in ([-1.0], [np.inf]):
        with pytest.raises(ValueError):
            predictor.predict(np.array(horizons))
