"""The published method: against exact references, with masks, forgetting and discrete phases."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_phase_style_learning import made_cycle, made_sequence

from style_core.phase_style import PaperPredictor, Sequence, learn
from style_core.phase_style.basis_table import NODES, BasisTable, Table
from style_core.phase_style.matsubara_filter import MatsubaraFilter
from style_core.predictor import Status

NAMES = [f'j{k}' for k in range(6)]


@pytest.fixture(scope='module')
def behaviour():
    sequences = [made_sequence(f'p{k}_1', 5 + 0.3 * k, k, 0.3 * k, noise=0.02, seed=k)[0] for k in range(5)]
    return learn(sequences, NAMES, 'walk', dimension=3)


def linear_table(bases, slopes):
    """Discrete table of bases that are straight lines over phase: the EKF is then an exact Kalman filter."""
    phase = np.linspace(0, 1, NODES + 1)[:, None, None]
    values = bases + slopes * phase
    return Table(BasisTable(np.ascontiguousarray(values), np.broadcast_to(slopes / NODES, values.shape).copy(),
                            np.zeros((NODES + 1, len(bases))), False))


@given(st.integers(0, 10_000))
def test_filter_on_a_linear_model_is_the_kalman_filter_whatever_is_masked(seed):
    rng = np.random.default_rng(seed)
    channels = 5
    base, slope = np.round(1024 * rng.standard_normal((2, 1, channels))) / 1024  # a table holds these exactly
    noise = rng.uniform(0.05, 0.2, channels)
    one = MatsubaraFilter(linear_table(base, slope), noise, 0.01, np.ones(1), 1 - 1e-12, 1 / 60)
    one.start(0.5, 0.0, 1e-3, 1e-3)
    x, p = np.array([0.5, 0.0]), np.diag([1e-3, 1e-3])
    true = 0.5
    for _ in range(6):
        dt = rng.uniform(0.005, 0.05)
        true += 0.02 * dt
        y = (base + slope * true)[0] + np.sqrt(noise) * rng.standard_normal(channels) * 0.1
        seen = rng.random(channels) < 0.6
        f = np.array([[1, dt], [0, 1]])
        x, p = f @ x, f @ p @ f.T + 0.01 * np.array([[dt ** 3 / 3, dt ** 2 / 2], [dt ** 2 / 2, dt]])
        # the style was refitted after the update before: use what the filter itself believes
        w = one.style[0]
        h = np.stack([w * slope[0][seen], np.zeros(seen.sum())], axis=1)
        s = h @ p @ h.T + np.diag(noise[seen])
        error = y[seen] - w * (base[0][seen] + slope[0][seen] * x[0])
        gain = p @ h.T @ np.linalg.inv(s)
        want = -0.5 * (error @ np.linalg.solve(s, error) + np.linalg.slogdet(2 * np.pi * s)[1])
        x, p = x + gain @ error, p - gain @ h @ p
        one.update(np.where(seen, y, np.nan), seen.astype(np.uint8), dt)
        if not 0.02 < x[0] < 0.98:
            return  # at the ends the phase is clamped and no longer linear
        np.testing.assert_allclose([one.phase, one.velocity], x, atol=1e-9)
        np.testing.assert_allclose(one.covariance, p, atol=1e-12)
        assert one.log_likelihood == pytest.approx(want, abs=1e-8)
        assert np.linalg.eigvalsh(one.covariance).min() > -1e-15


def run_filter(behaviour, y, forgetting, observed=None):
    from style_core.phase_style.basis_table import tabulate
    table = Table(tabulate(behaviour.processes(), True))
    one = MatsubaraFilter(table, behaviour.noise, behaviour.acceleration, behaviour.styles.mean(0), forgetting, 1 / 60)
    one.start(1.0, 5.0, 0.1, 0.1)
    phases, styles = [], []
    for k, row in enumerate(y):
        seen = np.ones(len(row), np.uint8) if observed is None else observed[k].astype(np.uint8)
        one.update(row, seen, 1 / 60 if k else 0.0)
        phases.append(one.phase)
        styles.append(one.style)
    return table, one, np.array(phases), np.array(styles)


@pytest.mark.parametrize('forgetting', [1.0, 0.95, 0.8])
def test_on_line_em_is_the_batch_weighted_mean(behaviour, forgetting):
    y = made_sequence('x_1', 5.2, 1.0, 0.5, seconds=1)[0].y
    table, one, phases, _ = run_filter(behaviour, y, forgetting)
    basis = np.array([table.evaluate(phase)[0] for phase in phases])  # (T, J, D)
    weight = forgetting ** np.arange(len(y))[::-1]
    normal = np.einsum('t,tjd,tkd->jk', weight, basis, basis)
    moment = np.einsum('t,tjd,td->j', weight, basis, y)
    np.testing.assert_allclose(one.style, np.linalg.solve(normal, moment), rtol=1e-5)
    assert one.learning_rate == pytest.approx(1 / weight.sum())


@given(st.integers(0, 10_000))
def test_masked_channels_have_no_influence(behaviour, seed):
    rng = np.random.default_rng(seed)
    y = made_sequence('x_1', 5.2, 1.0, 0.5, seconds=0.5)[0].y
    observed = rng.random(y.shape) < rng.uniform(0.1, 1)
    garbage = np.where(observed, y, rng.choice([np.nan, 1e6, -3.0], y.shape))
    one = run_filter(behaviour, np.where(observed, y, 0.0), 0.9, observed)
    two = run_filter(behaviour, garbage, 0.9, observed)
    np.testing.assert_array_equal(one[2], two[2])
    np.testing.assert_array_equal(one[3], two[3])
    assert np.linalg.eigvalsh(one[1].covariance).min() >= 0


def test_search_finds_any_phase(behaviour):
    for start in np.arange(12) * 2 * np.pi / 12:
        y = made_sequence('x_1', 5.6, start, 0.4, seconds=2.5, noise=0.01, seed=7)[0].y
        predictor = PaperPredictor(behaviour)
        errors = []
        for k in range(len(y) - 10):
            estimate = predictor.update(k / 60, y[k])
            errors.append(predictor.predict(np.array([10 / 60])).mean[0] - y[k + 10])
        assert estimate.status is Status.TRACKING
        assert np.sqrt(np.mean(np.array(errors[60:]) ** 2)) < 0.03


def test_time_steps_may_vary(behaviour):
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.002, 0.05, 300))
    y = made_cycle(5.6 * times + 2.0, 0.4)
    predictor = PaperPredictor(behaviour)
    for time, row in zip(times, y):
        estimate = predictor.update(time, row)
    assert estimate.phase_velocity == pytest.approx(5.6, abs=0.3)
    ahead = np.array([0.05, 0.2, 0.33])
    prediction = predictor.predict(ahead)
    np.testing.assert_allclose(prediction.times, times[-1] + ahead)
    np.testing.assert_allclose(prediction.mean, made_cycle(5.6 * (times[-1] + ahead) + 2.0, 0.4), atol=0.06)
    step = 1e-5
    later = predictor.predict(ahead + step).mean
    np.testing.assert_allclose(prediction.velocity, (later - prediction.mean) / step, atol=2e-2)
    assert np.all(prediction.std > 0)


def test_discrete_phase_stays_between_start_and_goal():
    sequences = []
    for k in range(4):
        u = np.linspace(0, 1, 70 + 10 * k)[:, None] * np.ones(6)
        sequences.append(Sequence(f'j{k}_1', f'j{k}', np.sin(3 * u + np.arange(6)) * (1 + 0.1 * k), 60.0))
    jump = learn(sequences, NAMES, 'jump', rhythmic=False, dimension=2)
    predictor = PaperPredictor(jump)
    u = np.linspace(0, 1, 80)[:, None] * np.ones(6)
    y = np.sin(3 * u + np.arange(6))
    rng = np.random.default_rng(0)
    for k in range(200):
        row = y[min(k, 79)] + 0.05 * rng.standard_normal(6)
        estimate = predictor.update(k / 60, row)
        assert 0 <= estimate.phase <= 1
        prediction = predictor.predict(np.array([0.0, 0.5, 100.0]))
        assert np.isfinite(prediction.mean).all() and np.isfinite(prediction.std).all()
    assert np.abs(predictor.predict(np.array([10.0])).mean[0] - y[-1]).max() < 0.2


def test_bad_observations_are_refused_and_change_nothing(behaviour):
    predictor = PaperPredictor(behaviour)
    y = made_cycle(np.array([1.0]))[0]
    predictor.update(0.0, y)
    before = predictor.predict(np.array([0.1])).mean
    for time, row, mask in ((0.0, y, None), (-1.0, y, None), (np.nan, y, None), (1.0, y[:3], None),
                            (1.0, y * np.inf, None), (1.0, y, np.ones(2, bool)), (1.0, y, np.ones(6))):
        with pytest.raises(ValueError):
            predictor.update(time, row, mask)
    np.testing.assert_array_equal(predictor.predict(np.array([0.1])).mean, before)
    with pytest.raises(ValueError):
        predictor.predict(np.array([-0.1]))
    estimate = predictor.update(0.02, np.full(6, np.nan))
    assert not estimate.observed.any() and np.isnan(estimate.innovation) and np.isfinite(estimate.mean).all()
