"""Kernels of the locomotion model against dense algebra and against every path written out."""
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.locomotion import kernels


def chain_moments(diagonal, coupling, potential):
    out = [np.empty_like(diagonal) for _ in range(3)]
    log_det = np.empty(diagonal.shape[1])
    kernels.cyclic_chain(diagonal, coupling, potential, *out, log_det)
    return (*out, log_det)


def dense(diagonal, coupling):
    precision = np.diag(diagonal)
    for m in range(len(diagonal)):
        precision[m, m - 1] -= coupling
        precision[m - 1, m] -= coupling
    return precision


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 12), st.integers(1, 4), st.integers(0, 10**6), st.floats(-4, 4), st.floats(-4, 4))
def test_cyclic_chain_is_the_dense_gaussian(M, B, seed, log_coupling, log_own):
    rng = np.random.default_rng(seed)
    coupling = np.full(B, 10.0**log_coupling)
    own = 10.0**log_own * (0.01 + rng.random((M, B)))
    diagonal = 2 * coupling + own
    potential = rng.normal(size=(M, B)) * own
    mean, variance, neighbour, log_det = chain_moments(diagonal, coupling, potential)
    for b in range(B):
        precision = dense(diagonal[:, b], coupling[b])
        covariance = np.linalg.inv(precision)
        tolerance = {'rtol': 1e-14 * np.linalg.cond(precision) + 1e-11}
        np.testing.assert_allclose(
            mean[:, b], covariance @ potential[:, b], atol=1e-9 * np.abs(mean).max(), **tolerance
        )
        np.testing.assert_allclose(variance[:, b], np.diag(covariance), **tolerance)
        np.testing.assert_allclose(neighbour[:, b], [covariance[m, m - 1] for m in range(M)],
                                   atol=1e-9 * variance.max(), **tolerance)
        assert log_det[b] == pytest.approx(np.linalg.slogdet(precision)[1], rel=1e-9, abs=1e-7)


def test_cyclic_chain_without_coupling_is_independent():
    diagonal = np.array([[2.0], [4.0], [5.0]])
    mean, variance, neighbour, log_det = chain_moments(diagonal, np.zeros(1), np.ones((3, 1)))
    np.testing.assert_allclose(mean, 1 / diagonal)
    np.testing.assert_allclose(variance, 1 / diagonal)
    np.testing.assert_array_equal(neighbour, 0.0)
    assert log_det[0] == pytest.approx(np.log(40.0))


def every_path(emission, log_jump):
    """(paths, log weights) of the cyclic left-to-right chain, one by one."""
    T, M = emission.shape
    paths, weights = [], []
    for start in range(M):
        for jumps in itertools.product(range(len(log_jump)), repeat=T - 1):
            path = (start + np.concatenate([[0], np.cumsum(np.array(jumps, int) + 1)]).astype(int)) % M
            paths.append((path, jumps))
            weights.append(-np.log(M) + sum(log_jump[j] for j in jumps) + emission[np.arange(T), path].sum())
    return paths, np.array(weights)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 5), st.integers(3, 6), st.integers(1, 3), st.integers(0, 10**6), st.sampled_from([1.0, 30.0, 900.0])
)
def test_forward_backward_and_viterbi_are_the_sum_and_the_best_over_paths(T, M, J, seed, spread):
    rng = np.random.default_rng(seed)
    emission = rng.normal(size=(T, M)) * spread
    log_jump = np.log(rng.dirichlet(np.ones(J)))
    occupancy, counts = np.empty((T, M)), np.empty(J)
    total, fit = kernels.forward_backward(emission, log_jump, occupancy, counts)
    paths, weights = every_path(emission, log_jump)
    top = weights.max()
    share = np.exp(weights - top)
    assert total == pytest.approx(top + np.log(share.sum()), rel=1e-12, abs=1e-10)
    share /= share.sum()
    expected, moves = np.zeros((T, M)), np.zeros(J)
    for (path, jumps), p in zip(paths, share):
        expected[np.arange(T), path] += p
        np.add.at(moves, np.array(jumps, int), p)
    np.testing.assert_allclose(occupancy, expected, atol=1e-10)
    np.testing.assert_allclose(counts, moves, atol=1e-9)
    assert fit == pytest.approx((expected * emission).sum(), rel=1e-9, abs=1e-8)
    path = np.empty(T, np.int64)
    assert kernels.viterbi(emission, log_jump, path) == pytest.approx(top, rel=1e-12, abs=1e-10)
    np.testing.assert_array_equal(path, paths[int(weights.argmax())][0])


def test_a_path_far_beyond_the_range_of_a_double_is_still_found():
    """The first frames favour one place by thousands of nats, the later ones another that it cannot reach."""
    T, M = 6, 12
    emission = np.full((T, M), -5000.0)
    emission[0, 0] = 0.0
    emission[1:, :] = -1e5
    for i in range(1, T):
        emission[i, (6 + i) % M] = 0.0
    occupancy, counts = np.empty((T, M)), np.empty(1)
    total, _ = kernels.forward_backward(emission, np.zeros(1), occupancy, counts)
    np.testing.assert_array_equal(occupancy.argmax(axis=1), (6 + np.arange(T)) % M)
    assert total == pytest.approx(-5000.0 - np.log(M))
    assert counts[0] == pytest.approx(T - 1)
