"""Learning the phase-style model: alignment, factorisation, Gaussian processes, the model file."""
import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from style_core import model_file
from style_core.alignment import cycle_shift, fit_cycle, harmonic_design, period
from style_core.errors import ModelError, MotionError
from style_core.phase_style import Sequence, learn, load_behaviours, save_behaviours
from style_core.phase_style.basis_table import NODES, tabulate
from style_core.phase_style.gaussian_process import embed, fit_process, negative_log_marginal
from style_core.phase_style.learning import align_discrete, align_rhythmic, choose_dimension, factorise, split_gaits
from style_core.phase_style.style_prior import gaits_of, style_prior, styles_in_gait


def made_cycle(phase, style=0.0):
    """Six channels over phase; ``style`` changes their shape."""
    order = np.arange(1, 7)
    return 0.4 * np.sin(phase[:, None] + order) + 0.15 * (1 + style) * np.cos(2 * phase[:, None] + 2 * order) \
        + 0.2 * style * np.sin(order)


def made_sequence(name, speed, shift, style=0.0, seconds=3.0, rate=60.0, noise=0.0, seed=0):
    phase = speed * np.arange(int(seconds * rate)) / rate + shift
    rng = np.random.default_rng(seed)
    y = made_cycle(phase, style)
    return Sequence(name, name.split('_')[0], y + noise * rng.standard_normal(y.shape), rate), phase


@given(st.floats(0.5, 2.0), st.floats(2.2, 6.0), st.integers(0, 1000))
def test_period_is_found_to_a_fraction_of_a_frame(length, cycles, seed):
    rate = 60.0
    sequence, _ = made_sequence('a_1', 2 * np.pi / length, 1.0, seconds=cycles * length, noise=0.01, seed=seed)
    assert period(sequence.y, rate) == pytest.approx(length, abs=0.35 / rate)


def test_period_does_not_see_posture_or_double_cycles():
    sequence, _ = made_sequence('a_1', 2 * np.pi / 1.1, 0.3, seconds=6)
    assert period(sequence.y + 10.0, 60.0) == pytest.approx(1.1, abs=0.006)


@pytest.mark.parametrize('y, words', [(np.zeros((5, 2)), 'too few'), (np.ones((200, 2)), 'nothing moves'),
                                      (np.arange(200.0)[:, None], 'no repetition')])
def test_recordings_without_a_period_are_refused(y, words):
    with pytest.raises(MotionError, match=words):
        period(y, 60.0)


@given(st.floats(0, 2 * np.pi))
def test_shift_is_found_between_samples(shift):
    grid = np.arange(100) * 2 * np.pi / 100
    found = cycle_shift(made_cycle(grid), made_cycle(grid - shift))
    assert abs((found - shift + np.pi) % (2 * np.pi) - np.pi) < 2e-3


def test_cycle_uses_all_cycles():
    sequence, phase = made_sequence('a_1', 6.0, 0.0, seconds=10, noise=0.2, seed=3)
    grid = np.linspace(0, 2 * np.pi, 50)
    design = harmonic_design(grid, 6)[0]
    errors = [np.std(design @ fit_cycle(sequence.y[:n], phase[:n]) - made_cycle(grid)) for n in (63, 600)]
    assert errors[1] < 0.5 * errors[0]


def test_harmonic_design_has_its_derivative():
    phase = np.linspace(0, 7, 30)
    step = 1e-6
    difference = (harmonic_design(phase + step, 5)[0] - harmonic_design(phase - step, 5)[0]) / (2 * step)
    np.testing.assert_allclose(harmonic_design(phase, 5)[1], difference, atol=1e-8)


def test_alignment_recovers_shifts_speeds_and_wandering_phase():
    rng = np.random.default_rng(1)
    sequences, truth = [], []
    for index in range(6):
        speed = 5 + index * 0.4 + np.cumsum(rng.standard_normal(240)) * 0.04
        phase = np.cumsum(speed) / 60 + rng.uniform(0, 6)
        y = made_cycle(phase, 0.1 * index) + 0.01 * rng.standard_normal((240, 6))
        sequences.append(Sequence(f's{index}_1', f's{index}', y, 60.0))
        truth.append(phase)
    aligned = align_rhythmic(sequences)
    common = np.angle(np.mean([np.mean(np.exp(1j * (p - q))) for p, q in zip(aligned.phases, truth)]))
    error = np.concatenate([np.angle(np.exp(1j * (p - q - common))) for p, q in zip(aligned.phases, truth)])
    assert np.sqrt(np.mean(error ** 2)) < 0.06
    # the density of the acceleration that was simulated, to a factor of a few
    assert 0.2 < aligned.acceleration / (0.04 ** 2 * 60) < 5


