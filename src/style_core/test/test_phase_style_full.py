"""The full predictor: search, masks, loss and recovery, behaviours, time."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_phase_style_learning import made_cycle, made_sequence

from style_core.errors import ModelError
from style_core.phase_style import FullPredictor, PaperPredictor, load_predictor, save_behaviours
from style_core.phase_style.arrow_filter import ArrowFilter
from style_core.phase_style.arrow_state import Filter
from style_core.phase_style.full import still_behaviour
from style_core.phase_style.glance import Glance
from style_core.phase_style.hypothesis import Hypothesis
from style_core.phase_style.learning import Sequence, align, bases_from, learn
from style_core.phase_style.residual import learn_residual, leave_out
from style_core.phase_style.settings import BUDGET, CORRELATED, GLANCE_COST, MEMORY, START_COST
from style_core.predictor import Status

NAMES = [f'j{k}' for k in range(6)]
AHEAD = np.arange(1, 26) / 60


def made_person(name, speed, style, seed, shift=0.0, seconds=3.0, rate=60.0, wild=0.0):
    """A walk with the person's own posture and a slow wandering on top."""
    rng = np.random.default_rng(seed)
    sequence, phase = made_sequence(name, speed, shift, style, seconds, rate, 0.003, seed)
    posture = 0.12 * rng.standard_normal(6)
    wander = np.cumsum(rng.standard_normal(sequence.y.shape), axis=0) * 0.002
    return Sequence(name, sequence.group, sequence.y + posture + wander, rate), phase


def made_jump(name, seed, length=70):
    rng = np.random.default_rng(seed)
    u = np.linspace(0, 1, length)[:, None] ** (1 + 0.1 * rng.random())
    y = np.sin(np.pi * u * np.arange(1, 7) / 3) * (1 + 0.1 * rng.standard_normal(6))
    y += 0.05 * rng.standard_normal(6) - 1.5
    return Sequence(name, name.split('_')[0], y + 0.003 * rng.standard_normal(y.shape), 60.0)


@pytest.fixture(scope='module')
def walk():
    people = [made_person(f'p{k}_1', 5 + 0.3 * k, 0.3 * k, k, shift=k)[0] for k in range(6)]
    people, aligned = align(people, True)
    return learn_residual(bases_from(people, aligned, 'walk', True, NAMES, 3), people, aligned)


@pytest.fixture(scope='module')
def jump():
    people = [made_jump(f'q{k}_1', 50 + k, 60 + 5 * k) for k in range(5)]
    people, aligned = align(people, False)
    return learn_residual(bases_from(people, aligned, 'jump', False, NAMES, 2), people, aligned)


def follow(predictor, y, rate=60.0, masks=None, start=0.0):
    """Errors of predictions (T, H, D), standard deviations, estimates."""
    errors, spreads, estimates = [], [], []
    steps = np.maximum(np.rint(AHEAD * rate).astype(int), 1)
    for frame in range(len(y) - steps[-1]):
        mask = None if masks is None else masks[frame]
        estimates.append(predictor.update(start + frame / rate, y[frame], mask))
        prediction = predictor.predict(steps / rate)
        errors.append(prediction.mean - y[frame + steps])
        spreads.append(prediction.std)
    return np.array(errors), np.array(spreads), estimates


def rms(errors):
    return np.sqrt(np.mean(errors ** 2))


def test_new_person_is_followed_from_any_phase_and_better_than_by_the_paper(walk):
    full, paper = FullPredictor([walk]), PaperPredictor(walk)
    for start in np.arange(8) * np.pi / 4:
        y = made_person('n_1', 5.7, 0.8, 99, shift=start)[0].y
        full.reset(), paper.reset()
        errors, spreads, estimates = follow(full, y)
        assert estimates[-1].status is Status.TRACKING and estimates[0].status is Status.ACQUIRING
        assert estimates[-1].behaviours['walk'] > 0.9
        assert estimates[-1].phase_velocity == pytest.approx(5.7, abs=0.4)
        still = np.array([y[t] - y[t + np.arange(1, 26)] for t in range(len(y) - 25)])
        assert rms(errors[30:]) < 0.5 * rms(follow(paper, y)[0][30:])
        assert rms(errors[30:]) < 0.3 * rms(still[30:])
        assert 0.75 < np.mean(np.abs(errors[30:]) < 1.645 * spreads[30:]) <= 1


