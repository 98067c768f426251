import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import ModelError
from style_core.stream.bound_map import BoundMap, all_finite
from style_core.stream.joint_map import JointMap, JointRule, identity_map, read_joint_map

MODEL = ('hip', 'knee', 'ankle')


def test_there_and_back_is_the_same_angle():
    bound = JointMap({'knee': JointRule('KNEE', sign=-1, offset=0.3, scale=2.0), 'hip': JointRule('HIP')}).bind(MODEL)
    assert bound.robot_joints == ('HIP', 'KNEE')
    pose = np.array([0.1, 0.7, 9.0])
    robot = bound.to_robot(pose)
    np.testing.assert_allclose(robot, [0.1, 0.3 - 1.4])
    back = np.zeros(3)
    for allowed, seen in (((1, 1), robot), ((0, 1), robot), ((1, 1), np.array([np.nan, robot[1]]))):
        observed = bound.observe(seen, np.array(allowed, np.int8), back)
        there = np.array(allowed, bool) & ~np.isnan(seen)
        np.testing.assert_array_equal(observed, there)
        np.testing.assert_allclose(back, np.where([*there, False], pose, np.nan))


@given(data=st.data(), frames=st.integers(0, 4))
@settings(deadline=None, max_examples=60)
def test_a_map_is_what_it_says_element_by_element(data, frames):
    number = st.floats(-3, 3)
    joints = data.draw(st.lists(st.integers(0, 4), min_size=1, max_size=5, unique=True))
    gain, offset = (np.array([data.draw(number.filter(bool) if what else number) for _ in joints]) for what in (1, 0))
    lower = np.array([data.draw(number | st.just(-np.inf)) for _ in joints])
    upper = lower + 1
    bound = BoundMap(tuple(map(str, joints)), joints, gain, offset, lower, upper)
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    mean, velocity, std = rng.standard_normal((3, frames, 5))
    positions = bound.to_robot(mean)
    np.testing.assert_array_equal(positions, np.clip(mean[:, joints] * gain + offset, lower, upper))
    moved = velocity[:, joints] * gain
    blocked = ((positions <= lower) & (moved < 0)) | ((positions >= upper) & (moved > 0))
    np.testing.assert_array_equal(bound.velocity_to_robot(velocity, positions), np.where(blocked, 0, moved))
    np.testing.assert_array_equal(bound.spread_to_robot(std), std[:, joints] * np.abs(gain))
    with pytest.raises(IndexError):
        bound.to_robot(mean[:, :max(joints)])


def test_all_finite_looks_at_every_number():
    arrays = np.ones(3), np.ones((2, 2))
    assert all_finite(*arrays) and all_finite()
    for place in ((0, 2), (1, (1, 0))):
        for bad in (np.nan, np.inf, -np.inf):
            broken = [one.copy() for one in arrays]
            broken[place[0]][place[1]] = bad
            assert not all_finite(*broken)


def test_spread_and_velocity_scale_without_offset_and_spread_has_no_sign():
    bound = JointMap({'knee': JointRule('KNEE', sign=-1, offset=0.3, scale=2.0)}).bind(MODEL)
    batch = np.ones((5, 3))
    np.testing.assert_allclose(bound.spread_to_robot(batch), np.full((5, 1), 2.0))
    np.testing.assert_allclose(bound.velocity_to_robot(batch, np.zeros((5, 1))), np.full((5, 1), -2.0))


def test_limits_hold_and_nothing_moves_into_them():
    bound = JointMap({'knee': JointRule('KNEE', limits=(-0.5, 1.0))}).bind(MODEL)
    positions = bound.to_robot(np.array([[0, 2.0, 0], [0, -3.0, 0], [0, 0.5, 0]]))
    np.testing.assert_array_equal(positions[:, 0], [1.0, -0.5, 0.5])
    velocity = bound.velocity_to_robot(np.full((3, 3), 4.0), positions)
    np.testing.assert_array_equal(velocity[:, 0], [0.0, 4.0, 4.0])


def test_identity_keeps_every_joint():
    bound = identity_map().bind(MODEL)
    assert bound.robot_joints == MODEL
    np.testing.assert_array_equal(bound.to_robot(np.arange(3.0)), np.arange(3.0))


def test_unlisted_joints_are_kept_or_dropped():
    rules = {'knee': JointRule('k')}
    assert JointMap(rules).bind(MODEL).robot_joints == ('k',)
    assert JointMap(rules, keep_unlisted=True).bind(MODEL).robot_joints == ('hip', 'k', 'ankle')


@pytest.mark.parametrize('rules, message', [
    ({'elbow': JointRule('e')}, 'elbow'),
    ({'hip': JointRule('x'), 'knee': JointRule('x')}, 'several model joints'),
    ({}, 'no joint'),
])
def test_maps_that_do_not_fit_the_model_are_refused(rules, message):
    with pytest.raises(ModelError, match=message):
        JointMap(rules).bind(MODEL)


def test_reads_short_and_long_entries(tmp_path):
    path = tmp_path / 'map.yaml'
    path.write_text('joints:\n  hip: left_hip\n  knee: {robot: left_knee, sign: -1, offset: 0.1, limits: [-1, 2]}\n'
                    'unlisted: keep\n')
    joint_map = read_joint_map(path)
    assert joint_map.keep_unlisted
    assert joint_map.rules['knee'] == JointRule('left_knee', sign=-1, offset=0.1, limits=(-1, 2))
    assert joint_map.bind(MODEL).robot_joints == ('left_hip', 'left_knee', 'ankle')


@pytest.mark.parametrize('text, message', [
    ('joints: [a, b]', 'must map joints'),
    ('joints: {hip: {sign: 1}}', 'joint hip: must have "robot"'),
    ('joints: {hip: {robot: h, sgn: 1}}', 'cannot have sgn'),
    ('joints: {hip: {robot: h, sign: 2}}', 'sign must be 1 or -1'),
    ('joints: {hip: {robot: h, scale: 0}}', 'scale positive'),
    ('joints: {hip: {robot: h, scale: .nan}}', 'scale positive'),
    ('joints: {hip: {robot: h, offset: "1"}}', 'must be numbers'),
    ('joints: {hip: {robot: h, sign: true}}', 'must be numbers'),
    ('joints: {hip: {robot: h, limits: [2, 1]}}', 'lower < upper'),
    ('joints: {hip: {robot: h, limits: [1]}}', 'lower < upper'),
    ('joints: {hip: {robot: h, limits: 3}}', r'limits must be \[lower, upper\]'),
    ('joints: {hip: 3}', 'must be a robot joint name'),
    ('joints: {}\nmore: 1', 'nothing else'),
    ('joints: {}\nunlisted: maybe', 'keep or drop'),
    ('joints: {hip: [', 'cannot be read'),
    ('just words', 'must hold "joints"'),
])
def test_broken_files_name_the_entry(tmp_path, text, message):
    path = tmp_path / 'map.yaml'
    path.write_text(text)
    with pytest.raises(ModelError, match=message):
        read_joint_map(path)


def test_missing_file_is_a_clear_error(tmp_path):
    with pytest.raises(ModelError, match='cannot be read'):
        read_joint_map(tmp_path / 'absent.yaml')


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp('maps') / 'map.yaml'
    path.write_bytes(b'joints: ' + content)
    with contextlib.suppress(ModelError):
        read_joint_map(path)
