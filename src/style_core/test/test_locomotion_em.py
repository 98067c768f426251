"""The variational EM of the locomotion model against sums over every path and label, dense Gaussians and slopes."""
import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.locomotion import em


def problem(seed, n_styles=2, n_positions=5, n_features=2, lengths=(6, 4, 7), max_jump=2, missing=0.0, **options):
    """A small random problem in the middle of learning: data, settings, parameters, posterior."""
    rng = np.random.default_rng(seed)
    recordings = [rng.normal(size=(t, n_features)) for t in lengths]
    for x in recordings:
        x[rng.random(x.shape) < missing] = np.nan
    data = em.prepare(recordings)
    rules = em.Settings(n_styles, n_positions, max_jump, np.full(n_features, 1e6), **options)
    shape = (n_styles, n_positions, n_features)
    parameters = em.Parameters(
        rng.normal(size=shape[1:]),
        rng.uniform(0.2, 2),
        rng.uniform(0.2, 3),
        rng.uniform(0.5, 3, (n_styles, n_features)),
        rng.dirichlet(np.ones(n_styles)),
        rng.dirichlet(np.ones(max_jump), len(lengths)),
    )
    start = em.CycleMoments(rng.normal(size=shape), rng.uniform(0.1, 1, shape), np.zeros(shape), np.zeros(shape[::2]))
    posterior = em.Posterior(rng.dirichlet(np.ones(n_styles), len(lengths)), start)
    posterior = em.update_cycles(parameters, em.update_paths(data, parameters, posterior))
    return data, rules, parameters, posterior


STEPS = {
    'paths': lambda data, rules, parameters, posterior: (parameters, em.update_paths(data, parameters, posterior)),
    'cycles': lambda data, rules, parameters, posterior: (parameters, em.update_cycles(parameters, posterior)),
    'labels': lambda data, rules, parameters, posterior: (parameters, em.update_labels(data, parameters, posterior)),
    'parameters': lambda data, rules, parameters, posterior: (
        em.update_parameters(data, parameters, posterior, rules), posterior),
}


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.sampled_from(sorted(STEPS)), min_size=4, max_size=12),
       st.sampled_from([0.0, 0.3]), st.booleans(), st.integers(1, 3))
def test_the_bound_never_falls_in_any_order_of_updates(seed, order, missing, learn_coupling, n_styles):
    data, rules, parameters, posterior = problem(seed, n_styles, missing=missing, learn_coupling=learn_coupling)
    value = em.bound(data, parameters, posterior, rules)
    for step in order:
        parameters, posterior = STEPS[step](data, rules, parameters, posterior)
        after = em.bound(data, parameters, posterior, rules)
        assert after >= value - 1e-9 * (1 + abs(value)), step
        value = after


def every_path(length, n_positions, jumps):
    paths, weights = [], []
    for start in range(n_positions):
        for moves in itertools.product(range(len(jumps)), repeat=length - 1):
            steps = np.array([0, *(j + 1 for j in moves)])
            paths.append((start + np.cumsum(steps)) % n_positions)
            weights.append(-np.log(n_positions) + sum(np.log(jumps[j]) for j in moves))
    return paths, np.array(weights)


def ring(n):
    return 2 * np.eye(n) - np.roll(np.eye(n), 1, axis=1) - np.roll(np.eye(n), -1, axis=1)


def penalty(rules, parameters):
    parent = parameters.parent
    return (-rules.parent_smoothness * sum(((parent[m] - parent[m - 1])**2).sum() for m in range(len(parent)))
            + rules.label_pseudo * np.log(parameters.weights).sum() + rules.jump_pseudo * np.log(parameters.jumps).sum()
            + rules.precision_pseudo / 2 * (np.log(parameters.precision) - parameters.precision).sum())