def test_result_is_reproducible_bit_for_bit(walk):
    y = made_person('n_1', 5.7, 0.8, 7)[0].y
    one = follow(FullPredictor([walk]), y)[0]
    again = FullPredictor([walk])
    follow(again, y[::-1])
    again.reset()
    np.testing.assert_array_equal(one, follow(again, y)[0])


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_masked_channels_have_no_influence(walk, seed):
    rng = np.random.default_rng(seed)
    y = made_person('n_1', 5.5, 0.5, 3, seconds=1.5)[0].y
    masks = rng.random(y.shape) < rng.uniform(0.2, 1)
    garbage = np.where(masks, y, rng.choice([np.nan, 1e6, -2.0], y.shape))
    one, two = FullPredictor([walk]), FullPredictor([walk])
    for frame in range(60):
        a = one.update(frame / 60, np.where(masks[frame], y[frame], 0.0), masks[frame])
        b = two.update(frame / 60, garbage[frame], masks[frame])
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.observed, masks[frame])
        assert np.linalg.eigvalsh(a.phase_covariance).min() > 0 and np.isfinite(a.std).all()


def test_a_limb_that_goes_dark_is_filled_in(walk):
    y = made_person('n_1', 5.7, 0.8, 11, seconds=6)[0].y
    masks = np.ones(y.shape, bool)
    masks[120:, :2] = False
    predictor = FullPredictor([walk])
    estimates = follow(predictor, y, masks=masks)[2]
    filled = np.array([estimate.mean[:2] for estimate in estimates])
    error = filled[120:300] - y[120:300, :2]
    assert rms(error) < 0.25 * np.std(y[:, :2])
    spread = np.array([estimate.std[:2] for estimate in estimates])
    assert spread[250:].mean() > 1.5 * spread[100:119].mean()  # and it says that it knows less


@pytest.mark.parametrize('rate', [30.0, 100.0, 400.0])
def test_any_rate(walk, rate):
    y = made_person('n_1', 5.7, 0.8, 21, seconds=4, rate=rate)[0].y
    errors, _, estimates = follow(FullPredictor([walk]), y, rate)
    assert estimates[-1].status is Status.TRACKING
    assert rms(errors[int(rate):]) < 0.09


@pytest.mark.parametrize('rate', [100.0, 500.0])
def test_hypotheses_are_compared_on_the_same_samples_at_any_rate(walk, rate):
    y = made_person('n_1', 5.7, 0.8, 61, seconds=3, rate=rate)[0].y
    predictor, taken, late = FullPredictor([walk]), set(), 0
    for frame, pose in enumerate(y):
        estimate = predictor.update(frame / rate, pose)
        if estimate.status is Status.TRACKING:
            break
        taken.add(predictor._search.leader.time)
        if frame / rate > predictor._search.leader.time:  # it waits, but what it says is of now
            late += 1
            now = predictor.predict([0.0])
            np.testing.assert_allclose(now.mean[0], estimate.mean)
            np.testing.assert_allclose(now.std[0], estimate.std)
            assert now.times[0] == estimate.time == frame / rate
    assert estimate.status is Status.TRACKING and late > 0
    assert np.diff(sorted(taken)).min() > 0.9 / 60
    for later in (frame + 1, frame + 2):  # alone again it takes every sample
        predictor.update(later / rate, y[later])
        assert predictor._search.leader.time == later / rate


def test_a_jump_of_phase_is_noticed_and_mended(walk):
    one = made_person('n_1', 5.6, 0.5, 31, seconds=2.5)[0].y
    two = made_person('n_1', 5.6, 0.5, 31, shift=np.pi, seconds=2.5)[0].y
    y = np.concatenate([one, two])
    errors, _, estimates = follow(FullPredictor([walk]), y)
    status = [estimate.status for estimate in estimates]
    assert Status.LOST in status[150:165]
    settled = errors[150 + 30:]
    assert rms(settled) < 1.5 * rms(errors[60:120]) + 0.01
    blind = follow(FullPredictor([walk], without=['restart']), y)[0]
    assert rms(errors[155:200]) < rms(blind[155:200])


