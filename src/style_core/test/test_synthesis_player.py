from itertools import islice

import numpy as np
import pytest

from style_core.errors import MotionError, UsageError
from style_core.motion import Motion
from style_core.synthesis.player import Faults, loop_cut, play
from style_core.synthetic import GaitStyle, synthetic_gait

TIMES = np.arange(20) / 100
MOTION = Motion(('l.hip', 'l.knee', 'r.hip'), np.outer(np.arange(20), [1.0, 10.0, 100.0]), TIMES)


def test_plain_play_is_the_recording():
    samples = list(play(MOTION))
    np.testing.assert_array_equal([s.positions for s in samples], MOTION.positions)
    np.testing.assert_allclose([s.due for s in samples], TIMES)
    assert all(s.names == MOTION.joint_names for s in samples)


def test_looping_counts_on_without_a_repeated_stamp():
    samples = list(islice(play(MOTION, loop=True), 60))
    np.testing.assert_allclose(np.diff([s.stamp for s in samples]), 0.01)
    np.testing.assert_array_equal(samples[20].positions, MOTION.positions[0])


def test_file_stamps_jump_back_at_every_loop():
    stamps = [s.stamp for s in islice(play(MOTION, loop=True, stamps='file'), 40)]
    np.testing.assert_allclose(stamps, np.tile(TIMES, 2))


def test_zero_stamps():
    assert all(s.stamp is None for s in play(MOTION, stamps='zero'))


def test_speed():
    np.testing.assert_allclose([s.due for s in play(MOTION, speed=2)], TIMES / 2)


def test_dark_joints_leave_the_message_or_become_nan_and_come_back():
    faults = {'drop': ('l.*',), 'drop_from': 0.05, 'drop_until': 0.10}
    absent = list(play(MOTION, Faults(**faults)))
    assert [s.names for s in absent[4:11]] == [MOTION.joint_names] + [('r.hip',)] * 5 + [MOTION.joint_names]
    nan = list(play(MOTION, Faults(**faults, drop_as_nan=True)))
    np.testing.assert_array_equal(np.isnan([s.positions for s in nan])[:, :2].all(axis=1),
                                  (TIMES >= 0.05) & (TIMES < 0.10))
    np.testing.assert_array_equal([s.truth for s in absent], MOTION.positions)


def test_noise_has_the_stated_spread_and_repeats_with_the_seed():
    motion = Motion(('a', 'b'), np.zeros((4000, 2)), np.arange(4000) / 100)
    noisy = [np.array([s.positions for s in play(motion, Faults(noise_std=0.2, seed=seed))]) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert not np.array_equal(noisy[0], noisy[2])
    assert abs(noisy[0].std() - 0.2) < 0.01


def test_jitter_delays_but_keeps_order_and_lost_samples_do_not_change_the_noise():
    faults = {'jitter': 0.9, 'noise_std': 0.1, 'seed': 3}
    clean = list(play(MOTION, Faults(**faults)))
    assert (np.diff([s.due for s in clean]) > 0).all()
    assert np.ptp(np.array([s.due for s in clean]) - TIMES) > 0.004
    lossy = list(play(MOTION, Faults(**faults, lose=0.5)))
    assert 2 < len(lossy) < 18
    by_due = {s.due: s for s in clean}
    assert all(np.array_equal(by_due[s.due].positions, s.positions) for s in lossy)


def test_gaps_and_clock_steps():
    due = np.array([s.due for s in play(MOTION, Faults(gap_every=0.1, gap_length=0.035))])
    np.testing.assert_allclose(due, [t for t in TIMES if t % 0.1 < 0.065 - 1e-9])
    stamps = np.array([s.stamp for s in play(MOTION, Faults(jump_at=0.1, jump_by=-5.0))])
    np.testing.assert_allclose(stamps, TIMES - 5.0 * (TIMES >= 0.1))


@pytest.mark.parametrize('call, error', [
    (lambda: play(MOTION, Faults(drop=('x*',))), MotionError),
    (lambda: play(MOTION, speed=0), UsageError),
    (lambda: play(MOTION, speed=float('nan')), UsageError),
    (lambda: play(MOTION, stamps='later'), UsageError),
    (lambda: play(MOTION.slice(0, 0.005)), UsageError),
    (lambda: Faults(jitter=1.0), UsageError),
    (lambda: Faults(lose=-0.1), UsageError),
    (lambda: Faults(noise_std=float('nan')), UsageError),
    (lambda: Faults(drop_from=2.0, drop_until=1.0), UsageError),
    (lambda: Faults(gap_every=1.0, gap_length=1.0), UsageError),
    (lambda: Faults(jump_by=float('inf')), UsageError),
])
def test_requests_that_make_no_sense_are_refused_before_anything_plays(call, error):
    with pytest.raises(error):
        call()


def test_the_cut_of_a_gait_is_whole_cycles_with_a_small_seam():
    gait, _ = synthetic_gait(5.3, GaitStyle(cadence_hz=0.8), wander=0.0)
    cut, seam = loop_cut(gait)
    cycles = cut.n_frames / 60 * 0.8
    assert abs(cycles - round(cycles)) < 0.02 and cycles > 1
    step = np.sqrt(np.mean(np.diff(gait.positions, axis=0)**2, axis=1)).mean()
    assert seam < step


def test_a_motion_too_short_or_with_holes_cannot_be_looped():
    with pytest.raises(UsageError):
        loop_cut(MOTION)
    gait, _ = synthetic_gait(3.0)
    positions = gait.positions.copy()
    positions[5, 5] = np.nan
    with pytest.raises(UsageError):
        loop_cut(gait.replace(positions=positions))
