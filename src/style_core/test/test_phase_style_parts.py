"""Parts of a channel against what defines them, and everything that derives from the list of them."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from test_phase_style_arrow import made_table
from test_phase_style_full import made_person, walk  # noqa: F401 (fixture)

from style_core import model_file
from style_core.errors import ModelError
from style_core.phase_style import KIND, FullPredictor, load_behaviours, save_behaviours
from style_core.phase_style.arrow_filter import ArrowFilter
from style_core.phase_style.channel import CHANNEL, covariances_of, parts_of
from style_core.phase_style.full import PARTS
from style_core.phase_style.model import restore_behaviours
from style_core.phase_style.parts import CYCLE, LEVEL, SMOOTH, SMOOTHER, Part

PARTS_OF_A_KIND = [Part(LEVEL, 0.7), Part(SMOOTH, 9.0), Part(SMOOTHER, 9.0), Part(CYCLE, 0.4, 3)]


@pytest.mark.parametrize('part', PARTS_OF_A_KIND)
@given(st.floats(0, 2), st.floats(0, 2))
def test_two_steps_are_one_and_keep_the_prior(part, t, s):
    np.testing.assert_allclose(part.transition(t) @ part.transition(s), part.transition(t + s), atol=1e-12)
    P0, G = part.prior(), part.transition(t)
    assert np.linalg.eigvalsh(P0 - G @ P0 @ G.T).min() > -1e-9 * np.trace(P0)  # what is new is a covariance
    w = part.weights(0.8)[0]
    assert w @ P0 @ w == pytest.approx(1)


@pytest.mark.parametrize('part', PARTS_OF_A_KIND)
def test_weights_have_their_derivative(part):
    slope = part.weights(0.8)[1]
    np.testing.assert_allclose(slope, (part.weights(0.8 + 1e-6)[0] - part.weights(0.8 - 1e-6)[0]) / 2e-6, atol=1e-8)


@pytest.mark.parametrize('part, kernel', [
    (Part(LEVEL, 0.7), lambda lag, turn: np.exp(-0.7 * lag)),
    (Part(SMOOTH, 9.0), lambda lag, turn: (1 + 9 * lag) * np.exp(-9 * lag)),
    (Part(SMOOTHER, 9.0), lambda lag, turn: (1 + 9 * lag + 27 * lag ** 2) * np.exp(-9 * lag)),
    (Part(CYCLE, 0.4, 3), lambda lag, turn: np.exp(-0.4 * lag) * np.cos(3 * turn))])
def test_covariance_over_time_is_the_kernel_of_its_kind(part, kernel):
    rng = np.random.default_rng(0)
    times, phases = np.sort(rng.uniform(0, 3, 12)), rng.uniform(0, 6, 12)
    want = kernel(np.abs(times[:, None] - times), phases[:, None] - phases)
    np.testing.assert_allclose(part.covariance(times, phases), want, atol=1e-12)


@pytest.mark.parametrize('part', PARTS_OF_A_KIND)
def test_a_filter_with_a_part_of_any_kind_is_the_dense_one(part):
    """One channel whose phase is known and stands still: a linear Kalman filter over a level and the part."""
    rng = np.random.default_rng(3)
    table = made_table(rng, 0, 1)
    one = ArrowFilter(table, [(Part(LEVEL, 0.3), np.array([0.02])), (part, np.array([0.05]))], np.array([1e-3]), 0.0,
                      0.0, (0.0, 1.0))
    one.start(0.8, 0.0, 1e-12, 1e-12)
    level = Part(LEVEL, 0.3)
    s = np.concatenate([level.weights(0.8)[0], part.weights(0.8)[0]])
    P0 = block_diag(0.02 * level.prior(), 0.05 * part.prior())
    u, V, base = np.zeros(len(s)), P0.copy(), table.evaluate(0.8)[0][0, 0]
    for step in range(12):
        dt = rng.uniform(0.02, 0.1) if step else 0.0
        G = block_diag(level.transition(dt), part.transition(dt))
        u, V = G @ u, G @ V @ G.T + P0 - G @ P0 @ G.T
        y = base + 0.2 * rng.standard_normal()
        one.update(np.array([y]), np.ones(1, np.uint8), dt)
        gain = V @ s / (s @ V @ s + 1e-3)
        u, V = u + gain * (y - base - s @ u), V - np.outer(gain, s @ V)
        np.testing.assert_allclose(one.residuals[:, 0], u, atol=1e-6 * np.abs(u).max())
        np.testing.assert_allclose(one.marginal(0)[1][2:, 2:], V, atol=1e-6 * np.abs(V).max())
    mean, std, velocity = one.forecast(np.array([0.2, 0.2 + 1e-6]))
    G = block_diag(level.transition(0.2), part.transition(0.2))
    assert mean[0, 0] == pytest.approx(base + s @ G @ u, abs=1e-6)
    assert std[0, 0] ** 2 == pytest.approx(s @ (G @ V @ G.T + P0 - G @ P0 @ G.T) @ s + 1e-3, rel=1e-5)
    assert velocity[0, 0] == pytest.approx((mean[1, 0] - mean[0, 0]) / 1e-6, abs=1e-4)


def test_ingredients_make_up_filter_and_smoother_alike(walk):  # noqa: F811
    """The covariance between two times that the parts give the filter is that which the smoother works on."""
    times, phases = np.array([0.0, 0.13]), np.array([1.0, 1.8])
    residual, total = walk.residual, 0.0
    for part, variance in parts_of(residual, True):
        later, earlier = part.weights(phases[1])[0], part.weights(phases[0])[0]
        total = total + variance * (later @ part.transition(0.13) @ part.prior() @ earlier)
    found = sum(variance * covariance[0, 1] for covariance, variance in covariances_of(residual, True, times, phases))
    np.testing.assert_allclose(found, total, rtol=1e-12)


@pytest.mark.parametrize('name', [one.name for one in CHANNEL])
def test_every_ingredient_can_be_left_out(walk, name):  # noqa: F811
    assert name in PARTS
    y = made_person('n_1', 5.7, 0.8, 61, seconds=1.0)[0].y
    whole, without = FullPredictor([walk]), FullPredictor([walk], without=[name])
    for frame in range(50):
        one, two = (predictor.update(frame / 60, y[frame]) for predictor in (whole, without))
    assert np.abs(one.mean - two.mean).max() > 1e-7 and np.isfinite(two.mean).all()


def test_a_model_from_before_an_ingredient_has_none_of_it(walk):  # noqa: F811
    residual = walk.residual
    older = replace(walk, residual=replace(
        residual, variance={name: residual.variance[name] for name in ('offset', 'fast')},
        decay={name: residual.decay[name] for name in ('offset', 'fast')}, share={}))
    assert [part.size for part, _ in parts_of(older.residual, True)] == [1, 2]
    assert np.isfinite(FullPredictor([older]).update(0.0, np.zeros(6)).mean).all()


def test_ingredients_in_a_file_are_those_that_were_saved_and_an_unknown_one_is_refused(walk, tmp_path):  # noqa: F811
    save_behaviours(tmp_path / 'm.npz', [walk])
    back = load_behaviours(tmp_path / 'm.npz')[0].residual
    for what in ('variance', 'decay', 'share'):
        saved, read = getattr(walk.residual, what), getattr(back, what)
        assert saved.keys() == read.keys()
        for name in saved:
            np.testing.assert_array_equal(saved[name], read[name])
    header, arrays = model_file.load_model(tmp_path / 'm.npz', KIND)
    header['behaviours'][0]['residual.wobble_decay'] = 1.0
    with pytest.raises(ModelError, match='wobble'):
        restore_behaviours(header, arrays, 'it')