def walk_with(walk, wrong, seconds=3.0, without=()):
    """Errors of a walk, of the same with observations changed by ``wrong(frame, y)``, and estimates of that."""
    y = made_person('n_1', 5.6, 0.5, 31, seconds=seconds)[0].y
    predictor = FullPredictor([walk], without=without)
    clean = follow(predictor, y)[0]
    predictor.reset()
    estimates, errors = [], []
    for frame in range(len(y) - 25):
        estimates.append(predictor.update(frame / 60, wrong(frame, y[frame].copy())))
        errors.append(predictor.predict(AHEAD).mean - y[frame + np.arange(1, 26)])
    return clean, np.array(errors), estimates


@pytest.mark.parametrize('size', [0.7, 3.0, 5e3])
def test_a_sensor_that_errs_once_is_noticed_and_forgotten(walk, size):
    def spike(frame, y):
        y[3] += size * (frame == 100)
        return y

    clean, errors, estimates = walk_with(walk, spike)
    assert all(estimate.status is Status.TRACKING for estimate in estimates[60:])
    np.testing.assert_array_equal(np.flatnonzero(~estimates[100].observed), [3])
    assert all(estimate.observed.all() for estimate in estimates[101:])
    assert rms(errors[100:130]) < 1.05 * rms(clean[100:130])
    believing = walk_with(walk, spike, without=['rejection'])[1]
    assert rms(believing[100:130]) > 1.5 * rms(clean[100:130])


@pytest.mark.parametrize('first, value', [(0, 7.0), (90, 7.0)])
def test_a_dead_sensor_is_left_out_for_good_whether_from_the_start_or_later(walk, first, value):
    def dead(frame, y):
        if frame >= first:
            y[3] = value
        return y

    clean, errors, estimates = walk_with(walk, dead)
    others = np.arange(6) != 3
    assert not any(estimate.observed[3] for estimate in estimates[max(first, 60):])
    assert estimates[-1].status is Status.TRACKING
    assert rms(errors[100:, :, others]) < 1.3 * rms(clean[100:, :, others])
    assert rms(errors[100:, :, 3]) < 0.3  # filled in as if it were dark


@pytest.mark.parametrize('wrong', [-2.0, 0.0, 2.5])
def test_one_observation_that_is_wrong_altogether_costs_nothing(walk, wrong):
    clean, errors, estimates = walk_with(walk, lambda frame, y: y * 0 + wrong if frame == 100 else y)
    assert not estimates[100].observed.any() and estimates[100].status is Status.LOST
    assert all(estimate.status is Status.TRACKING for estimate in estimates[101:])  # the next one settles it
    assert rms(errors[100:130]) < 1.02 * rms(clean[100:130])


@pytest.mark.parametrize('count', [2, 3])
def test_a_few_observations_that_are_wrong_altogether_are_sat_out(walk, count):
    rng = np.random.default_rng(0)
    clean, errors, estimates = walk_with(
        walk, lambda frame, y: rng.standard_normal(6) * 2 if 100 <= frame < 100 + count else y)
    for estimate in estimates[100:100 + count]:
        assert estimate.status is Status.LOST and not estimate.observed.any() and estimate.behaviours['walk'] == 1
    assert all(estimate.status is Status.TRACKING for estimate in estimates[100 + count:])
    assert rms(errors[100:130]) < 1.05 * rms(clean[100:130])


def test_after_more_of_them_it_is_back_at_once(walk):
    clean, errors, estimates = walk_with(walk, lambda frame, y: y * 0 - 2 if 100 <= frame < 112 else y)
    assert not any(estimate.behaviours['walk'] > 0.5 for estimate in estimates[106:112])  # it stands still, as it seems
    assert all(estimate.status is Status.TRACKING for estimate in estimates[113:])
    assert rms(errors[113:140]) < 1.2 * rms(clean[113:140])


def test_a_search_begins_anew_where_everything_before_was_from_elsewhere(walk):
    clean, errors, _ = walk_with(walk, lambda frame, y: y * 0 + 2.5 if frame < 3 else y)
    assert rms(errors[30:]) < 1.2 * rms(clean[30:]) + 0.01


