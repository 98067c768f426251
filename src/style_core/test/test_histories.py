"""Nearest histories: the search, the recent past as even frames, and the correction of the full filter."""
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_phase_style_full import NAMES, made_person

from style_core import model_file
from style_core.cli import main
from style_core.errors import ModelError, MotionError, UsageError
from style_core.evaluation import paper_horizons, roll_out
from style_core.formats import write_motion
from style_core.histories import HistorySearch, RecentPast, gather
from style_core.motion import Motion
from style_core.phase_style import (
    CorrectedPredictor,
    FullPredictor,
    learn_correction,
    load_parts,
    load_predictor,
    save_behaviours,
)
from style_core.phase_style.learning import align, bases_from
from style_core.phase_style.model import Correction
from style_core.phase_style.residual import learn_residual
from style_core.phase_style.with_histories import mixing_weights
from style_core.predictor import Status
from style_core.predictor_file import read_predictor
from style_core.stream.loading import load_live
from style_core.unknown import OpenPredictor

RATE = 60.0
AHEAD = paper_horizons()


def wandering(rng, n, channels):
    return rng.normal(size=(n, channels)).cumsum(axis=0) * 0.1


# ------------------------------------------------------------------------------------------------- the search


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10 ** 6), st.integers(1, 21), st.sampled_from([1, 3, 10]), st.floats(0, 0.9))
def test_search_is_exact_with_any_mask(seed, channels, frames, hidden):
    rng = np.random.default_rng(seed)
    recordings = [(str(n), wandering(rng, n, channels)) for n in (40, 70, 31)]
    ends = [False, True, False]
    ahead = 5
    histories = gather(recordings, [str(k) for k in range(channels)], RATE, ends)
    search = HistorySearch(histories, 4, frames, ahead / RATE)
    past = RecentPast(channels, frames / RATE)
    seen_by_frame, y = [], wandering(rng, 30, channels)
    for t in range(30):
        seen_by_frame.append(rng.random(channels) >= hidden)
        past.add(t / RATE, np.where(seen_by_frame[-1], y[t], np.nan), seen_by_frame[-1])
        if rng.random() < 0.3:  # searches may skip observations
            continue
        back = range(min(frames, t + 1))
        if not any(seen_by_frame[t - a].any() for a in back):
            assert not search.find(past)
            continue
        assert search.find(past)
        brute, begin = [], 0
        for (_, one), end in zip(recordings, ends):
            for at in range(frames - 1, len(one) if end else len(one) - ahead):
                apart = [(one[at - a] - y[t - a])[seen_by_frame[t - a]] for a in back]
                brute.append((sum(np.sum(part ** 2) for part in apart), begin + at))
            begin += len(one)
        brute.sort()
        cost = {at: distance for distance, at in brute}
        np.testing.assert_allclose([cost[at] for at in search.found], [distance for distance, _ in brute[:4]],
                                   rtol=1e-4, atol=1e-6)
        assert len(set(search.found.tolist())) == 4


def test_displacement_is_linear_between_frames_and_stands_at_the_end():
    ramp = np.arange(50)[:, None] * np.array([0.1, -0.2])
    search = HistorySearch(gather([('ramp', ramp)], 'ab', RATE, [True]), neighbours=1, frames=2)
    past = RecentPast(2, 2 / RATE)
    for t in range(2):
        past.add(t / RATE, ramp[38 + t], np.ones(2, dtype=bool))
    assert search.find(past) and search.found[0] == 39
    mean, velocity = search.displacement(np.array([0.0, 0.5, 3.25, 10.0, 40.0]) / RATE)
    np.testing.assert_allclose(mean[:, 0], [0, 0.05, 0.325, 1.0, 1.0], atol=1e-5)
    np.testing.assert_allclose(velocity, np.array([[6, -12]] * 3 + [[0, 0]] * 2), atol=1e-4)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10 ** 6), st.floats(20, 1000))