def test_discrete_alignment_starts_at_zero_and_ends_at_one():
    sequences = []
    for index, length in enumerate((60, 90, 120)):
        u = np.linspace(0, 1, length) ** (1 + 0.3 * index)
        sequences.append(Sequence(f'j{index}', 'j', np.stack([np.sin(3 * u), u ** 2, np.cos(5 * u)], 1), 60.0))
    aligned = align_discrete(sequences)
    spread = np.ptp(aligned.cycles, axis=0)
    for phase in aligned.phases:
        assert phase[0] == 0 and phase[-1] == pytest.approx(1) and np.all(np.diff(phase) >= 0)
    linear = np.ptp([np.stack([np.interp(aligned.grid, np.linspace(0, 1, len(s.y)), c) for c in s.y.T], 1)
                     for s in sequences], axis=0)
    assert spread.mean() < 0.4 * linear.mean()


@given(st.integers(2, 8), st.integers(0, 99))
def test_factorisation_is_the_best_of_its_rank(dimension, seed):
    cycles = np.random.default_rng(seed).standard_normal((8, 20, 5))
    styles, bases, values = factorise(cycles, dimension)
    assert styles.shape == (8, dimension) and bases.shape == (dimension, 20, 5) and values.shape == (8,)
    np.testing.assert_allclose(styles.T @ styles, np.eye(dimension), atol=1e-12)
    left = cycles - np.tensordot(styles, bases, axes=1)
    assert np.sum(left ** 2) == pytest.approx(np.sum(values[dimension:] ** 2), abs=1e-9)


def test_style_dimension_follows_the_singular_values():
    assert choose_dimension([100, 10, 0.1, 0.1]) == 2
    assert choose_dimension([100, 10, 9, 8, 0.1]) == 4
    assert choose_dimension([100, 0, 0]) == 1
    with pytest.raises(MotionError, match='at least as many'):
        factorise(np.ones((3, 4, 2)), 4)