def test_after_a_loss_nothing_from_before_is_searched(walk):
    predictor = FullPredictor([walk], without=['still'])
    one, two = (made_person(name, 5.6, 0.5, seed, shift=shift, seconds=2.5)[0].y
                for name, seed, shift in (('n_1', 31, 0.0), ('m_1', 32, np.pi)))
    for frame in range(120):
        predictor.update(frame / 60, one[frame])
    for frame in range(30):
        status = predictor.update(2 + frame / 60, two[frame]).status
        if status is Status.LOST:
            break
    assert status is Status.LOST
    np.testing.assert_array_equal(predictor._search.window()[0], two[frame:frame + 1])
    predictor.update(2 + (frame + 1) / 60, two[frame + 1])
    np.testing.assert_array_equal(predictor._search.window()[0], two[frame:frame + 2])


def test_a_phase_that_stands_at_its_slowest_is_lost_whatever_the_innovations_say(walk):
    rng = np.random.default_rng(0)
    still = made_cycle(np.array([1.0]))[0] + 0.002 * rng.standard_normal((120, 6))
    predictor = FullPredictor([walk], without=['still'])
    searched = 0
    for frame, y in enumerate(np.concatenate([made_person('n_1', 5.6, 0.5, 51, seconds=2)[0].y, still])):
        estimate = predictor.update(frame / 60, y)
        slowest = estimate.phase_velocity <= walk.velocity[2]
        searched = searched + 1 if slowest and estimate.status is Status.TRACKING else 0
        assert searched <= 0.1 * 60 + 1
    assert estimate.phase_velocity < 1.5 * walk.velocity[2]  # nothing else is there to take over


def judged(innovations, logs=0.0, tail=1e12, prior=0.0, seen=50):
    one = Hypothesis(0, Filter(), 0, tail, prior)
    for innovation in innovations:
        one.weigh(innovation, logs, seen)
    return one


def test_hypotheses_are_judged_by_their_likelihood_where_sizes_are_known():
    rng = np.random.default_rng(0)
    one, two = 1 + rng.exponential(size=(2, 8))
    weights = MEMORY ** np.arange(8)[::-1]
    wanted = -0.5 * (50 * weights @ (one - two) + weights.sum() * (3.0 - 7.0)) / CORRELATED
    assert judged(one, 3.0).lead(judged(two, 7.0)) == pytest.approx(wanted, rel=1e-9)
    assert judged(one, 3.0, prior=-2.0).lead(judged(two, 7.0)) == pytest.approx(wanted - 2, rel=1e-9)


def test_a_first_sample_that_nobody_expected_is_not_held_against_a_hypothesis_for_long():
    later = [0.8] * 3
    right, wrong = [28.0, *later], [10.0, *(4 * np.array(later))]
    assert judged(right).lead(judged(wrong)) < 0 < judged(right, tail=1.0).lead(judged(wrong, tail=1.0))
    assert judged([28.0], tail=1.0).lead(judged([10.0], tail=1.0)) < 0  # it still counts


def test_a_person_smoother_than_usual_is_judged_by_what_is_usual_for_him():
    follows, stands = [0.1] * 6, [0.4] * 6
    promised = 30.0  # nats by which the one that stands is surer of itself
    assert judged(follows, promised).lead(judged(stands, 0.0)) > 0
    # a Gaussian of the usual size has it the other way round
    assert -0.5 * (50 * (0.1 - 0.4) + promised) < 0


def test_from_standing_to_walking_to_jumping(walk, jump):
    rng = np.random.default_rng(0)
    walking = made_person('n_1', 5.6, 0.5, 41, seconds=3)[0].y
    standing = walking[0] + 0.003 * rng.standard_normal((90, 6))
    leap = made_jump('n_2', 77)
    y = np.concatenate([standing, walking, leap.y, np.repeat(leap.y[-1:], 60, axis=0)])
    predictor = FullPredictor([walk, jump])
    estimates = follow(predictor, y)[2]
    names = [max(estimate.behaviours, key=estimate.behaviours.get) for estimate in estimates]
    assert names[60:88].count('still') > 25
    assert names[90 + 45:90 + 175].count('walk') > 110
    assert 'jump' in names[272:335]
    for estimate in estimates:
        assert sum(estimate.behaviours.values()) == pytest.approx(1) or not any(estimate.behaviours.values())
        assert np.isfinite(estimate.mean).all() and np.isfinite(estimate.std).all()