def test_recent_past_becomes_even_frames(seed, rate):
    rng = np.random.default_rng(seed)
    times = 3.0 + np.cumsum(rng.uniform(0.6, 1.4, 300) / rate)
    y = np.sin(7 * times[:, None] + np.arange(3))
    past = RecentPast(3, 10 / RATE)
    seen = np.ones((300, 3), dtype=bool)
    seen[:, 2] = False
    for row in zip(times, np.where(seen, y, np.nan), seen):
        past.add(*row)
    order = np.array([2, 0, 1], dtype=np.int32)
    window, weight = np.ones((10, 16), dtype=np.float32), np.ones((10, 16), dtype=np.float32)
    past.fill(1 / RATE, order, window, weight)
    assert not weight[:, 0].any() and not weight[:, 3:].any() and weight[0, 1:3].all()
    assert not np.isnan(window).any()
    wanted = times[-1] - np.arange(10) / RATE
    exact = np.sin(7 * wanted[:, None] + np.arange(2))
    known = weight[:, 1:3] > 0
    # what a straight line between frames at most two and a half periods apart can be wrong by
    np.testing.assert_allclose(window[:, 1:3][known], exact[known], atol=49 * (2.55 / RATE) ** 2 / 8 + 1e-5 + 7e-4)
    if rate > 45:
        assert known.all()


def test_what_lies_in_a_gap_was_not_seen():
    past = RecentPast(1, 10 / RATE)
    for time in (0.0, 1 / RATE, 2 / RATE, 9 / RATE, 10 / RATE):
        past.add(time, np.array([time]), np.array([True]))
    window, weight = np.empty((11, 16), dtype=np.float32), np.empty((11, 16), dtype=np.float32)
    past.fill(1 / RATE, np.array([0], dtype=np.int32), window, weight)
    np.testing.assert_array_equal(weight[:, 0], [1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1])
    np.testing.assert_allclose(window[:, 0] * weight[:, 0], weight[:, 0] * np.arange(10, -1, -1) / RATE, atol=1e-6)


def test_unfit_recordings_are_refused():
    with pytest.raises(MotionError, match='at least one'):
        gather([], 'ab', RATE)
    with pytest.raises(MotionError, match='missing values'):
        gather([('x', np.array([[0.0, np.nan]]))], 'ab', RATE)
    with pytest.raises(MotionError, match='too short'):
        HistorySearch(gather([('x', np.zeros((20, 2)))], 'ab', RATE))


# --------------------------------------------------------------------------------------------- the correction


def test_weights_minimise_the_error_of_people_counted_alike():
    rng = np.random.default_rng(2)
    first = [rng.normal(size=(n, 3, 4)) * np.array([1.0, 2.0, 0.5])[:, None] for n in (50, 80, 30)]
    second = [rng.normal(size=f.shape) + 0.3 * f for f in first]
    (weight,), change = mixing_weights(first, second, ['a', 'a', 'b'])

    def error(w):
        by_recording = [np.mean(((1 - w)[:, None] * f + w[:, None] * s) ** 2, axis=(0, 2))
                        for f, s in zip(first, second)]
        return 0.25 * by_recording[0] + 0.25 * by_recording[1] + 0.5 * by_recording[2]

    best = error(weight)
    for step in (-0.02, 0.02):
        assert (error(np.clip(weight + step, 0, 1)) >= best - 1e-12).all()
    assert ((weight > 0) & (weight < 1)).all()
    assert change == pytest.approx(np.sum(best - error(np.zeros(3))))
    np.testing.assert_array_equal(mixing_weights(first, [10 * one for one in first], ['a', 'a', 'b'])[0], 0.0)


def test_weights_that_fade_are_found_again():
    rng = np.random.default_rng(3)
    wanted = np.array([[0.1, 0.0], [0.7, 0.3]])
    first, second, shares = [], [], []
    for count in (400, 300):
        fresh = np.exp(-np.arange(count) / 60)
        shares.append(np.column_stack([1 - fresh, fresh]))
        apart = rng.normal(size=(count, 2, 3))
        first.append(-(shares[-1] @ wanted)[..., None] * apart)  # so that the weights wanted leave no error
        second.append(first[-1] + apart)
    weight, change = mixing_weights(first, second, ['a', 'b'], shares)
    np.testing.assert_allclose(weight, wanted, atol=1e-6)
    assert change == pytest.approx(-sum(np.mean(f ** 2, axis=(0, 2)).sum() / 2 for f in first))


