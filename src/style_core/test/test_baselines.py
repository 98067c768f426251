"""Baselines against what they must do exactly."""
import numpy as np
import pytest

from style_core.baselines import (
    ConstantVelocity,
    KnownPhase,
    LinearLeastSquares,
    NearestHistories,
    ParticleFilter,
    RadialBasisNetwork,
    ZeroVelocity,
)
from style_core.errors import MotionError
from style_core.evaluation import error_deg2, paper_horizons, roll_out
from style_core.motion import Motion

NAMES = ('a', 'b', 'c', 'd')


def cycle(n_frames=240, rate_hz=60.0, period_s=1.1, offset=0.0, phase=0.0, name=''):
    times = np.arange(n_frames) / rate_hz
    turn = 2 * np.pi * times / period_s + phase
    positions = np.stack([np.sin(turn), 0.4 * np.cos(2 * turn), 0.2 * np.sin(turn + 1), 0.1 * np.cos(turn)], axis=1)
    return Motion(NAMES, positions + offset, times, name=name)


def everyone():
    training = [cycle(phase=0.3), cycle(300, period_s=1.0)]
    return [ZeroVelocity(NAMES), ConstantVelocity(NAMES), NearestHistories(training), LinearLeastSquares(NAMES),
            RadialBasisNetwork(training, per_axis=5)]


@pytest.mark.parametrize('predictor', everyone(), ids=lambda p: type(p).__name__)
def test_protocol(predictor):
    motion = cycle(40)
    predictor.reset()
    assert np.isfinite(predictor.predict([0.1]).mean).all()     # what may be expected of anyone
    for frame in range(40):
        estimate = predictor.update(motion.times[frame], motion.positions[frame])
    assert estimate.time == motion.times[-1] and estimate.mean.shape == (4,)
    prediction = predictor.predict(np.array([0.0, 0.1, 0.3]))
    assert prediction.mean.shape == prediction.std.shape == prediction.velocity.shape == (3, 4)
    assert np.isfinite(prediction.mean).all() and np.isfinite(prediction.velocity).all()
    np.testing.assert_allclose(prediction.times, motion.times[-1] + np.array([0.0, 0.1, 0.3]))
    with pytest.raises(ValueError, match='increase'):
        predictor.update(motion.times[-1], motion.positions[-1])
    with pytest.raises(ValueError):
        predictor.update(99.0, np.zeros(3))
    with pytest.raises(ValueError):
        predictor.update(99.0, np.zeros(4), np.ones(3, dtype=bool))


@pytest.mark.parametrize('predictor', everyone(), ids=lambda p: type(p).__name__)
def test_reset_forgets_and_runs_repeat_bit_for_bit(predictor):
    motion = cycle(60, offset=0.1)
    first = roll_out(predictor, motion, paper_horizons(5))
    roll_out(predictor, cycle(60, offset=-0.3, phase=2.0), paper_horizons(5))
    again = roll_out(predictor, motion, paper_horizons(5))
    np.testing.assert_array_equal(first.mean, again.mean)


@pytest.mark.parametrize('predictor', everyone(), ids=lambda p: type(p).__name__)
def test_nan_and_mask_mean_the_same(predictor):
    motion = cycle(60)
    shown = np.ones((60, 4), dtype=bool)
    shown[20:, 1] = False
    holes = motion.positions.copy()
    holes[20:, 1] = np.nan
    by_mask = roll_out(predictor, motion, paper_horizons(3), observed=shown)
    by_nan = roll_out(predictor, Motion(NAMES, holes, motion.times), paper_horizons(3))
    np.testing.assert_array_equal(by_mask.mean, by_nan.mean)
    np.testing.assert_array_equal(by_mask.filtered, by_nan.filtered)
    assert np.isfinite(by_nan.mean).all()


