"""The quick ranking of phases against its formula, one phase and channel at a time."""
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.phase_style.basis_table import BasisTable
from style_core.phase_style.glance import PHASES, Glance

NODES = 128


def made(seed, channels, rhythmic=True, high=9.0, limit=np.inf):
    """A behaviour's table and variances, and a glance at it."""
    rng = np.random.default_rng(seed)
    cycle = np.linspace(0, 2 * np.pi, NODES + 1)[:, None]
    values = np.stack([np.sin(cycle * (1 + np.arange(channels) % 3) + rng.uniform(0, 6, channels)) if k == 0 else
                       0.1 * np.cos(cycle + rng.uniform(0, 6, channels)) for k in range(3)], axis=1)
    if not rhythmic:
        values = values * np.linspace(0.5, 1, NODES + 1)[:, None, None]
    offset, fast, personal, noise = rng.uniform(0.01, 0.1, (4, channels))
    behaviour = SimpleNamespace(
        rhythmic=rhythmic, velocity=np.array([6.0, 0.5, 4.0, high]),
        residual=SimpleNamespace(variance={'offset': offset, 'fast': fast, 'personal': personal}, noise=noise))
    glance = Glance(behaviour, BasisTable(values, np.zeros_like(values), np.zeros((NODES + 1, 3)), rhythmic), limit)
    posture = np.sum(values[:, 1:] ** 2, axis=1) + offset + fast + personal
    return glance, values[:, 0], posture, fast + noise + 0.5 * personal


def seen_by(seed, channels, samples):
    rng = np.random.default_rng(seed)
    y, observed = rng.standard_normal((samples, channels)), rng.random((samples, channels)) < 0.7
    y[~observed] = np.nan
    return y, observed.astype(np.uint8), np.arange(samples)[::-1] / 60


def one_by_one(mean, posture, change, phase, y, observed, back, velocity, rhythmic, limit=np.inf):
    """Log likelihood of a phase, but for constants: average and rest of the deviation, channel by channel."""
    places = phase - velocity * back
    nodes = (np.mod(places, 2 * np.pi) * NODES / (2 * np.pi) if rhythmic else np.clip(places, 0, 1) * NODES)
    nodes = np.floor(nodes + 0.5).astype(int)
    total = 0.0
    for d in range(y.shape[1]):
        rows = np.flatnonzero(observed[:, d])
        if len(rows):
            error = y[rows, d] - mean[nodes[rows], d]
            spread = posture[nodes[-1], d]
            total += min(error.mean() ** 2 / spread, limit ** 2) + np.log(spread)
            total += min(np.sum((error - error.mean()) ** 2) / change[d], limit ** 2)
            total += (len(rows) - 1) * np.log(change[d])
    return -0.5 * total


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from([1, 5, 8, 19]), st.integers(1, 8), st.booleans(),
       st.sampled_from([np.inf, 2.0]))
def test_ranking_is_its_formula(seed, channels, samples, rhythmic, limit):
    glance, *model = made(seed, channels, rhythmic, limit=limit)
    y, observed, back = seen_by(seed + 1, channels, samples)
    velocity = 5.7 if rhythmic else 0.9
    wanted = [one_by_one(*model, phase, y, observed, back, velocity, rhythmic, limit) for phase in glance.phases]
    np.testing.assert_allclose(glance.rank(y, observed, back, velocity), wanted, rtol=1e-3, atol=2e-3)


def test_what_was_looked_at_before_leaves_no_trace():
    used, fresh = made(0, 11)[0], made(0, 11)[0]
    for samples in (8, 3, 5):
        used.rank(*seen_by(samples, 11, samples), 6.0)
    np.testing.assert_array_equal(used.rank(*seen_by(1, 11, 4), 6.0), fresh.rank(*seen_by(1, 11, 4), 6.0))


@pytest.mark.parametrize('rhythmic', [True, False])
def test_peaks_are_the_best_of_neighbours_best_first(rhythmic):
    glance = made(3, 4, rhythmic)[0]
    y, observed, back = seen_by(5, 4, 3)
    scores, phases = np.full((2, len(glance.speeds), 40), -1.0)
    glance.peaks(y, observed, back, len(glance.speeds), scores, phases)
    for speed, score, phase in zip(glance.speeds, scores, phases):
        ranks = glance.rank(y, observed, back, speed) / 3
        left = np.roll(ranks, 1) if rhythmic else np.concatenate([[-np.inf], ranks[:-1]])
        right = np.roll(ranks, -1) if rhythmic else np.concatenate([ranks[1:], [-np.inf]])
        peaks = np.flatnonzero((ranks >= left) & (ranks > right))
        peaks = peaks[np.argsort(-ranks[peaks])]
        np.testing.assert_array_equal(score[:len(peaks)], ranks[peaks])
        np.testing.assert_array_equal(phase[:len(peaks)], glance.phases[peaks])
        assert np.isnan(score[len(peaks):]).all()
    few, where = np.empty((2, len(glance.speeds), 2))
    glance.peaks(y, observed, back, 1, few, where)
    np.testing.assert_array_equal(few[0], scores[0, :2])
    np.testing.assert_array_equal(where[0], phases[0, :2])


def test_what_does_not_move_has_one_phase():
    glance = made(0, 4, rhythmic=False, high=0.0)[0]
    assert len(glance.phases) == 1 and glance.speeds == [0.0]
    scores, phases = np.empty((2, 1, 3))
    glance.peaks(*seen_by(0, 4, 2), 1, scores, phases)
    assert scores[0, 0] == glance.rank(*seen_by(0, 4, 2), 0.0)[0] / 2 and phases[0, 0] == 0
    assert np.isnan(scores[0, 1:]).all()


def test_more_samples_than_fit_are_refused():
    glance = made(0, 4)[0]
    assert len(glance.phases) == PHASES
    with pytest.raises(ValueError, match='at most 32 samples, got 33'):
        glance.rank(*seen_by(0, 4, 33), 6.0)