def test_standing_wanders_as_the_slow_offset_that_wanders_least(walk):
    residual = walk.residual
    slow = replace(walk, name='slow', residual=replace(
        residual, decay={**residual.decay, 'offset': 0.1 * residual.decay['offset']}))
    for behaviours in ([walk], [walk, slow], [slow, walk]):
        still = still_behaviour(behaviours).residual
        least = min(one.residual.decay['offset'] for one in behaviours)
        t = 1e-3
        moved, allowed = (np.mean(2 * variance * -np.expm1(-decay * t)) for variance, decay in (
            (still.variance['offset'], still.decay['offset']), (residual.variance['offset'], least)))
        assert moved == pytest.approx(allowed, rel=1e-3)
        assert still.decay['offset'] < least  # its posture varies more, and so it comes back more slowly


def test_standing_still_is_predicted_as_standing(walk):
    rng = np.random.default_rng(0)
    y = made_cycle(np.array([1.0]))[0] + 0.002 * rng.standard_normal((200, 6))
    errors, _, _ = follow(FullPredictor([walk]), y)
    assert rms(errors[30:]) < 0.02


def test_a_silence_starts_a_new_search(walk):
    y = made_person('n_1', 5.6, 0.5, 51)[0].y
    predictor = FullPredictor([walk])
    follow(predictor, y)
    estimate = predictor.update(20.0, y[0])
    assert estimate.status is Status.ACQUIRING and np.all(estimate.std < 2)


def test_a_shower_of_empty_and_sparse_observations(walk):
    rng = np.random.default_rng(3)
    predictor = FullPredictor([walk])
    time = 0.0
    estimate = predictor.update(time, np.full(6, np.nan))
    assert np.isnan(estimate.innovation) and np.isfinite(estimate.mean).all()
    for _ in range(300):
        time += rng.choice([1e-4, 0.003, 0.02, 0.3, 0.9, 1.5])
        y = np.where(rng.random(6) < 0.3, rng.standard_normal(6) * rng.choice([0.1, 5.0]), np.nan)
        estimate = predictor.update(time, y)
        prediction = predictor.predict(np.array([0.0, 0.1, 3.0]))
        for values in (estimate.mean, estimate.std, prediction.mean, prediction.std, prediction.velocity):
            assert np.isfinite(values).all()
        assert 0 <= estimate.phase_velocity <= walk.velocity[3]


def test_values_no_body_can_have_do_no_harm(walk):
    rng = np.random.default_rng(4)
    y = made_person('n_1', 5.7, 0.8, 91, seconds=6)[0].y
    predictor = FullPredictor([walk])
    for frame, row in enumerate(y):
        if 60 <= frame < 90:
            row = row + rng.standard_normal(6) * rng.choice([1.0, 1e3, 1e9, 1e300])
        estimate = predictor.update(frame / 60, row)
        prediction = predictor.predict(AHEAD)
        for values in (estimate.mean, estimate.std, prediction.mean, prediction.std, prediction.velocity):
            assert np.isfinite(values).all()
    assert estimate.status is Status.TRACKING and rms(estimate.mean - y[-1]) < 0.03


def test_bad_observations_are_refused_and_change_nothing(walk):
    predictor = FullPredictor([walk])
    y = made_cycle(np.array([1.0]))[0]
    predictor.update(0.0, y)
    before = predictor.predict(AHEAD).mean
    for time, row, mask in ((0.0, y, None), (-1.0, y, None), (np.nan, y, None), (1.0, y[:3], None),
                            (1.0, y * np.inf, None), (1.0, y, np.ones(2, bool)), (1.0, y, np.ones(6))):
        with pytest.raises(ValueError):
            predictor.update(time, row, mask)
    np.testing.assert_array_equal(predictor.predict(AHEAD).mean, before)


