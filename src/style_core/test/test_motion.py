"""`Motion`: checks, selection, interpolation, mirroring, concatenation."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from style_core.errors import MotionError
from style_core.motion import Motion, concatenate


def motion(frames=10, names=('a', 'b'), rate=10.0):
    values = np.arange(frames * len(names), dtype=float).reshape(frames, len(names))
    return Motion(names, values, np.arange(frames) / rate)


@pytest.mark.parametrize('change, words', [
    ({'positions': np.zeros((3, 1))}, 'shape'),
    ({'positions': np.zeros((9, 2))}, 'shape'),
    ({'positions': [['x', 'y']] * 10}, 'numbers'),
    ({'times': np.r_[np.arange(9), 8] / 10}, 'frame 9'),
    ({'times': np.r_[np.arange(9), np.nan]}, 'finite'),
    ({'joint_names': ('a', 'a')}, 'more than once'),
    ({'units': ('rad', 'deg')}, 'units'),
    ({'positions': np.full((10, 2), np.inf)}, 'infinite'),
])
def test_what_is_no_motion_is_refused_with_the_reason(change, words):
    with pytest.raises(MotionError, match=words):
        motion().replace(**change)


def test_an_empty_motion_is_refused():
    with pytest.raises(MotionError, match='empty'):
        Motion(('a',), np.zeros((0, 1)), np.zeros(0))


def test_a_rate_is_not_lowered_by_a_gap():
    whole = motion(100, rate=120.0)
    kept = np.r_[0:40, 60:100]
    assert whole.replace(positions=whole.positions[kept], times=whole.times[kept]).rate_hz == 120.0


def test_patterns_choose_and_exclude():
    body = motion(names=('lhip.rx', 'lknee.rx', 'rhip.rx', 'root.tx'))
    assert body.select('l*').joint_names == ('lhip.rx', 'lknee.rx')
    assert body.select('*hip*', '!r*').joint_names == ('lhip.rx',)
    assert body.select('!root.*').joint_names == ('lhip.rx', 'lknee.rx', 'rhip.rx')
    with pytest.raises(MotionError, match='elbow'):
        body.select('elbow*')
    assert body.joints(['rhip.rx', 'lhip.rx']).joint_names == ('rhip.rx', 'lhip.rx')


def test_resampling_is_exact_for_a_parabola_and_at_the_frames():
    times = np.array([0, 0.1, 0.25, 0.3, 0.45, 0.5, 0.61])
    course = Motion(('a',), (2 + 3 * times - 4 * times**2)[:, None], times)
    fine = course.resample(97.0)
    np.testing.assert_allclose(fine.positions[:, 0], 2 + 3 * fine.times - 4 * fine.times**2, atol=1e-12)
    assert fine.times[-1] <= times[-1]
    np.testing.assert_array_equal(course.at(times).positions, course.positions)
    np.testing.assert_allclose(course.velocities()[:, 0], 3 - 8 * times, atol=1e-12)


def test_halving_the_rate_keeps_every_second_frame():
    course = motion(101, rate=120.0)
    np.testing.assert_array_equal(course.resample(60.0).positions, course.positions[::2])


def test_nothing_is_invented_in_gaps_or_outside():
    course = motion(11)
    values = course.positions.copy()
    values[4:6, 0] = np.nan
    course = course.replace(positions=values)
    fine = course.at(np.array([-0.05, 0.25, 0.35, 0.4, 0.45, 0.55, 0.6, 0.65, 1.0, 1.05]))
    np.testing.assert_array_equal(np.isnan(fine.positions[:, 0]), [1, 0, 1, 1, 1, 1, 0, 0, 0, 1])
    np.testing.assert_array_equal(np.isnan(fine.positions[:, 1]), [1, 0, 0, 0, 0, 0, 0, 0, 0, 1])
    holed = motion(100, rate=100.0)
    kept = np.r_[0:30, 70:100]
    holed = holed.replace(positions=holed.positions[kept], times=holed.times[kept])
    assert np.isnan(holed.at([0.5]).positions).all()
    assert np.isfinite(holed.at([0.5], max_gap_s=1.0).positions).all()


@given(st.lists(st.booleans(), min_size=3, max_size=30), st.floats(1.0, 500.0))
def test_resampling_a_holed_course_never_leaves_its_neighbourhood(missing, rate):
    values = np.where(missing, np.nan, np.sin(np.arange(len(missing))))[:, None]
    course = Motion(('a',), values, np.arange(len(missing)) / 50)
    fine = course.resample(rate)
    assert fine.times[-1] <= course.times[-1] + 1e-6
    there = fine.positions[np.isfinite(fine.positions)]
    assert (np.abs(there) < 3).all()
    for time, value in zip(fine.times, fine.positions[:, 0]):
        around = [int(np.floor(time * 50 - 1e-4)), int(np.ceil(time * 50 + 1e-4))]
        if all(0 <= k < len(missing) and not missing[k] for k in around):
            assert np.isfinite(value)


def test_one_frame_has_no_rate_and_no_velocity():
    single = motion(1)
    assert np.isnan(single.rate_hz) and np.isnan(single.velocities()).all()
    assert single.resample(10.0).n_frames == 1


def test_slices_keep_their_stamps():
    part = motion(11).slice(0.3, 0.6)
    np.testing.assert_allclose(part.times, [0.3, 0.4, 0.5])
    with pytest.raises(MotionError, match='no frame'):
        motion().slice(5.0)


def test_concatenation_joins_by_name_and_keeps_time_going():
    first, second = motion(5), motion(4, names=('b', 'a'))
    both = concatenate([first, second])
    assert both.n_frames == 9 and both.rate_hz == 10.0
    np.testing.assert_array_equal(both.positions[5:], second.positions[:, ::-1])
    with pytest.raises(MotionError, match='differ'):
        concatenate([first, motion(names=('a', 'c'))])


@pytest.mark.parametrize('left, right', [
    ('lfemur.rx', 'rfemur.rx'), ('left_hip', 'right_hip'), ('LeftHip.rx', 'RightHip.rx'), ('hip_l.rx', 'hip_r.rx'),
    ('L_hip.rx', 'R_hip.rx'), ('hip.L.rx', 'hip.R.rx'), ('hip_left_joint', 'hip_right_joint'), ('LHip.rx', 'RHip.rx')])
def test_partners_are_found_in_every_way_of_writing(left, right):
    from style_core.mirroring import partner_name
    names = {left, right, 'root.rx', 'lowerback.rx', 'head.rx', 'leftover'}
    assert partner_name(left, names) == right and partner_name(right, names) == left
    for middle in ('root.rx', 'lowerback.rx', 'head.rx', 'leftover'):
        assert partner_name(middle, names) == middle


def test_mirroring_twice_is_nothing_and_half_a_body_cannot_be():
    body = motion(names=('root.tx', 'root.ty', 'lfemur.rx', 'lfemur.ry', 'rfemur.rx', 'rfemur.ry'))
    body = body.replace(units=('m', 'm', 'rad', 'rad', 'rad', 'rad'))
    once = body.mirror()
    np.testing.assert_array_equal(once.positions, body.positions[:, [0, 1, 4, 5, 2, 3]] * [-1, 1, 1, -1, 1, -1])
    np.testing.assert_array_equal(once.mirror().positions, body.positions)
    with pytest.raises(MotionError, match='lfemur'):
        body.select('l*').mirror()
    with pytest.raises(MotionError, match='skeleton'):
        motion().mirror()
