"""The HMM core against enumeration, against hmmlearn, and with missing channels."""
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from style_core.errors import ModelError
from style_core.hmm import Hmm, check_hmm, em_step, filter_step, log_density, moments, occupancy, viterbi


def random_model(rng, n, d, sparse=False):
    trans = rng.dirichlet(np.ones(n), size=n)
    if sparse:
        trans = np.where(rng.random((n, n)) < 0.4, 0.0, trans) + np.eye(n) * 0.1
        trans /= trans.sum(axis=1, keepdims=True)
    roots = rng.standard_normal((n, d, d))
    return Hmm(rng.dirichlet(np.ones(n)), trans, rng.standard_normal((n, d)) * 2,
               roots @ roots.transpose(0, 2, 1) + 0.3 * np.eye(d))


def enumerate_paths(log_b, start, trans):
    """Occupancy, counts, likelihood and best path by summing over every path."""
    n_frames, n = log_b.shape
    paths = list(itertools.product(range(n), repeat=n_frames))
    with np.errstate(divide='ignore'):
        scores = np.array([np.log(start[p[0]]) + sum(np.log(trans[a, b]) for a, b in itertools.pairwise(p))
                           + sum(log_b[t, s] for t, s in enumerate(p)) for p in paths])
    likelihood = scores.max() + np.log(np.exp(scores - scores.max()).sum())
    gamma, counts = np.zeros((n_frames, n)), np.zeros((n, n))
    for path, weight in zip(paths, np.exp(scores - likelihood)):
        for t, s in enumerate(path):
            gamma[t, s] += weight
        for a, b in itertools.pairwise(path):
            counts[a, b] += weight
    return gamma, counts, likelihood, paths[int(np.argmax(scores))], scores.max()


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('spread', [1.0, 400.0])
def test_forward_backward_and_viterbi_equal_enumeration(seed, spread):
    """With a spread of 400 nats a frame, paths underflow: the logarithmic recursion has to take over."""
    rng = np.random.default_rng(seed)
    n, n_frames = (3, 7) if seed % 2 else (4, 5)
    model = random_model(rng, n, 2, sparse=seed > 2)
    log_b = rng.standard_normal((n_frames, n)) * spread
    gamma, counts, likelihood, path, best = enumerate_paths(log_b, model.start, model.trans)
    found = occupancy(log_b, model.start, model.trans)
    np.testing.assert_allclose(found.gamma, gamma, atol=1e-10)
    np.testing.assert_allclose(found.counts, counts, atol=1e-10)
    assert found.log_likelihood == pytest.approx(likelihood, rel=1e-12)
    states, score = viterbi(log_b, model.start, model.trans)
    assert score == pytest.approx(best, rel=1e-12)
    assert tuple(states) == path


def test_a_path_that_underflows_and_wins_later_is_found():
    log_b = np.array([[0.0, -2000.0], [-5000.0, 0.0], [-5000.0, 0.0]])
    found = occupancy(log_b, np.array([0.5, 0.5]), np.eye(2))
    np.testing.assert_allclose(found.gamma, [[0, 1], [0, 1], [0, 1]])
    assert found.log_likelihood == pytest.approx(-2000 + np.log(0.5))


def test_against_hmmlearn_on_a_large_model():
    hmmlearn = pytest.importorskip('hmmlearn.hmm')
    rng = np.random.default_rng(1)
    model = random_model(rng, 20, 6)
    lengths = [400, 1, 300]
    sequences = [rng.standard_normal((length, 6)) * 2 for length in lengths]
    peer = hmmlearn.GaussianHMM(20, 'full', init_params='')
    peer.startprob_, peer.transmat_, peer.means_, peer.covars_ = model.start, model.trans, model.means, model.covs
    ours = [occupancy(log_density(x, model.means, model.covs), model.start, model.trans) for x in sequences]
    score, gamma = peer.score_samples(np.concatenate(sequences), lengths)
    assert sum(found.log_likelihood for found in ours) == pytest.approx(score, rel=1e-10)
    np.testing.assert_allclose(np.concatenate([found.gamma for found in ours]), gamma, atol=1e-8)
    paths = [viterbi(log_density(x, model.means, model.covs), model.start, model.trans)[0] for x in sequences]
    np.testing.assert_array_equal(np.concatenate(paths), peer.decode(np.concatenate(sequences), lengths)[1])


def test_density_of_missing_channels_is_the_marginal_density():
    rng = np.random.default_rng(2)
    model = random_model(rng, 3, 4)
    x = rng.standard_normal((9, 4))
    x[2, 1] = x[3, [0, 3]] = x[5] = x[7, 1] = np.nan
    ours = log_density(x, model.means, model.covs)
    for t, i in itertools.product(range(9), range(3)):
        seen = ~np.isnan(x[t])
        reference = multivariate_normal(model.means[i][seen], model.covs[i][np.ix_(seen, seen)]).logpdf(x[t][seen]) \
            if seen.any() else 0.0
        assert ours[t, i] == pytest.approx(reference, abs=1e-10)