def test_parts_can_be_left_out_and_matter(walk):
    y = made_person('n_1', 5.7, 0.8, 61, shift=2.0, seconds=5)[0].y
    whole = rms(follow(FullPredictor([walk]), y)[0][30:])
    assert rms(follow(FullPredictor([walk], without=['offset', 'fast', 'personal']), y)[0][30:]) > 1.3 * whole
    with pytest.raises(ValueError, match='no part'):
        FullPredictor([walk], without=['wheels'])


def test_prediction_at_nine_knots_is_close_to_all(walk):
    y = made_person('n_1', 5.7, 0.8, 71)[0].y
    predictor = FullPredictor([walk])
    for frame in range(100):
        predictor.update(frame / 60, y[frame])
    dense = predictor.predict(AHEAD)
    each = np.array([predictor.predict(AHEAD[h:h + 1]).std[0] for h in range(25)])
    np.testing.assert_allclose(dense.std, each, rtol=0.08)
    singly = np.array([predictor.predict(AHEAD[h:h + 1]).mean[0] for h in range(25)])
    np.testing.assert_allclose(dense.mean, singly, atol=1e-12)


def test_residual_rule_leaves_people_out(walk):
    people = [made_person(f'p{k}_{n}', 5 + 0.3 * k, 0.3 * k, k)[0] for k in range(5) for n in range(2)]
    people, aligned = align(people, True)
    folds = leave_out(people, aligned, bases_from(people, aligned, 'walk', True, NAMES, 3))
    assert len(folds) == 5
    for fold in folds:
        assert len(fold.left_out) == 2
        assert not {people[index].group for index in fold.left_out} & set(fold.groups)
    aligned = align(people[:6], True)[1]
    few = leave_out(people[:6], aligned, bases_from(people[:6], aligned, 'walk', True, NAMES, 3))
    assert len(few) == 6 and all(len(fold.left_out) == 1 for fold in few)


def test_model_without_residual_is_refused(tmp_path):
    people = [made_person(f'p{k}_1', 5 + 0.3 * k, 0.3 * k, k)[0] for k in range(3)]
    bare = learn(people, NAMES, 'walk', True, 2)
    with pytest.raises(ModelError, match='no residual'):
        FullPredictor([bare])
    save_behaviours(tmp_path / 'm.npz', [bare])
    assert isinstance(load_predictor(tmp_path / 'm.npz', method='paper'), PaperPredictor)


def test_predictor_from_a_file_is_the_same(walk, jump, tmp_path):
    save_behaviours(tmp_path / 'm.npz', [walk, jump])
    y = made_person('n_1', 5.7, 0.8, 81, seconds=1.5)[0].y
    np.testing.assert_array_equal(follow(load_predictor(tmp_path / 'm.npz'), y)[0],
                                  follow(FullPredictor([walk, jump]), y)[0])


DONE = []  # the work of an observation


class CountedFilter(ArrowFilter):
    def update(self, *args):
        DONE.append(('update', 1))
        return super().update(*args)

    def start(self, *args):
        DONE.append(('start', START_COST))
        return super().start(*args)


class CountedGlance(Glance):
    def peaks(self, y, observed, back, speeds, scores, phases):
        DONE.append(('glance', GLANCE_COST * (1 + speeds)))
        return super().peaks(y, observed, back, speeds, scores, phases)


@pytest.mark.parametrize('rate', [60.0, 240.0])
def test_work_on_one_observation_is_bounded(walk, jump, rate, monkeypatch):
    monkeypatch.setattr('style_core.phase_style.full.ArrowFilter', CountedFilter)
    monkeypatch.setattr('style_core.phase_style.full_predictor.Glance', CountedGlance)
    predictor = FullPredictor([walk, jump])
    predictor.reset()
    people = [made_person(f'n{k}_1', 5 + 0.4 * k, 0.2 * k, 50 + k, shift=2 * k, seconds=1.5, rate=rate)[0].y
              for k in range(5)]
    most, glances = 0, 0
    for frame, y in enumerate(np.concatenate(people)):
        DONE.clear()
        searches = predictor._search.searching
        predictor.update(frame / rate, y)
        work = sum(cost for _, cost in DONE)
        assert work <= BUDGET + 1e-9
        assert ('update', 1) in DONE or (searches and rate > 60)
        most, glances = max(most, work), glances + sum(what == 'glance' for what, _ in DONE)
    assert most > 2 and glances > 20  # it did search
