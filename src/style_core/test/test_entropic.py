"""Entropic estimators: stationary points of the posterior, against numerical minimisation and known limits."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import lambertw

from style_core.hmm import moments
from style_core.style_machine.entropic import (
    gaussian_divergence,
    gaussian_entropy,
    generic_map,
    multinomial_entropy,
    multinomial_map,
    specific_map,
)


def energy(counts, z, p):
    with np.errstate(divide='ignore', invalid='ignore'):
        return -np.where(counts > 0, counts * np.log(p), 0.0).sum(axis=-1) + z * multinomial_entropy(p)


def random_gaussians(rng, *shape, d):
    roots = rng.standard_normal((*shape, d, d))
    return rng.standard_normal((*shape, d)), roots @ np.swapaxes(roots, -1, -2) + 0.2 * np.eye(d)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 6), st.sampled_from([-30.0, -1.0, -1e-3, 0.0, 1e-3, 0.5, 1.0, 4.0]))
def test_no_point_of_the_simplex_beats_the_multinomial_answer(seed, m, z):
    rng = np.random.default_rng(seed)
    counts = rng.gamma(0.7, 4.0, m)
    if seed % 3 == 0:
        counts[0] = 0.0
    answer = multinomial_map(counts[None], z, np.full((1, m), 1 / m))[0]
    assert answer.sum() == pytest.approx(1.0, abs=1e-12)
    assert (answer >= 0).all()
    if z > 0:
        assert (answer[counts == 0] == 0).all()
    near = answer * np.exp(rng.standard_normal((300, m)) * 0.01)
    everywhere = rng.dirichlet(np.full(m, 0.3), size=2000)
    trial = np.concatenate([near / near.sum(axis=1, keepdims=True), everywhere])
    if counts.sum() < z:  # the posterior has several modes then; the answer is one of them
        trial = trial[:300]
    assert energy(counts, z, answer) <= energy(counts, z, trial).min() + 1e-9


def test_the_fix_point_of_eqs_18_and_19_with_scipys_lambert_w():
    counts, z = np.array([5.0, 2.0, 0.4]), 1.5
    p = multinomial_map(counts[None], z, np.full((1, 3), 1 / 3))[0]
    multiplier = np.mean(counts / p + z * np.log(p) + z)                           # eq. 19
    argument = -counts / (z * np.exp(multiplier / z - 1))
    np.testing.assert_allclose(np.exp(lambertw(argument, -1).real + multiplier / z - 1), p, rtol=1e-9)  # eq. 18


def test_entropy_prior_limits():
    counts = np.array([[6.0, 3.0, 1.0]])
    start = np.full((1, 3), 1 / 3)
    np.testing.assert_allclose(multinomial_map(counts, 0.0, start), counts / 10)
    np.testing.assert_allclose(multinomial_map(counts, -1e6, start), 1 / 3, atol=1e-5)
    assert multinomial_map(counts, 8.0, start)[0, 2] < 0.05  # the rare event is being driven out
    np.testing.assert_array_equal(multinomial_map(np.zeros((1, 3)), 1.0, start), start)


def test_specific_estimate_has_zero_gradient():
    rng = np.random.default_rng(0)
    d, strength = 3, 7.0
    mean, cov = random_gaussians(rng, 1, d=d)
    x, gamma, floor = rng.standard_normal((20, d)), rng.random((20, 1)), 0.01 * np.eye(d)
    stats = moments(x, gamma)
    means, covs = specific_map(stats, mean, cov, strength, floor)

    def posterior(mu, k):
        gap = x - mu
        data = 0.5 * (gamma[:, 0] * np.einsum('ti,ij,tj->t', gap, np.linalg.inv(k), gap)).sum() \
            + 0.5 * gamma.sum() * np.linalg.slogdet(k)[1]
        return data + strength * gaussian_divergence(mean[0], cov[0], mu, k) + 0.5 * np.trace(np.linalg.inv(k) @ floor)

    assert_stationary(posterior, means[0], covs[0])


def assert_stationary(function, mean, cov):
    d, h = len(mean), 1e-5
    for i in range(d):
        step = np.zeros(d)
        step[i] = h
        assert (function(mean + step, cov) - function(mean - step, cov)) / (2 * h) == pytest.approx(0, abs=1e-5)
        for j in range(i + 1):
            bump = np.zeros((d, d))
            bump[i, j] = bump[j, i] = h
            assert (function(mean, cov + bump) - function(mean, cov - bump)) / (2 * h) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize('z, temperature', [(1.0, 0.0), (1.0, 5.0), (1.0, 200.0), (0.0, 0.0)])
def test_generic_estimate_has_zero_gradient(z, temperature):
    rng = np.random.default_rng(1)
    d, strength = 3, 2.0
    others, other_covs = random_gaussians(rng, 4, 1, d=d)
    _, pooled = random_gaussians(rng, d=d)
    x, gamma, floor = rng.standard_normal((30, d)), rng.random((30, 1)), 0.01 * np.eye(d)
    stats = moments(x, gamma)

    def posterior(mu, k):
        gap = x - mu
        data = 0.5 * (gamma[:, 0] * np.einsum('ti,ij,tj->t', gap, np.linalg.inv(k), gap)).sum() \
            + 0.5 * gamma.sum() * np.linalg.slogdet(k)[1]
        prior = (z - temperature) * gaussian_entropy(k) + 0.5 * temperature * np.trace(np.linalg.inv(pooled) @ k) \
            + strength * sum(gaussian_divergence(mu, k, others[s, 0], other_covs[s, 0]) for s in range(4))
        return data + prior + 0.5 * np.trace(np.linalg.inv(k) @ floor)

    cov = np.eye(d)[None]
    for _ in range(300):  # the mean depends on the covariance and the other way round
        mean, cov = generic_map(stats, z, temperature, np.linalg.inv(pooled), others, other_covs, strength, floor, cov)
    assert_stationary(posterior, mean[0], cov[0])


def test_generic_gaussians_tend_to_the_pooled_covariance_when_hot():
    rng = np.random.default_rng(2)
    others, other_covs = random_gaussians(rng, 2, 1, d=2)
    _, pooled = random_gaussians(rng, d=2)
    stats = moments(rng.standard_normal((5, 2)), np.ones((5, 1)))
    _, cov = generic_map(stats, 1.0, 1e7, np.linalg.inv(pooled), others, other_covs, 1.0, 0.01 * np.eye(2),
                         np.eye(2)[None])
    np.testing.assert_allclose(cov[0], pooled, rtol=1e-4)
