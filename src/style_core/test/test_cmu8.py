"""The 8-action benchmark's skeleton and errors, against the public figures of holding the last pose."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core import cmu8, datasets
from style_core.errors import MotionError


def rows(seed, frames=5):
    return np.random.default_rng(seed).normal(scale=0.5, size=(frames, 117))


def test_rest_pose_is_the_sum_of_bones():
    positions = cmu8.cmu8_forward(np.zeros((2, 117)))
    foot = cmu8.OFFSETS_MM[[2, 3, 4, 5, 6]].sum(axis=0)
    np.testing.assert_allclose(positions[1, 6], foot)


def test_bones_keep_their_length_and_the_root_its_place():
    positions = cmu8.cmu8_forward(rows(0))
    for joint in range(1, 38):
        if cmu8.PARENTS[joint] > 0:
            length = np.linalg.norm(positions[:, joint] - positions[:, cmu8.PARENTS[joint]], axis=1)
            np.testing.assert_allclose(length, np.linalg.norm(cmu8.OFFSETS_MM[joint]), atol=1e-9)
    moved = rows(0)
    moved[:, :6] += 1.0
    np.testing.assert_array_equal(cmu8.cmu8_forward(moved), positions)
    for copy, original in cmu8.DUPLICATES.items():
        np.testing.assert_array_equal(positions[:, copy], positions[:, original])


def test_euler_angles_describe_the_same_rotation():
    angles = cmu8.euler_angles(rows(1))[:, 3:].reshape(-1, 3)
    expected = Rotation.from_rotvec(rows(1)[:, 3:].reshape(-1, 3)).as_matrix()
    # R = Rx(-a) Ry(-b) Rz(-c) by the convention's own formulas
    np.testing.assert_allclose(Rotation.from_euler('XYZ', -angles).as_matrix(), expected, atol=1e-9)


def test_errors_leave_out_the_root_and_what_never_moves():
    actual = rows(2)
    actual[:, 60:] = 0.1
    changed = actual.copy()
    changed[:, :6] += 1.0
    changed[:, 60:] += 0.3
    np.testing.assert_allclose(cmu8.euler_error(changed, actual), 0, atol=1e-12)
    changed[2, 30] += 0.1
    assert (cmu8.euler_error(changed, actual) > 0).tolist() == [False, False, True, False, False]
    with pytest.raises(MotionError, match='117'):
        cmu8.cmu8_forward(np.zeros((3, 99)))


@pytest.mark.parametrize('action, published', [
    ('walking', (19.1, 37.1, 71.0, 86.6, 114.6, 165.9)), ('running', (41.4, 81.0, 146.6, 175.2, 220.4, 213.8))])
def test_holding_the_last_pose_gives_the_known_errors(mocap, action, published):
    (_, sequence), = datasets.cmu8('test', action)
    positions = cmu8.cmu8_forward(sequence)[::2]
    assert np.ptp(positions[:, cmu8.STILL], axis=0).max() < 1e-9
    starts = np.arange(len(positions) - 75)  # windows of 50 frames seen and 25 to come
    errors = [np.linalg.norm(positions[starts + 49] - positions[starts + 49 + horizon], axis=-1).mean()
              for horizon in (2, 4, 8, 10, 14, 25)]
    np.testing.assert_allclose(errors, published, atol=0.06)


def test_an_unknown_action_is_said(mocap):
    with pytest.raises(MotionError, match='swimming'):
        datasets.cmu8('test', 'swimming')