@pytest.mark.parametrize('rhythmic', [True, False])
def test_gaussian_process_agrees_with_scikit_learn(rhythmic):
    rng = np.random.default_rng(0)
    span = 2 * np.pi if rhythmic else 1.0
    phase = np.arange(40) * span / 40
    outputs = made_cycle(phase * (1 if rhythmic else 6))[:, :3] + 0.01 * rng.standard_normal((40, 3))
    process = fit_process(phase, outputs, rhythmic)
    b1, b2, b3 = process.beta
    kernel = ConstantKernel(b1, 'fixed') * RBF(b2 ** -0.5, 'fixed') + WhiteKernel(1 / b3, 'fixed')
    peer = GaussianProcessRegressor(kernel, optimizer=None, alpha=0).fit(embed(phase, rhythmic), outputs)
    at = rng.uniform(0, span, 25)
    mean, std = peer.predict(embed(at, rhythmic), return_std=True)
    std = np.asarray(std).reshape(25, -1)[:, 0]
    value, slope, variance = process.evaluate(at)
    np.testing.assert_allclose(value, mean, atol=1e-9)
    np.testing.assert_allclose(variance, std ** 2 - 1 / b3, atol=1e-8 * b1)
    step = 1e-5 * span
    difference = (process.evaluate(at + step)[0] - process.evaluate(at - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope, difference, atol=1e-6 * np.abs(slope).max())
    # the optimiser leaves nothing on the table against scikit-learn's own search from several starts
    free = ConstantKernel(b1, (1e-4, 1e5)) * RBF(b2 ** -0.5, (1e-2, 1e2)) + WhiteKernel(1 / b3, (1e-9, 1e1))
    better = GaussianProcessRegressor(free, alpha=0, n_restarts_optimizer=2, random_state=0)
    better.fit(embed(phase, rhythmic), outputs)
    own = peer.log_marginal_likelihood_value_
    assert better.log_marginal_likelihood_value_ <= own + 0.5 + 1e-3 * abs(own)


def test_marginal_likelihood_gradient():
    rng = np.random.default_rng(2)
    z = embed(np.arange(20) * 0.3, True)
    distance = np.sum((z[:, None] - z[None]) ** 2, -1)
    y = rng.standard_normal((20, 4))
    at = np.log([0.7, 1.3, 30.0])
    gradient = negative_log_marginal(at, distance, y @ y.T, 4)[1]
    for index in range(3):
        step = np.eye(3)[index] * 1e-6
        difference = (negative_log_marginal(at + step, distance, y @ y.T, 4)[0]
                      - negative_log_marginal(at - step, distance, y @ y.T, 4)[0]) / 2e-6
        assert gradient[index] == pytest.approx(difference, rel=1e-5)


@pytest.fixture(scope='module')
def behaviour():
    sequences = [made_sequence(f'p{k}_1', 5 + 0.3 * k, k, 0.3 * k, noise=0.01, seed=k)[0] for k in range(5)]
    return learn(sequences, [f'j{k}' for k in range(6)], 'walk', dimension=3)


@pytest.mark.parametrize('rhythmic', [True, False])
def test_table_is_close_to_the_processes(rhythmic):
    span = 2 * np.pi if rhythmic else 1.0
    phase = np.linspace(0, span, 100, endpoint=not rhythmic)
    outputs = np.stack([np.sin(2 * np.pi * k * phase / span + k) / k for k in range(1, 7)], axis=1)
    process = fit_process(phase, outputs, rhythmic)
    from style_core.phase_style.basis_table import Table
    table = Table(tabulate([process], rhythmic))
    at = np.random.default_rng(0).uniform(0, span, 300)
    value, slope, _ = process.evaluate(at)
    looked = np.array([table.evaluate(phase) for phase in at])
    assert np.abs(looked[:, 0, 0] - value).max() < 1e-4 * np.abs(value).max()
    assert np.abs(looked[:, 1, 0] - slope).max() < 1e-3 * np.abs(slope).max()
    assert NODES < 200  # 1e-4 is bought with few nodes: the table stays in the processor's cache


def test_model_survives_its_file(behaviour, tmp_path):
    path = tmp_path / 'walk.npz'
    save_behaviours(path, [behaviour])
    again, = load_behaviours(path)
    for item in dataclasses.fields(behaviour):
        one, two = getattr(behaviour, item.name), getattr(again, item.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, two)
        else:
            assert one == two


def test_damaged_models_are_refused(behaviour, tmp_path):
    path = tmp_path / 'walk.npz'
    save_behaviours(path, [behaviour])
    header, arrays = model_file.load_model(path)
    for spoiled in ({'0.bases': arrays['0.bases'][:, :, :2]}, {'0.noise': arrays['0.noise'] * np.nan},
                    {'0.velocity': np.zeros(2)}):
        other = tmp_path / 'bad.npz'
        with pytest.raises(ModelError, match='not written'):
            model_file.save_model(other, 'phase-style', header, {**arrays, **spoiled})
        model_file.write_archive(other, header, {**arrays, **spoiled})
        with pytest.raises(ModelError, match='incomplete'):
            load_behaviours(other)
    del arrays['0.styles']
    model_file.write_archive(tmp_path / 'worse.npz', header, arrays)
    with pytest.raises(ModelError, match='incomplete'):
        load_behaviours(tmp_path / 'worse.npz')
    with pytest.raises(ModelError, match='different names'):
        save_behaviours(path, [behaviour, behaviour])


def test_a_file_from_before_gaits_loads_as_one(behaviour, tmp_path):
    path = tmp_path / 'two.npz'
    two = dataclasses.replace(behaviour, gaits=np.arange(len(behaviour.gaits)) % 2)
    save_behaviours(path, [two])
    np.testing.assert_array_equal(load_behaviours(path)[0].gaits, two.gaits)
    assert len(gaits_of(two)) == 2
    header, arrays = model_file.load_model(path)
    arrays = {name: array for name, array in arrays.items() if name not in ('0.gaits', '0.speeds')}
    model_file.save_model(path, 'phase-style', {key: header[key] for key in ('joint_names', 'behaviours')}, arrays)
    old = load_behaviours(path)[0]
    assert gaits_of(old) == [old]
    np.testing.assert_array_equal(old.styles, behaviour.styles)


def made_gaits(seed, apart, shared=True):
    """Cycles (10, 20, 4) of five people, each in two gaits ``apart`` from each other; speeds; people."""
    rng = np.random.default_rng(seed)
    person = np.repeat(rng.standard_normal((5, 20, 4)), 2, axis=0)
    gait = np.tile([0, 1], 5)
    cycles = person + apart * gait[:, None, None] * rng.standard_normal((20, 4)) \
        + 0.1 * rng.standard_normal((10, 20, 4))
    people = [f'p{k // 2}' if shared else f'p{k // 2}{k % 2}' for k in range(10)]
    return cycles, np.stack([5 + 3 * gait, np.full(10, 0.1)], 1), people, gait


@given(st.integers(0, 99))
def test_two_gaits_are_told_apart_and_one_stays_whole(seed):
    cycles, speeds, people, gait = made_gaits(seed, 10.0)
    np.testing.assert_array_equal(split_gaits(cycles, speeds, people), gait)
    assert not split_gaits(cycles, speeds, made_gaits(seed, 10.0, shared=False)[2]).any()  # people, not gaits
    assert not split_gaits(cycles[:5], speeds[:5], people[:5]).any()  # too few
    even = np.linspace(0, 1, 12)[:, None, None] * cycles[:1]
    assert not split_gaits(even, np.tile([[5.0, 0.1]], (12, 1)), ['p'] * 12).any()


def test_styles_move_to_the_mean_of_a_gait():
    rng = np.random.default_rng(0)
    styles, groups, gaits = rng.standard_normal((7, 3)), ('a', 'a', 'b', 'b', 'c', 'c', 'c'), np.array([0, 1] * 3 + [1])
    for gait in (0, 1):
        moved, labels = styles_in_gait(styles, groups, gaits, gait)
        own = gaits == gait
        np.testing.assert_allclose(moved[own], styles[own])
        mean, _ = style_prior(styles[own], [g for g, k in zip(groups, own) if k], 1.0)
        np.testing.assert_allclose(style_prior(moved, labels, 1.0)[0], mean, atol=1e-12)