def test_constant_velocity_is_exact_on_a_ramp_even_with_gaps():
    times = np.cumsum(np.linspace(0.01, 0.03, 30))
    positions = times[:, None] * np.array([1.0, -1.0, 0.5, 0.0])
    positions[10:15, 0] = np.nan
    predictor = ConstantVelocity(NAMES)
    for frame in range(30):
        estimate = predictor.update(times[frame], positions[frame])
        if frame > 1:
            np.testing.assert_allclose(estimate.mean, times[frame] * np.array([1.0, -1.0, 0.5, 0.0]), atol=1e-12)
    np.testing.assert_allclose(predictor.predict([0.2]).mean[0], (times[-1] + 0.2) * np.array([1.0, -1.0, 0.5, 0.0]))


@pytest.mark.parametrize('decay', [1e-9, 0.7, 12.0])
def test_fading_velocity_is_its_integral_over_time(decay):
    slope = np.array([1.0, -1.0, 0.5, 0.0])
    predictor = ConstantVelocity(NAMES, decay=decay)
    for frame in range(8):
        y = frame / 60 * slope
        y[1] = y[1] if frame < 5 else np.nan  # unseen: it has been fading since its last observation
        predictor.update(frame / 60, y)
    guess = predictor.predict([0.1, 0.4]).mean
    for horizon, row in zip((0.1, 0.4), guess):
        for joint, last in enumerate((7, 4, 7, 7)):
            step = (horizon + (7 - last) / 60) / 20000
            moved = slope[joint] * step * np.exp(-decay * step * (np.arange(20000) + 0.5)).sum()
            assert row[joint] == pytest.approx(last / 60 * slope[joint] + moved, abs=1e-7)
    with pytest.raises(ValueError, match='decay'):
        ConstantVelocity(NAMES, decay=-1.0)


def test_nearest_histories_find_a_recording_seen_before_and_carry_an_offset():
    training = [cycle(240), cycle(240, period_s=0.8, phase=1.0)]
    predictor = NearestHistories(training, neighbours=1)
    rollout = roll_out(predictor, cycle(120), paper_horizons())
    settled = rollout.rows(slice(15, None))
    assert error_deg2(settled.mean, settled.actual) < 1e-12
    moved = roll_out(predictor, cycle(120, offset=0.02), paper_horizons()).rows(slice(15, None))
    assert error_deg2(moved.mean, moved.actual) < 0.5


def test_nearest_histories_equal_a_brute_force_search_with_random_masks():
    rng = np.random.default_rng(5)
    training = [Motion(NAMES, rng.normal(size=(n, 4)).cumsum(axis=0), np.arange(n) / 60, name=str(n)) for n in (50, 64)]
    test = Motion(NAMES, rng.normal(size=(20, 4)).cumsum(axis=0), np.arange(20) / 60)
    shown = rng.random((20, 4)) < 0.7
    shown[-1] = [True, False, True, True]
    predictor = NearestHistories(training, neighbours=3, frames=6, ahead_s=4 / 60)
    rollout = roll_out(predictor, test, [4 / 60], observed=shown)
    found = []
    for motion in training:
        for end in range(5, motion.n_frames - 4):
            apart = (motion.positions[end - 5:end + 1] - test.positions[-6:])[shown[-6:]]
            found.append((np.sum(apart ** 2), motion.positions[end], motion.positions[end + 4]))
    found.sort(key=lambda candidate: candidate[0])
    now = np.mean([candidate[1] for candidate in found[:3]], axis=0)
    then = np.mean([candidate[2] for candidate in found[:3]], axis=0)
    expected = np.where(shown[-1], test.positions[-1], now) + then - now
    np.testing.assert_allclose(rollout.mean[-1, 0], expected, atol=1e-10)


def test_least_squares_learns_a_linear_system():
    turn = 2 * np.pi / 50
    rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    state, path = np.array([1.0, 0.2]), []
    for _ in range(200):
        path.append(np.concatenate([state, 0.3 * state[::-1] + 0.1]))
        state = rotate @ state
    motion = Motion(NAMES, np.array(path), np.arange(200) / 60)
    settled = roll_out(LinearLeastSquares(NAMES, ridge=1e-9), motion, paper_horizons(10)).rows(slice(60, None))
    assert error_deg2(settled.mean, settled.actual) < 1e-4


