"""Ground contacts against made courses with known contacts, and the known facts of walking and running."""
import itertools

import numpy as np
import pytest

from style_core import datasets
from style_core.contacts import contact_intervals, foot_contacts
from style_core.errors import MotionError


def test_hysteresis_keeps_a_contact_until_the_foot_really_leaves():
    times = np.arange(10) / 10
    height = np.array([0.2, 0.03, 0.01, 0.03, 0.04, 0.03, 0.06, 0.03, 0.01, 0.2])
    touching = contact_intervals(height, np.zeros(10), times)
    assert touching.tolist() == [0, 0, 1, 1, 1, 1, 0, 0, 1, 0]


def test_speed_ends_a_contact_and_noise_is_neither_contact_nor_gap():
    times = np.arange(12) / 100
    height = np.zeros(12)
    speed = np.array([2, 0, 2, 2, 2, 2, 2, 0, 0, 0, 0, 0.0])
    assert contact_intervals(height, speed, times).tolist() == [0] * 7 + [1] * 5
    speed = np.r_[np.zeros(5), 2, np.zeros(6)]
    assert contact_intervals(height, speed, times).all()
    height[8:] = np.nan
    assert contact_intervals(height, np.zeros(12), times).tolist() == [1] * 8 + [0] * 4


def shares(name, trial, rate_hz=60.0):
    contacts = foot_contacts(trial(name, rate_hz), datasets.skeleton(name))
    left, right = contacts['left'].on_ground, contacts['right'].on_ground
    return (left.mean() + right.mean()) / 2, (~(left | right)).mean(), (left & right).mean()


@pytest.mark.parametrize('name', ['02_01', '07_01', '07_05', '08_01', '08_04', '16_15', '35_01', '35_29'])
def test_walking_always_has_a_foot_on_the_ground(trial, name):
    duty, flight, double = shares(name, trial)
    assert 0.5 < duty < 0.72 and flight < 0.02 and double > 0.03


@pytest.mark.parametrize('name', ['02_03', '09_01', '09_05', '16_35', '35_17', '35_22'])
def test_running_flies(trial, name):
    duty, flight, double = shares(name, trial)
    assert 0.2 < duty < 0.45 and flight > 0.2 and double < 0.02


def test_heel_strikes_of_both_feet_alternate(trial):
    contacts = foot_contacts(trial('35_01', None), datasets.skeleton('35'))
    strikes = sorted((time, foot) for foot, contact in contacts.items() for time in contact.heel_strikes)
    feet = [foot for _, foot in strikes]
    assert len(feet) >= 5 and all(a != b for a, b in itertools.pairwise(feet))
    strides = np.diff(contacts['right'].heel_strikes)
    np.testing.assert_allclose(strides, 1.12, atol=0.05)
    for contact in contacts.values():
        for strike in contact.heel_strikes:
            assert contact.on_ground[np.searchsorted(contact.times, strike - 1e-9)]


def test_a_tilted_floor_changes_next_to_nothing(trial):
    motion, skeleton = trial('35_01', None), datasets.skeleton('35')
    values = motion.positions.copy()
    ty, tz = (motion.joint_names.index(f'root.{axis}') for axis in ('ty', 'tz'))
    values[:, ty] += 0.04 * values[:, tz]
    level, tilted = (foot_contacts(m, skeleton) for m in (motion, motion.replace(positions=values)))
    for foot in level:
        assert (level[foot].on_ground != tilted[foot].on_ground).mean() < 0.03


def test_what_has_no_contacts_is_refused(trial):
    motion, skeleton = trial('35_01'), datasets.skeleton('35')
    with pytest.raises(MotionError, match='root'):
        foot_contacts(motion.select(*datasets.BODY), skeleton)
    with pytest.raises(MotionError, match='hoof'):
        foot_contacts(motion, skeleton, {'left': ('hoof',)})
    with pytest.raises(MotionError, match='three frames'):
        foot_contacts(motion.slice(0, 0.02), skeleton)