def test_moments_with_missing_channels_equal_sampling_them():
    rng = np.random.default_rng(3)
    model = random_model(rng, 2, 3)
    x = rng.standard_normal((4, 3))
    x[1, 0] = x[2, 1:] = x[3] = np.nan
    gamma = rng.dirichlet(np.ones(2), size=4)
    ours = moments(x, gamma, model.means, model.covs)
    draws = 200_000
    total, square = np.zeros((2, 3)), np.zeros((2, 3, 3))
    for t, i in itertools.product(range(4), range(2)):
        sample = rng.multivariate_normal(model.means[i], model.covs[i], size=draws)
        seen = ~np.isnan(x[t])
        if seen.any():  # condition by regression of the hidden channels on the seen ones
            cov = model.covs[i]
            gain = np.linalg.solve(cov[np.ix_(seen, seen)], cov[np.ix_(seen, ~seen)])
            sample[:, ~seen] += (x[t][seen] - sample[:, seen]) @ gain
            sample[:, seen] = x[t][seen]
        total[i] += gamma[t, i] * sample.mean(axis=0)
        square[i] += gamma[t, i] * (sample.T @ sample) / draws
    np.testing.assert_allclose(ours.total, total, atol=0.03)
    np.testing.assert_allclose(ours.square, square, atol=0.12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(1, 4), st.booleans())
def test_em_never_lowers_the_likelihood_and_stays_a_model(seed, n, d, holes):
    rng = np.random.default_rng(seed)
    model = random_model(rng, n, d, sparse=bool(seed % 2))
    sequences = [rng.standard_normal((length, d)) for length in (1, 30, 12)]
    if holes:
        for x in sequences:
            x[rng.random(x.shape) < 0.3] = np.nan
    last = -np.inf
    for _ in range(4):
        new, likelihood = em_step(model, sequences, floor=0.0 if not holes and n == 1 else 1e-3)
        assert np.isfinite(likelihood)
        if n > 1 or holes:  # the floor is no part of the likelihood: allow for it
            assert likelihood >= last - 0.5
        else:
            assert likelihood >= last - 1e-9 * abs(likelihood)
        if n == 1 and d == 1 and not holes:
            break  # maximum reached in one step
        check_hmm(new)
        model, last = new, likelihood


def test_em_recovers_a_model():
    rng = np.random.default_rng(5)
    trans = np.array([[0.95, 0.05, 0.0], [0.0, 0.9, 0.1], [0.2, 0.0, 0.8]])
    means = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 5.0]])
    states = [0]
    for _ in range(5000):
        states.append(rng.choice(3, p=trans[states[-1]]))
    x = means[states] + rng.standard_normal((5001, 2)) * 0.7
    x[rng.random(x.shape) < 0.1] = np.nan
    model = Hmm(np.ones(3) / 3, np.full((3, 3), 1 / 3), means + rng.standard_normal((3, 2)),
                np.tile(np.eye(2), (3, 1, 1)))
    for _ in range(30):
        model, _ = em_step(model, [x])
    np.testing.assert_allclose(model.means, means, atol=0.08)
    np.testing.assert_allclose(model.trans, trans, atol=0.03)
    np.testing.assert_allclose(model.covs, np.tile(0.49 * np.eye(2), (3, 1, 1)), atol=0.06)


def test_filter_step_is_the_last_row_of_the_forward_recursion():
    rng = np.random.default_rng(6)
    model = random_model(rng, 4, 2)
    log_b = log_density(rng.standard_normal((6, 2)), model.means, model.covs)
    belief = model.start * np.exp(log_b[0])
    likelihood = np.log(belief.sum())
    belief /= belief.sum()
    for t in range(1, 6):
        belief, gain = filter_step(belief, model.trans, log_b[t])
        likelihood += gain
    found = occupancy(log_b, model.start, model.trans)
    np.testing.assert_allclose(belief, found.gamma[-1], atol=1e-12)
    assert likelihood == pytest.approx(found.log_likelihood)


def test_bad_input_is_refused():
    with pytest.raises(ModelError, match='no frames'):
        occupancy(np.zeros((0, 2)), np.ones(2) / 2, np.eye(2))
    with pytest.raises(ModelError, match='NaN'):
        occupancy(np.full((2, 2), np.nan), np.ones(2) / 2, np.eye(2))
    with pytest.raises(ModelError, match='no probability'):
        occupancy(np.array([[0.0, -np.inf], [-np.inf, 0.0]]), np.ones(2) / 2, np.eye(2))
    with pytest.raises(ModelError, match='positive definite'):
        log_density(np.zeros((1, 2)), np.zeros((1, 2)), -np.eye(2)[None])
    with pytest.raises(ModelError, match='sum to 1'):
        check_hmm(Hmm(np.ones(2), np.eye(2), np.zeros((2, 1)), np.ones((2, 1, 1))))