def brute_bound(data, rules, parameters, before, posterior):
    """The bound with Q(paths) tabulated path by path (from the posterior ``before`` its update) and dense Q(cycles)."""
    mean, variance = posterior.cycles.mean, posterior.cycles.variance
    n_styles, n_positions, n_features = mean.shape
    value = penalty(rules, parameters)
    count = np.zeros((n_styles, n_positions, n_features))
    for k, x in enumerate(data.values):
        seen = np.ones_like(x) if data.seen[k] is None else data.seen[k]
        paths, prior = every_path(len(x), n_positions, parameters.jumps[k])

        def score(path, moments, c, x=x, seen=seen):
            distance = (x - moments.mean[c, path])**2 + moments.variance[c, path]
            return (
                seen * 0.5 * (np.log(parameters.precision[c] / (2 * np.pi)) - parameters.precision[c] * distance)
            ).sum()

        log_q = prior + [sum(before.labels[k, c] * score(p, before.cycles, c) for c in range(n_styles)) for p in paths]
        q = np.exp(log_q - log_q.max())
        q /= q.sum()
        value += (q * (prior - np.log(q))).sum()
        for c, share in enumerate(posterior.labels[k]):
            value += share * (np.log(parameters.weights[c]) - np.log(share)
                              + sum(w * score(p, posterior.cycles, c) for w, p in zip(q, paths)))
        for w, path in zip(q, paths):
            for i, m in enumerate(path):
                count[:, m] += w * posterior.labels[k][:, None] * seen[i]
    own = parameters.coupling * np.eye(n_positions) + parameters.smoothing * ring(n_positions)
    prior_mean = np.linalg.solve(own, parameters.coupling * parameters.parent)
    for c in range(n_styles):
        for f in range(n_features):
            precision = own + np.diag(parameters.precision[c, f] * count[c, :, f])
            covariance = np.linalg.inv(precision)
            np.testing.assert_allclose(variance[c, :, f], np.diag(covariance), rtol=1e-9)
            gap = mean[c, :, f] - prior_mean[:, f]
            value += 0.5 * (np.linalg.slogdet(own)[1] - np.trace(own @ covariance) - gap @ own @ gap
                            + n_positions + np.linalg.slogdet(covariance)[1])
    return value


@pytest.mark.parametrize('missing', [0.0, 0.35])
def test_the_bound_is_the_sum_over_every_path_label_and_dense_gaussian(missing):
    data, rules, parameters, start = problem(3, n_positions=4, lengths=(4, 3, 5), missing=missing)
    before = em.update_labels(data, parameters, start)
    after = em.update_cycles(parameters, em.update_paths(data, parameters, before))
    assert em.bound(data, parameters, after, rules) == pytest.approx(
        brute_bound(data, rules, parameters, before, after), rel=1e-11)


def log_evidence(data, parameters):
    """log p(data | parameters), exact: every label and path of every recording, cycles integrated out."""
    n_positions, n_features = parameters.parent.shape
    n_styles = len(parameters.weights)
    own = parameters.coupling * np.eye(n_positions) + parameters.smoothing * ring(n_positions)
    covariance = np.linalg.inv(own)
    prior_mean = covariance @ (parameters.coupling * parameters.parent)
    options = []
    for k, x in enumerate(data.values):
        paths, prior = every_path(len(x), n_positions, parameters.jumps[k])
        options.append(
            [(c, p, w + np.log(parameters.weights[c])) for c in range(n_styles) for p, w in zip(paths, prior)]
        )
    terms = []
    for choice in itertools.product(*options):
        value = sum(w for _, _, w in choice)
        for c in range(n_styles):
            for f in range(n_features):
                where, what = [], []
                for k, (label, path, _) in enumerate(choice):
                    seen = np.ones(len(path), bool) if data.seen[k] is None else data.seen[k][:, f] > 0
                    if label == c:
                        where += list(path[seen])
                        what += list(data.values[k][seen, f])
                if where:
                    gap = np.array(what) - prior_mean[where, f]
                    spread = covariance[np.ix_(where, where)] + np.eye(len(where)) / parameters.precision[c, f]
                    value -= 0.5 * (gap @ np.linalg.solve(spread, gap) + np.linalg.slogdet(2 * np.pi * spread)[1])
        terms.append(value)
    return np.logaddexp.reduce(terms)


@pytest.mark.parametrize('seed, missing', [(0, 0.0), (1, 0.4), (2, 0.0)])
def test_the_bound_lies_below_the_exact_evidence(seed, missing):
    data, rules, parameters, posterior = problem(seed, n_positions=3, n_features=1, lengths=(2, 3), missing=missing)
    for _ in range(30):
        posterior = em.update_labels(data, parameters, em.update_cycles(
            parameters, em.update_paths(data, parameters, posterior)))
    gap = log_evidence(data, parameters) + penalty(rules, parameters) - em.bound(data, parameters, posterior, rules)
    assert 0 < gap < 3


def test_the_bound_is_the_exact_evidence_where_the_mean_field_is_exact():
    """Well separated positions and styles leave one path and label each: nothing is lost by the factorisation."""
    _, rules, parameters, posterior = problem(4, n_positions=3, n_features=2, lengths=(2, 3))
    parent = 100.0 * np.array([[0.0, 1.0], [1.0, -1.0], [-2.0, 0.5]])
    parameters = replace(
        parameters,
        parent=parent,
        coupling=500.0,
        smoothing=0.3,
        precision=np.array([[50.0, 50.0]] * 2),
        weights=np.array([1 - 1e-12, 1e-12]),
        jumps=np.full((2, 2), 0.5),
    )
    mean = em.prior_mean(parent, parameters.coupling, parameters.smoothing)
    data = em.prepare([mean[[0, 1]] + 0.1, mean[[2, 0, 2]] - 0.05])
    posterior = replace(posterior, labels=np.array([[1 - 1e-12, 1e-12]] * 2),
                        cycles=replace(posterior.cycles, mean=np.stack([mean, mean])))
    for _ in range(3):
        posterior = em.update_cycles(parameters, em.update_paths(data, parameters, posterior))
    assert em.bound(data, parameters, posterior, rules) == pytest.approx(
        log_evidence(data, parameters) + penalty(rules, parameters), abs=1e-6)


