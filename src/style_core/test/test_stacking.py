"""Stacking two predictors."""

import numpy as np
import pytest

from style_core.baselines import ConstantVelocity, ZeroVelocity
from style_core.evaluation import paper_horizons, roll_out
from style_core.motion import Motion
from style_core.stacking import Stacked, stacking_weights


def test_weights_minimise_the_error_of_people_counted_alike():
    rng = np.random.default_rng(2)
    first = [rng.normal(size=(n, 3, 4)) * np.array([1.0, 2.0, 0.5])[:, None] for n in (50, 80, 30)]
    second = [rng.normal(size=f.shape) + 0.3 * f for f in first]
    groups = ['a', 'a', 'b']
    weight, spread = stacking_weights(first, second, groups)

    def error(w):
        by_recording = [
            np.mean(((1 - w)[:, None] * f + w[:, None] * s) ** 2, axis=(0, 2)) for f, s in zip(first, second)
        ]
        return 0.25 * by_recording[0] + 0.25 * by_recording[1] + 0.5 * by_recording[2]

    best = error(weight)
    for step in (-0.02, 0.02):
        assert (error(np.clip(weight + step, 0, 1)) >= best - 1e-12).all()
    np.testing.assert_allclose(spread, np.sqrt(best / error(np.zeros(3))))


def test_a_useless_partner_gets_no_weight():
    rng = np.random.default_rng(0)
    first = [0.1 * rng.normal(size=(60, 2, 3))]
    weight, spread = stacking_weights(first, [10 * f for f in first], ['x'])
    np.testing.assert_array_equal(weight, 0.0)
    np.testing.assert_array_equal(spread, 1.0)


def test_stack_is_the_weighted_mean_and_keeps_the_firsts_estimate():
    times = np.arange(30) / 60
    motion = Motion(('a', 'b'), np.stack([np.sin(5 * times), times], axis=1), times)
    horizons = paper_horizons(4)
    one, two = (roll_out(kind(('a', 'b')), motion, horizons) for kind in (ZeroVelocity, ConstantVelocity))
    weight = np.array([0.0, 0.2, 0.5, 1.0])
    stack = roll_out(
        Stacked(ZeroVelocity(('a', 'b')), ConstantVelocity(('a', 'b')), horizons, weight, np.ones(4)), motion, horizons
    )
    np.testing.assert_allclose(stack.mean, (1 - weight)[:, None] * one.mean + weight[:, None] * two.mean)
    np.testing.assert_array_equal(stack.filtered, one.filtered)
    with pytest.raises(ValueError, match='same joints'):
        Stacked(ZeroVelocity(('a', 'b')), ZeroVelocity(('b', 'a')), horizons, weight, np.ones(4))