@pytest.fixture(scope='module')
def people():
    return [made_person(f'p{k}_1', 5 + 0.3 * k, 0.3 * k, k, shift=k)[0] for k in range(6)]


@pytest.fixture(scope='module')
def walk(people):
    some, aligned = align(people, True)
    return learn_residual(bases_from(some, aligned, 'walk', True, NAMES, 3), some, aligned)


@pytest.fixture(scope='module')
def learned(walk, people):
    return learn_correction([walk], [people])


def newcomer(seed=99):
    sequence, _ = made_person('new_1', 5.7, 0.8, seed, shift=1.0)
    return Motion(tuple(NAMES), sequence.y, np.arange(len(sequence.y)) / RATE)


def flat(learned, weight, spread=1.0):
    return Correction(learned.histories, learned.horizons, np.full_like(learned.weight, weight),
                      np.full_like(learned.spread, spread), 1.0)


def test_weight_zero_is_the_filter_and_weight_one_the_memory(walk, learned):
    motion = newcomer()
    plain = roll_out(FullPredictor([walk]), motion, AHEAD)
    nothing = roll_out(CorrectedPredictor(FullPredictor([walk]), flat(learned, 0.0, 1.5)), motion, AHEAD)
    np.testing.assert_array_equal(nothing.mean, plain.mean)
    np.testing.assert_allclose(nothing.std, 1.5 * plain.std)
    predictor = CorrectedPredictor(FullPredictor([walk]), flat(learned, 1.0))
    for time, y in zip(motion.times, motion.positions):
        predictor.update(time, y)
    np.testing.assert_allclose(predictor.predict(AHEAD).mean, predictor.remember(AHEAD)[0])


def test_learned_weights_know_who_is_better_and_the_band_stays_honest(walk, learned):
    assert learned.weight.min() >= 0 and learned.weight.max() <= 1
    assert learned.weight[0].mean() < 0.1 < 0.2 < learned.weight[1].mean()  # what was made is what the filter assumes
    squares, inside = [[], []], []
    for seed in (99, 100, 101, 102):
        motion = newcomer(seed)
        for row, correction in enumerate((flat(learned, 1.0), learned)):
            rollout = roll_out(CorrectedPredictor(FullPredictor([walk]), correction), motion, AHEAD)
            error = (rollout.mean - rollout.actual)[rollout.complete]
            squares[row].append(np.mean(error ** 2))
            if row:
                inside.append(np.abs(error) <= 1.645 * rollout.std[rollout.complete])
    assert np.mean(squares[1]) < 0.3 * np.mean(squares[0])
    assert 0.8 < np.mean(np.concatenate(inside)) < 0.99


def test_velocity_is_that_of_the_mean_and_the_memory_fades(walk, learned):
    motion = newcomer()
    predictor = CorrectedPredictor(FullPredictor([walk]), learned)
    for time, y in zip(motion.times[:100], motion.positions[:100]):
        predictor.update(time, y)
    at = np.array([0.003, 0.04, 0.21, 0.33, 0.5, 0.7])
    prediction = predictor.predict(at)
    slope = (predictor.predict(at + 1e-4).mean - predictor.predict(at - 1e-4).mean) / 2e-4
    np.testing.assert_allclose(prediction.velocity, slope, atol=2e-2)
    alone = FullPredictor([walk])
    for time, y in zip(motion.times[:100], motion.positions[:100]):
        alone.update(time, y)
    far = np.array([0.0, 2 * learned.horizons[-1], 1.5])
    np.testing.assert_allclose(predictor.predict(far).mean, alone.predict(far).mean)
    np.testing.assert_allclose(predictor.predict(far).std, alone.predict(far).std)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10 ** 6))
