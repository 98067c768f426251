"""Parts of a channel against what defines them, and everything that derives from the list of them."""
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_phase_style_full import made_person, walk  # noqa: F401 (fixture)

from style_core.errors import ModelError
from style_core.phase_style import FullPredictor, load_behaviours, save_behaviours
from style_core.phase_style.channel import CHANNEL, covariances_of, parts_of
from style_core.phase_style.full import PARTS
from style_core.phase_style.parts import CYCLE, LEVEL, SMOOTH, Part

PARTS_OF_A_KIND = [Part(LEVEL, 0.7), Part(SMOOTH, 9.0), Part(CYCLE, 0.4, 3)]


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
    (Part(CYCLE, 0.4, 3), lambda lag, turn: np.exp(-0.4 * lag) * np.cos(3 * turn))])
def test_covariance_over_time_is_the_kernel_of_its_kind(part, kernel):
    rng = np.random.default_rng(0)
    times, phases = np.sort(rng.uniform(0, 3, 12)), rng.uniform(0, 6, 12)
    want = kernel(np.abs(times[:, None] - times), phases[:, None] - phases)
    np.testing.assert_allclose(part.covariance(times, phases), want, atol=1e-12)


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
    with np.load(tmp_path / 'm.npz') as file:
        arrays = dict(file)
    text, = (name for name, array in arrays.items() if array.dtype.kind == 'U')
    header = json.loads(str(arrays[text]))
    header['behaviours'][0]['residual.wobble_decay'] = 1.0
    np.savez(tmp_path / 'n.npz', **{**arrays, text: np.array(json.dumps(header))})
    with pytest.raises(ModelError, match='wobble'):
        load_behaviours(tmp_path / 'n.npz')
