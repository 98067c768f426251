"""The most likely trajectory against dense least squares; streaming against batch; refinement of the means."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import ModelError
from style_core.style_machine.emission import Emission
from style_core.style_machine.trajectory import information, refine_means, trajectory


def random_emission(rng, n=3, d=4, q=2):
    roots = rng.standard_normal((n, 2 * q, 2 * q))
    small = rng.standard_normal((n, d - q, 2, 2))
    return Emission(rng.standard_normal(d), rng.standard_normal((n, d)), rng.standard_normal((n, d)) * 0.2,
                    roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2 * q),
                    small @ small.transpose(0, 1, 3, 2) + 0.1 * np.eye(2), rng.uniform(1, 9, n))


def full_covariance(emission, i):
    """Covariance of [positions, velocities] of all coordinates."""
    d, q = emission.positions.shape[1], emission.leading
    cov = np.zeros((2 * d, 2 * d))
    lead = np.concatenate([np.arange(q), d + np.arange(q)])
    cov[np.ix_(lead, lead)] = emission.covs[i]
    for k in range(q, d):
        cov[np.ix_([k, d + k], [k, d + k])] = emission.tails[i, k - q]
    return cov


def dense_trajectory(emission, weights):
    """Minimise eq. 20 by ordinary least squares over stacked whitened residuals, y_0 left free."""
    n_frames, d = len(weights), emission.positions.shape[1]
    rows, right = [], []
    for t in range(n_frames):
        for i in np.flatnonzero(weights[t]):
            white = np.linalg.inv(np.linalg.cholesky(full_covariance(emission, i))) * np.sqrt(weights[t, i])
            pick = np.zeros((2 * d, (n_frames + 1) * d))  # frame -1 comes first
            now, before = slice((t + 1) * d, (t + 2) * d), slice(t * d, (t + 1) * d)
            pick[:d, now] = np.eye(d)
            pick[d:, now] = np.eye(d)
            pick[d:, before] = -np.eye(d)
            rows.append(white @ pick)
            right.append(white @ np.concatenate([emission.positions[i] + emission.pose, emission.velocities[i]]))
    answer = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    return answer.reshape(n_frames + 1, d)[1:]


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.integers(1, 9), st.sampled_from([(4, 2), (3, 3), (2, 1)]))
def test_state_sequence_against_dense_least_squares(seed, n_frames, shape):
    rng = np.random.default_rng(seed)
    emission = random_emission(rng, 3, *shape)
    path = rng.integers(3, size=n_frames)
    np.testing.assert_allclose(trajectory(information(emission), path), dense_trajectory(emission, np.eye(3)[path]),
                               atol=1e-9, rtol=1e-9)


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.integers(2, 8))
def test_all_of_gamma_against_dense_least_squares(seed, n_frames):
    """The first frame is one state: with several, the paper's y_0 makes their marginals depend on each other."""
    rng = np.random.default_rng(seed)
    emission = random_emission(rng)
    weights = rng.dirichlet(np.ones(3) * 0.5, size=n_frames)
    weights[0] = np.eye(3)[0]
    np.testing.assert_allclose(trajectory(information(emission), weights), dense_trajectory(emission, weights),
                               atol=1e-8, rtol=1e-8)


def test_one_state_at_rest_gives_its_mean():
    rng = np.random.default_rng(0)
    emission = random_emission(rng, 1)
    still = Emission(emission.pose, emission.positions, np.zeros((1, 4)), emission.covs, emission.tails, emission.dwell)
    np.testing.assert_allclose(trajectory(information(still), np.zeros(200, dtype=int)),
                               np.tile(emission.positions[0] + emission.pose, (200, 1)), atol=1e-10)


def test_bad_content_is_refused():
    known = information(random_emission(np.random.default_rng(0)))
    with pytest.raises(ModelError, match='no frames'):
        trajectory(known, np.zeros(0, dtype=int))
    with pytest.raises(ModelError, match='states must lie'):
        trajectory(known, np.array([0, 3]))


@pytest.mark.parametrize('soft', [False, True])
def test_refined_means_minimise_the_reconstruction_error(soft):
    """Without a ridge, against dense least squares over all means; the ridge keeps the entropic means."""
    rng = np.random.default_rng(3)
    emission = random_emission(rng, 2, 3, 2)
    path = np.repeat(rng.integers(2, size=12), rng.integers(1, 5, size=12))
    content = rng.dirichlet(np.ones(2), size=len(path)) if soft else path
    target = rng.standard_normal((len(path), 3))

    def rebuilt(positions, velocities):
        known = information(Emission(np.zeros(3), positions, velocities, emission.covs, emission.tails, emission.dwell))
        return trajectory(known, content)

    zero = np.zeros((2, 3))
    origin = rebuilt(zero, zero).ravel()
    columns = []
    for k in range(12):
        unit = np.zeros(12)
        unit[k] = 1.0
        columns.append(rebuilt(unit[:6].reshape(2, 3), unit[6:].reshape(2, 3)).ravel() - origin)
    best = np.linalg.lstsq(np.array(columns).T, target.ravel() - origin, rcond=None)[0]
    least = ((np.array(columns).T @ best + origin - target.ravel()) ** 2).sum()
    refined = refine_means(emission, [content], [target], ridge=0.0, iterations=200, tolerance=1e-12)
    assert ((rebuilt(*refined) - target) ** 2).sum() == pytest.approx(least, rel=1e-6)
    kept = refine_means(emission, [content], [target], ridge=1e9)
    np.testing.assert_allclose(kept[0], emission.positions, atol=1e-6)
    some = refine_means(emission, [content], [target], ridge=0.05)
    before = ((rebuilt(emission.positions, emission.velocities) - target) ** 2).sum()
    assert least <= ((rebuilt(*some) - target) ** 2).sum() < before