def test_any_masks_gaps_and_rates_leave_it_finite_and_repeatable(walk, learned, seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([1 / 200, 1 / 60, 1 / 17, 1.3], p=[0.4, 0.5, 0.08, 0.02], size=60))
    motion = newcomer()
    y = np.stack([np.interp(times % motion.times[-1], motion.times, channel) for channel in motion.positions.T], axis=1)
    masks = rng.random(y.shape) < rng.choice([0.0, 0.3, 1.0])
    predictor = CorrectedPredictor(FullPredictor([walk]), learned)
    runs = []
    for hide in (np.nan, 7.0):  # a masked value has no influence, whatever it is
        predictor.reset()
        runs.append([])
        for time, pose, mask in zip(times, y, masks):
            predictor.update(time, np.where(mask, pose, hide), mask)
            prediction = predictor.predict(AHEAD)
            assert np.isfinite(prediction.mean).all() and (prediction.std > 0).all()
            runs[-1].append(prediction.mean)
    np.testing.assert_array_equal(*runs)


def test_refused_observations_change_nothing(walk, learned):
    motion = newcomer()
    one, two = (CorrectedPredictor(FullPredictor([walk]), learned) for _ in range(2))
    with pytest.raises(ValueError):
        one.predict([-0.1])
    for time, y in zip(motion.times[:40], motion.positions[:40]):
        one.update(time, y)
        two.update(time, y)
        for bad in ((time, y), (time + 1, y[:-1]), (time + 1, np.full(len(y), np.inf))):
            with pytest.raises(ValueError):
                one.update(*bad)
    np.testing.assert_array_equal(one.predict(AHEAD).mean, two.predict(AHEAD).mean)
    with pytest.raises(ValueError, match='same joints'):
        CorrectedPredictor(FullPredictor([walk]), Correction(
            gather([('x', np.zeros((60, 6)))], 'abcdef', RATE), learned.horizons, learned.weight, learned.spread, 1.0))


def test_file_holds_histories_and_they_can_be_left_out(walk, learned, tmp_path):
    path = tmp_path / 'm.npz'
    save_behaviours(path, [walk], correction=learned)
    again = load_parts(path)[1]
    for name in ('horizons', 'weight', 'spread', 'fade_s'):
        np.testing.assert_array_equal(getattr(again, name), getattr(learned, name))
    np.testing.assert_array_equal(again.histories.positions, learned.histories.positions)
    motion = newcomer()
    expected = roll_out(CorrectedPredictor(FullPredictor([walk]), learned), motion, AHEAD)
    found = load_predictor(path)
    assert isinstance(found, CorrectedPredictor)
    np.testing.assert_array_equal(roll_out(found, motion, AHEAD).mean, expected.mean)
    assert isinstance(load_predictor(path, without=['histories']), FullPredictor)
    for histories, alone in ((True, found), (False, FullPredictor([walk]))):
        live = load_live(path, 'full', AHEAD, histories=histories).predictor
        np.testing.assert_array_equal(roll_out(live, motion, AHEAD).mean,
                                      roll_out(OpenPredictor(alone, 'walk'), motion, AHEAD).mean)
    assert load_live(path, 'paper', AHEAD).method == 'paper'
    with pytest.raises(UsageError, match='no part'):
        read_predictor(path, without=['magic'])
    header, arrays = model_file.load_model(path)
    old = dict(arrays, **{'histories.weight': arrays['histories.weight'][:2]})  # from before weights faded
    before = {**header, 'histories': {key: value for key, value in header['histories'].items() if key != 'fade_s'}}
    model_file.save_model(tmp_path / 'old.npz', header['kind'], before, old)
    np.testing.assert_array_equal(load_parts(tmp_path / 'old.npz')[1].weight, learned.weight[[0, 1, 0]])
    damages = {'weight': lambda a: a[:, :3], 'lengths': lambda a: a + 1, 'positions': lambda a: a * np.nan,
               'horizons': lambda a: a[::-1]}
    for name, damage in damages.items():
        worse = dict(arrays, **{f'histories.{name}': damage(arrays[f'histories.{name}'])})
        model_file.write_archive(tmp_path / 'worse.npz', header, worse)
        with pytest.raises(ModelError, match='incomplete histories'):
            load_predictor(tmp_path / 'worse.npz')


