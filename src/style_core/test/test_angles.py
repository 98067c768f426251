"""Continuous Euler branches and exponential maps, against scipy's rotations."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from style_core.angles import continuous, continuous_triples, rotation_from_expmap, unwrap
from style_core.motion import Motion


def course(seed, frames=60):
    rng = np.random.default_rng(seed)
    times = np.linspace(0, 1, frames)[:, None]
    return sum(rng.normal(size=3) * np.sin(2 * np.pi * rng.uniform(0.2, 1.2, 3) * times + rng.uniform(0, 6, 3))
               for _ in range(2)) * 0.5


@pytest.mark.parametrize('order', ['xyz', 'zxy', 'yzx'])
@given(seed=st.integers(0, 10**6))
def test_any_mixture_of_equivalent_triples_becomes_one_smooth_course(order, seed):
    rng = np.random.default_rng(seed)
    true = course(seed)
    mixed = true.copy()
    flipped = rng.random(len(true)) < 0.3
    middle = 'xyz'.index(order[1])
    mixed[flipped] += np.pi
    mixed[flipped, middle] = np.pi - true[flipped, middle]
    mixed += 2 * np.pi * rng.integers(-1, 2, size=true.shape)
    smooth = continuous_triples(mixed, middle)
    columns = ['xyz'.index(letter) for letter in order]
    np.testing.assert_allclose(Rotation.from_euler(order, smooth[:, columns]).as_matrix(),
                               Rotation.from_euler(order, true[:, columns]).as_matrix(), atol=1e-9)
    steps = np.abs(np.diff(smooth, axis=0)).max()
    assert steps <= np.abs(np.diff(true, axis=0)).max() + 1e-9


def test_missing_frames_are_stepped_over():
    true = course(3)
    holed = true.copy()
    holed[20:23] = np.nan
    holed[23:] += 2 * np.pi
    smooth = continuous_triples(holed, 1)
    assert np.isnan(smooth[20:23]).all()
    np.testing.assert_allclose(np.delete(smooth, range(20, 23), 0), np.delete(true, range(20, 23), 0), atol=1e-12)
    np.testing.assert_allclose(unwrap(holed)[23:], true[23:], atol=1e-12)
    assert np.isnan(continuous_triples(np.full((4, 3), np.nan), 1)).all()


def test_joints_with_fewer_angles_are_only_unwrapped():
    values = np.column_stack([np.linspace(0, 3, 30), np.linspace(3, 4, 30)])
    wrapped = (values + np.pi) % (2 * np.pi) - np.pi
    motion = Motion(('foot.rx', 'foot.rz'), wrapped, np.arange(30) / 10)
    smooth = continuous(motion).positions
    np.testing.assert_allclose(np.diff(smooth, axis=0), np.diff(values, axis=0), atol=1e-12)


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_exponential_maps_agree_with_scipy(vector):
    np.testing.assert_allclose(rotation_from_expmap(np.array(vector)), Rotation.from_rotvec(vector).as_matrix(),
                               atol=1e-9)


def test_exponential_maps_near_zero_keep_their_first_order():
    tiny = np.array([1e-9, -2e-9, 3e-9])
    np.testing.assert_allclose(rotation_from_expmap(tiny)[2, 1], 1e-9, rtol=1e-6)


def test_real_walks_have_no_jump_left(trial):
    for name in ('07_01', '08_01', '16_15', '35_01'):
        body = trial(name, None).select('*femur*', '*tibia*', '*humerus*', '*radius*')
        assert np.abs(np.diff(body.positions, axis=0)).max() < np.pi / 2
