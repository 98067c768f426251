import numpy as np
import pytest

from style_core.errors import UsageError
from style_core.synthetic import GaitStyle, random_style, synthetic_gait


def test_has_the_body_channels_of_the_recordings():
    from style_core import datasets
    from style_core.errors import MotionError
    try:
        real = datasets.trial('35_03').select(*datasets.BODY)
    except MotionError as error:
        pytest.skip(str(error))
    assert synthetic_gait(1.0)[0].joint_names == real.joint_names


def test_repeats_every_cycle_and_bit_for_bit():
    gait, phase = synthetic_gait(4.0, GaitStyle(cadence_hz=1.0), wander=0.0)
    np.testing.assert_allclose(gait.positions[60:], gait.positions[:-60], atol=1e-12)
    np.testing.assert_allclose(phase[60] - phase[0], 2 * np.pi)
    again, _ = synthetic_gait(2.0, seed=5)
    np.testing.assert_array_equal(again.positions, synthetic_gait(2.0, seed=5)[0].positions)
    assert not np.array_equal(again.positions, synthetic_gait(2.0, seed=6)[0].positions)


def test_phase_zero_is_near_the_left_hips_greatest_flexion():
    gait, phase = synthetic_gait(3.0, wander=0.0)
    hip = gait.positions[:, gait.joint_names.index('lfemur.rx')]
    assert abs(np.angle(np.exp(1j * phase[np.argmin(hip)]))) < 0.5


def test_the_right_side_is_the_left_half_a_cycle_later():
    gait, _ = synthetic_gait(4.0, GaitStyle(cadence_hz=1.0), wander=0.0)
    column = dict(zip(gait.joint_names, gait.positions.T))
    np.testing.assert_allclose(column['rtibia.rx'][30:], column['ltibia.rx'][:-30], atol=1e-12)
    np.testing.assert_allclose(column['rfemur.rz'][30:], -column['lfemur.rz'][:-30], atol=1e-12)


def test_styles_differ_and_stay_human():
    rng = np.random.default_rng(0)
    for run in (0.0, 1.0):
        people = [synthetic_gait(3.0, random_style(rng, run))[0].positions for _ in range(5)]
        assert all(np.abs(person).max() < np.radians(170) for person in people)
        assert all(np.abs(np.diff(person, axis=0)).max() * 60 < 20 for person in people)  # rad/s
        assert np.abs(people[0] - people[1]).max() > np.radians(3)


@pytest.mark.parametrize('call', [
    lambda: synthetic_gait(0), lambda: synthetic_gait(float('nan')), lambda: synthetic_gait(1, rate_hz=-5),
    lambda: synthetic_gait(0.01), lambda: GaitStyle(stride=float('inf')), lambda: GaitStyle(cadence_hz=0)])
def test_nonsense_is_refused(call):
    with pytest.raises(UsageError):
        call()