def test_command_keeps_recordings_only_when_asked_and_says_so(people, tmp_path, capsys):
    files = []
    for sequence in people[:5]:
        motion = Motion(tuple(NAMES), sequence.y, np.arange(len(sequence.y)) / RATE, name=sequence.name)
        write_motion(motion, tmp_path / f'{sequence.name}.csv')
        files.append(str(tmp_path / f'{sequence.name}.csv'))
    plain, with_motion = str(tmp_path / 'plain.npz'), str(tmp_path / 'motion.npz')
    assert main(['train', 'phase-style', *files, '-o', plain, '--styles', '2']) == 0
    assert main(['train', 'phase-style', *files, '-o', with_motion, '--styles', '2', '--histories']) == 0
    assert 'holds recorded motion' in capsys.readouterr().out
    assert main(['info', with_motion]) == 0
    assert 'holds recorded motion of people' in capsys.readouterr().out
    assert main(['info', plain]) == 0
    assert 'recorded motion' not in capsys.readouterr().out
    errors = []
    for more in ([], ['--without', 'histories']):
        assert main(['evaluate', with_motion, files[0], '--json', *more]) == 0
        errors.append(json.loads(capsys.readouterr().out)['recordings']['p0_1']['error_deg2'])
    assert errors[0] < errors[1]  # it remembers this very recording


def test_models_of_the_suite_hold_no_recorded_motion():
    models = sorted((Path(__file__).resolve().parents[3] / 'config' / 'models').glob('*.npz'))
    assert models
    for path in models:
        assert 'histories' not in model_file.read_header(path)


def test_searching_has_weights_of_its_own(walk, learned):
    rows = np.array([np.zeros(len(AHEAD)), np.ones(len(AHEAD)), np.zeros(len(AHEAD))])
    predictor = CorrectedPredictor(FullPredictor([walk]), Correction(
        learned.histories, learned.horizons, rows, np.ones_like(learned.spread), 1.0))
    alone = FullPredictor([walk])
    motion = newcomer()
    seen = set()
    for time, y in zip(motion.times[:90], motion.positions[:90]):
        status = predictor.update(time, y).status
        alone.update(time, y)
        same = np.array_equal(predictor.predict(AHEAD).mean, alone.predict(AHEAD).mean)
        assert same == (status == Status.TRACKING)
        seen.add(same)
    assert seen == {True, False}


def test_memory_fades_after_the_search_and_is_left_alone_once_it_has(walk, learned):
    rows = np.array([np.zeros(len(AHEAD)), np.ones(len(AHEAD)), np.full(len(AHEAD), 0.5)])
    predictor = CorrectedPredictor(FullPredictor([walk]), Correction(
        learned.histories, learned.horizons, rows, np.ones_like(learned.spread), 0.2))
    alone, since, weights = FullPredictor([walk]), None, {}
    for time, y in zip((motion := newcomer()).times[:120], motion.positions):
        status = predictor.update(time, y).status
        alone.update(time, y)
        if status is not Status.TRACKING:
            since = None
            continue
        since = time if since is None else since
        plain, memory = alone.predict(AHEAD).mean, predictor.remember(AHEAD)[0]
        mixed = predictor.predict(AHEAD).mean
        weights[round(time - since, 9)] = np.sum((mixed - plain) * (memory - plain)) / np.sum((memory - plain) ** 2)
    for age, weight in weights.items():
        wanted = 0.5 * np.exp(-age / 0.2)
        assert weight == pytest.approx(wanted if wanted > 0.01 else 0.0, abs=1e-6)
    assert min(weights.values()) == 0 and max(weights.values()) == pytest.approx(0.5)