def slopes(function, point, directions, step=1e-5):
    return np.array([(function(point + step * d) - function(point - step * d)) / (2 * step) for d in directions])


@pytest.mark.parametrize('seed, missing', [(0, 0.0), (5, 0.3)])
def test_every_update_leaves_no_slope(seed, missing):
    data, rules, parameters, posterior = problem(seed, missing=missing, learn_coupling=True)

    def value(**changes):
        left = replace(parameters, **{k: v for k, v in changes.items() if hasattr(parameters, k)})
        right = replace(posterior, **{k: v for k, v in changes.items() if hasattr(posterior, k)})
        return em.bound(data, left, right, rules)

    def on_simplex(shape):
        """Directions that keep rows summing to one."""
        for row in np.ndindex(*shape[:-1]):
            for j in range(shape[-1] - 1):
                direction = np.zeros(shape)
                direction[(*row, j)], direction[(*row, j + 1)] = 1.0, -1.0
                yield direction

    posterior = em.update_labels(data, parameters, posterior)
    shape = posterior.labels.shape
    np.testing.assert_allclose(
        slopes(lambda v: value(labels=v), posterior.labels, on_simplex(shape), 1e-7), 0, atol=1e-4
    )

    posterior = em.update_cycles(parameters, posterior)
    size = posterior.cycles.mean.shape
    np.testing.assert_allclose(slopes(lambda v: value(cycles=replace(posterior.cycles, mean=v.reshape(size))),
                                      posterior.cycles.mean.ravel(), np.eye(np.prod(size))), 0, atol=1e-6)

    learned = em.update_parameters(data, parameters, posterior, rules)
    old, parameters = parameters, learned
    shape = learned.parent.shape
    for name in ('weights', 'jumps'):
        point = getattr(learned, name)
        np.testing.assert_allclose(
            slopes(lambda v, name=name: value(**{name: v}), point, on_simplex(point.shape), 1e-7), 0, atol=1e-4
        )
    np.testing.assert_allclose(slopes(lambda v: value(precision=v.reshape(learned.precision.shape)),
                                      learned.precision.ravel(), np.eye(learned.precision.size)), 0, atol=1e-5)
    # parent, smoothing and coupling are maximised one after the other, each given the values before it
    parameters = replace(learned, smoothing=old.smoothing, coupling=old.coupling)
    np.testing.assert_allclose(slopes(lambda v: value(parent=v.reshape(shape)), learned.parent.ravel(),
                                      np.eye(np.prod(shape))), 0, atol=1e-6)
    parameters = replace(learned, coupling=old.coupling)
    assert slopes(lambda v: value(smoothing=v), learned.smoothing, [1.0])[0] == pytest.approx(0, abs=1e-5)
    parameters = learned
    assert slopes(lambda v: value(coupling=v), learned.coupling, [1.0])[0] == pytest.approx(0, abs=1e-5)


def test_no_other_path_distribution_does_better():
    data, rules, parameters, posterior = problem(7, missing=0.2)
    best = em.bound(data, parameters, em.update_paths(data, parameters, posterior), rules)
    rng = np.random.default_rng(0)
    for scale in (0.01, 0.1, 1.0):
        skewed = replace(parameters, precision=parameters.precision * np.exp(scale * rng.normal(
            size=parameters.precision.shape)))
        other = replace(posterior, paths=em.update_paths(data, skewed, posterior).paths)
        assert em.bound(data, parameters, other, rules) < best


def test_a_missing_entry_is_marginalised_not_filled():
    """Leaving an entry out equals integrating it out: a wide sweep of values for it, summed on a grid."""
    data, _, parameters, _ = problem(11, n_positions=3, n_features=1, lengths=(2, 2))
    hole = [x.copy() for x in data.values]
    hole[0][1, 0] = np.nan
    without = log_evidence(em.prepare(hole), parameters)
    grid = np.linspace(-12, 12, 81)
    values = []
    for v in grid:
        filled = [x.copy() for x in data.values]
        filled[0][1, 0] = v
        values.append(log_evidence(em.prepare(filled), parameters))
    total = np.logaddexp.reduce(values) + np.log(grid[1] - grid[0])
    assert total == pytest.approx(without, abs=1e-6)


def test_threads_do_not_change_a_bit():
    data, _, parameters, posterior = problem(2, lengths=(30, 20, 10, 40), missing=0.1)
    one, two = (em.update_paths(data, parameters, posterior, threads).paths for threads in (1, 3))
    for left, right in zip(vars(one).values(), vars(two).values()):
        np.testing.assert_array_equal(left, right)