def test_radial_bases_learn_a_cycle_better_than_holding_still():
    motion = cycle(600)
    horizons = paper_horizons(10)
    late = slice(300, None)
    learned = roll_out(RadialBasisNetwork([motion], per_axis=8), motion, horizons).rows(late)
    still = roll_out(ZeroVelocity(NAMES), motion, horizons).rows(late)
    assert error_deg2(learned.mean, learned.actual) < 0.05 * error_deg2(still.mean, still.actual)


def test_unusable_training_is_refused():
    with pytest.raises(MotionError, match='too short'):
        NearestHistories([cycle(20)])
    holes = cycle(100)
    with pytest.raises(MotionError, match='missing'):
        NearestHistories([Motion(NAMES, np.where(np.arange(400).reshape(100, 4) == 7, np.nan, holes.positions),
                                 holes.times, name='x')])
    with pytest.raises(MotionError, match='at least one'):
        NearestHistories([])


def made_behaviour(seed=0):
    """A phase-style model of two harmonics and two styles."""
    from style_core.phase_style.model import Behaviour
    rng = np.random.default_rng(seed)
    grid = np.arange(60) * 2 * np.pi / 60
    waves = np.stack([np.ones(60), np.cos(grid), np.sin(grid), np.cos(2 * grid), np.sin(2 * grid)], axis=1)
    bases = np.einsum('cw,jwd->jcd', waves, 0.4 * rng.normal(size=(2, 5, 4)))
    styles = np.array([[1.0, 0.3], [1.0, -0.3], [0.9, 0.0]])
    return Behaviour(
        name='made', rhythmic=True, joint_names=NAMES, rate_hz=60.0, sequences=('a', 'b', 'c'), groups=('a', 'b', 'c'),
        styles=styles, singular_values=np.ones(3), phase_grid=grid, bases=bases, beta=np.array([[1.0, 4.0, 1e6]] * 2),
        noise=np.full(4, 0.01 ** 2), acceleration=0.05, speeds=np.zeros((3, 2)), gaits=np.zeros(3, dtype=int),
        velocity=np.array([6.0, 0.5, 4.0, 8.0]))


def made_recording(behaviour, style=(0.95, 0.15), velocity=6.3, n_frames=150):
    times = np.arange(n_frames) / 60
    phase = 0.7 + velocity * times
    pose = np.einsum('j,jtd->td', np.array(style), np.stack([p.evaluate(phase)[0] for p in behaviour.processes()]))
    return Motion(NAMES, pose + 0.005 * np.random.default_rng(1).normal(size=pose.shape), times), phase


def test_known_phase_predicts_what_the_model_made():
    behaviour = made_behaviour()
    motion, phase = made_recording(behaviour)
    rollout = roll_out(KnownPhase(behaviour, motion.times, phase), motion, paper_horizons(10)).rows(slice(10, None))
    # what is left is the recording's own noise and that of a style learned from five frames
    assert 0.8 < error_deg2(rollout.mean, rollout.actual) / np.degrees(0.005) ** 2 < 1.6


def test_many_particles_come_close_to_the_ideal_and_a_seed_repeats():
    behaviour = made_behaviour()
    motion, _ = made_recording(behaviour, n_frames=100)
    rollout = roll_out(ParticleFilter(behaviour, 20000, seed=3), motion, paper_horizons(10))
    late = rollout.rows(slice(60, None))
    assert error_deg2(late.mean, late.actual) < 3 * np.degrees(0.005) ** 2
    few = [roll_out(ParticleFilter(behaviour, 200, seed=seed), motion, [0.1]).mean for seed in (3, 3, 4)]
    np.testing.assert_array_equal(few[0], few[1])
    assert not np.array_equal(few[0], few[2])
