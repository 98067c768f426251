"""Sources of motion, changes of style, windows, and the exchange of sources: continuous whatever happens."""
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import ModelError, MotionError, UsageError
from style_core.motion import Motion
from style_core.phase_style import load_behaviours
from style_core.style_machine import Settings, learn, random_walk
from style_core.synthesis.glide import Glide
from style_core.synthesis.performer import Performer, window_times
from style_core.synthesis.retargeting import plain_robot
from style_core.synthesis.sources.phase_style import CycleSource, FollowSource
from style_core.synthesis.sources.recording import MotionFileSource
from style_core.synthesis.sources.source import read_style
from style_core.synthesis.sources.style_machine import MachineSource, frames_of_occupancy, frames_of_states

MODELS = Path(__file__).resolve().parents[3] / 'config' / 'models'
TICK = 0.01
AHEAD = window_times(1 / 60, 0.4)


@pytest.fixture(scope='module')
def walk():
    return load_behaviours(MODELS / 'locomotion.npz')[0]


@pytest.fixture(scope='module')
def jump():
    return load_behaviours(MODELS / 'jump.npz')[0]


def made_gait(frequency=0.9, amplitude=0.4, lean=0.0, seconds=4.0, name='walk'):
    times = np.arange(int(seconds * 60)) / 60
    phase = 2 * np.pi * frequency * times[:, None] + np.array([0.0, 0.8, 1.7])
    positions = amplitude * np.sin(phase) + 0.1 * np.sin(2 * phase) + lean
    return Motion(('hip', 'knee', 'ankle'), positions, times, name=name)


@pytest.fixture(scope='module')
def machine():
    return learn([made_gait(), made_gait(1.4, 0.6, 0.3, name='run')],
                 Settings(states=8, anneal=8, max_iterations=15), leading=2, dof=1)


@pytest.fixture
def sources(walk, jump, machine):
    """A new source of every kind."""
    def make(kind):
        if kind == 'cycle':
            return CycleSource(walk)
        if kind == 'discrete':
            return CycleSource(jump)
        if kind == 'follow':
            source = FollowSource(walk, coast=60.0)
            source.estimate(1.0, 6.0)
            return source
        if kind == 'walk':
            return MachineSource(machine, visits=random_walk(machine, seed=3))
        if kind == 'sequence':
            return MachineSource(machine, frames=frames_of_states([0, 1, 2, 3], [0.3, 0.4, 0.2, 0.5], machine))
        return MotionFileSource(made_gait(), loop=kind == 'loop')
    return make


KINDS = ['cycle', 'discrete', 'follow', 'walk', 'sequence', 'file', 'loop']


# --- glide ------------------------------------------------------------------------------------------------------

@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(0.05, 2.0), st.floats(0.0, 2.5)), min_size=1, max_size=6))
def test_glide_is_smooth_and_arrives(changes):
    glide, times = Glide([0.0, 1.0]), []
    for target, seconds, wait in changes:
        before = glide.at(), glide.rate()
        glide.go([target, -target], seconds)
        np.testing.assert_allclose(glide.at(), before[0], atol=1e-12)
        np.testing.assert_allclose(glide.rate(), before[1], atol=1e-9)
        times = np.linspace(0.0, 3.0, 400)
        values, rates = glide.at(times), glide.rate(times)
        np.testing.assert_allclose(values[-1], [target, -target], atol=1e-9)
        step = times[1]
        np.testing.assert_allclose(values[1:] - values[:-1], 0.5 * step * (rates[1:] + rates[:-1]),
                                   atol=20 * step**3 * (1 + np.abs(rates).max()) / seconds**2)
        area = np.concatenate([[0.0], np.cumsum(0.5 * step * (values[1:, 0] + values[:-1, 0]))])
        np.testing.assert_allclose(glide.integral(times)[:, 0], area, atol=2e-2 * (1 + np.abs(values).max()))
        ahead = glide.at(0.3)
        glide.advance(0.3)
        np.testing.assert_allclose(glide.at(), ahead, atol=1e-9)
        glide.advance(wait)


# --- every source -----------------------------------------------------------------------------------------------

@pytest.mark.parametrize('kind', KINDS)
def test_velocities_are_the_derivative_and_windows_agree(sources, kind):
    source = sources(kind)
    rng = np.random.default_rng(1)
    for _ in range(40):
        fine = np.sort(rng.uniform(0, 0.4, 5))
        eps = 1e-6
        velocity = source.window(fine)[1]
        plus, minus = source.window(fine + eps)[0], source.window(np.maximum(fine - eps, 0))[0]
        slope = (plus - minus) / (fine + eps - np.maximum(fine - eps, 0))[:, None]
        np.testing.assert_allclose(slope, velocity, atol=1e-4 * (1 + np.abs(velocity).max()))
        dt = rng.uniform(0.001, 0.05)
        foreseen = source.window(np.array([dt, dt + 0.1]))
        source.advance(dt)
        for one, other in zip(source.window(np.array([0.0, 0.1])), foreseen):
            np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize('kind', ['discrete', 'sequence', 'file'])
def test_what_ends_comes_to_rest_and_stays(sources, kind):
    source = sources(kind)
    left = source.remaining
    assert 0 < left < 20
    source.advance(left + 0.01)
    position, velocity = source.window(np.array([0.0, 1.0]))
    assert source.remaining == 0 or source.remaining < 0.05
    np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
    np.testing.assert_array_equal(position[0], position[1])


@pytest.mark.parametrize('kind', ['cycle', 'discrete', 'walk', 'sequence', 'file', 'loop'])
def test_speed_zero_stands_still_and_goes_on(sources, kind):
    source = sources(kind)
    source.advance(0.1)
    source.set_speed(0.0, 0.2)
    for _ in range(30):
        source.advance(TICK)
    first = source.window([0.0, 0.3])
    np.testing.assert_allclose(first[1], 0.0, atol=1e-9)
    source.advance(5.0)
    np.testing.assert_allclose(source.window([0.0])[0], first[0][:1], atol=1e-9)
    source.set_speed(1.0, 0.2)
    source.advance(0.3)
    assert np.abs(source.window([0.0])[0] - first[0][:1]).max() > 1e-3
    with pytest.raises(UsageError):
        source.set_speed(-1.0, 0.1)
    with pytest.raises(UsageError):
        source.set_speed(np.nan, 0.1)


@pytest.mark.parametrize('kind', ['cycle', 'follow', 'walk', 'sequence'])
def test_bad_styles_are_refused_and_change_nothing(sources, kind):
    source = sources(kind)
    style = source.target.copy()
    for bad in (np.zeros(len(style) + 1), np.full(len(style), np.nan), np.full(len(style), np.inf)):
        with pytest.raises(UsageError):
            source.set_style(bad, 0.5)
    with pytest.raises(UsageError, match='no style'):
        read_style(source, 'nobody')
    np.testing.assert_array_equal(source.target, style)


def test_style_expressions(walk):
    source = CycleSource(walk)
    a, b = walk.sequences[:2]
    np.testing.assert_allclose(read_style(source, f'1.5*"{a}" - 0.5*"{b}"'),
                               1.5 * walk.styles[0] - 0.5 * walk.styles[1])
    with pytest.raises(UsageError, match='no styles'):
        read_style(MotionFileSource(made_gait()), 'walk')


# --- changes of style at any time -------------------------------------------------------------------------------

def run(performer, seconds, rng, act, every):
    """Positions now at every tick, with ``act`` called at random times about ``every`` seconds apart."""
    out, due = [], rng.exponential(every)
    for k in range(round(seconds / TICK)):
        while due < k * TICK:
            act()
            due += rng.exponential(every)
        positions, velocities = performer.window(np.array([0.0, 0.1]))
        out.append((positions[0], velocities[0]))
        performer.advance(TICK)
    positions, velocities = (np.array(part) for part in zip(*out))
    return positions, velocities


def bend(positions):
    """Largest second difference, rad."""
    return np.abs(np.diff(positions, n=2, axis=0)).max()


def training_bend(behaviour):
    """Largest second difference, at the same ticks, of the model in its training styles."""
    largest = 0.0
    for v in behaviour.styles:
        source = CycleSource(behaviour, style=v)
        largest = max(largest, bend(source.window(TICK * np.arange(200))[0]))
    return largest


@pytest.mark.parametrize('every', [2.0, 0.15])
@pytest.mark.parametrize('kind', ['cycle', 'follow'])
def test_style_changes_at_random_times_are_as_smooth_as_the_training_data(sources, walk, kind, every):
    """Also mid-transition: changes take 0.5 s, and with 0.15 s between them most come while another is under way."""
    source = sources(kind)
    rng = np.random.default_rng(5)

    def act():
        source.set_style(walk.styles[rng.integers(len(walk.styles))], 0.5)
        if kind == 'follow':
            source.estimate(source.phase + rng.normal(0, 0.1), 6.0 + rng.normal(0, 0.3))
    positions, velocities = run(Performer(source, plain_robot()), 15.0, rng, act, every)
    assert bend(positions) < 1.5 * training_bend(walk)
    # positions follow velocities: nothing jumps between ticks
    np.testing.assert_allclose(np.diff(positions, axis=0), 0.5 * TICK * (velocities[1:] + velocities[:-1]), atol=2e-3)


def test_real_training_data_bends_as_much(trial, walk, sources):
    """The same against the recordings themselves."""
    from style_core.angles import continuous
    real = max(bend(continuous(trial(name, 100.0)).joints(walk.joint_names).positions)
               for name in walk.sequences)
    rng = np.random.default_rng(6)
    source = sources('cycle')
    positions, _ = run(Performer(source, plain_robot()), 20.0, rng,
                       lambda: source.set_style(walk.styles[rng.integers(len(walk.styles))], 0.5), 0.3)
    assert bend(positions) < real


def test_style_machine_changes_style_smoothly(machine, sources):
    source = sources('walk')
    rng = np.random.default_rng(2)
    names = list(source.styles)
    positions, velocities = run(Performer(source, plain_robot()), 12.0, rng,
                                lambda: source.set_style(source.styles[rng.choice(names)], 0.4), 0.6)
    assert bend(positions) < 3 * bend(made_gait(1.4, 0.6, 0.3).resample(100.0).positions)
    np.testing.assert_allclose(np.diff(positions, axis=0), 0.5 * TICK * (velocities[1:] + velocities[:-1]), atol=4e-3)


def test_change_of_style_arrives(sources, walk):
    source = sources('cycle')
    source.set_style(walk.styles[2], 0.5)
    source.advance(0.51)
    np.testing.assert_allclose(source.style, walk.styles[2])
    expected = CycleSource(walk, style=walk.styles[2])
    expected.advance(0.51)
    np.testing.assert_allclose(source.window(AHEAD)[0], expected.window(AHEAD)[0], atol=1e-9)


# --- exchange of sources ----------------------------------------------------------------------------------------

@given(st.integers(0, 10**6))
@settings(max_examples=4)
def test_exchange_at_random_times_is_smooth(walk, seed):
    rng = np.random.default_rng(seed)
    performer = Performer(CycleSource(walk), plain_robot())

    def act():
        performer.exchange(CycleSource(walk, style=walk.styles[rng.integers(len(walk.styles))],
                                       phase=rng.uniform(0, 6.28)), 0.6)
    positions, velocities = run(performer, 5.0, rng, act, 0.5)
    np.testing.assert_allclose(np.diff(positions, axis=0), 0.5 * TICK * (velocities[1:] + velocities[:-1]), atol=5e-3)
    # a quintic over 0.6 s from any pose of the gait to any other
    assert bend(positions) < 4 * training_bend(walk)


def test_exchange_ends_exactly_in_the_new_source(walk):
    performer, other = Performer(CycleSource(walk), plain_robot()), CycleSource(walk, phase=2.0)
    performer.exchange(other, 0.4)
    assert performer.blending
    performer.advance(0.41)
    np.testing.assert_array_equal(performer.window(AHEAD)[0], other.window(AHEAD)[0])
    assert not performer.blending


def test_exchange_waits_until_the_other_is_ready(walk):
    performer, follow = Performer(CycleSource(walk), plain_robot()), FollowSource(walk)
    old = performer.source
    performer.exchange(follow, 0.4)
    performer.advance(0.1)
    assert performer.source is old
    follow.estimate(1.0, 6.0)
    performer.advance(0.1)
    assert performer.source is follow


def test_exchange_to_another_robot_is_refused(walk):
    performer = Performer(CycleSource(walk), plain_robot())
    with pytest.raises(ModelError, match='other joints'):
        performer.exchange(MotionFileSource(made_gait()), 0.4)


# --- following --------------------------------------------------------------------------------------------------

def test_follow_tracks_phase_and_cadence(walk):
    source = FollowSource(walk)
    assert not source.ready
    rng = np.random.default_rng(0)
    phase, error = 0.5, []
    for k in range(1000):
        velocity = 5.5 + 0.5 * np.sin(k / 200)
        phase += velocity * TICK
        source.advance(TICK)
        if k % 2 == 0:      # estimates at 50 Hz, 20 ms old, noisy
            source.estimate((phase - 0.02 * velocity + rng.normal(0, 0.03)) % (2 * np.pi), velocity, age=0.02)
        error.append((source.phase - phase + np.pi) % (2 * np.pi) - np.pi)
    assert source.ready and source.following
    assert np.sqrt(np.mean(np.square(error[100:]))) < 0.03


def test_follow_coasts_then_stops_and_resumes_smoothly(walk):
    source = FollowSource(walk, patience=0.1, coast=0.4, stop=0.6)
    source.estimate(0.0, 6.0)
    speeds, poses = [], []
    for k in range(500):
        if k >= 300:
            source.estimate(source.phase + 1.0 if k == 300 else source.phase, 6.0)
        poses.append(source.window(np.array([0.0]))[0][0])
        before = source.phase
        source.advance(TICK)
        speeds.append(((source.phase - before + np.pi) % (2 * np.pi) - np.pi) / TICK)
    np.testing.assert_allclose(speeds[:45], 6.0, atol=0.01)     # coasts
    np.testing.assert_allclose(speeds[115:300], 0.0, atol=0.01)   # stands
    np.testing.assert_allclose(speeds[-1], 6.0, atol=0.3)       # goes on
    assert np.abs(np.diff(speeds)).max() < 0.8      # 80 rad/s^2: never an edge
    assert bend(np.array(poses)) < 2.5 * training_bend(walk)


@pytest.mark.parametrize('bad', [(np.nan, 1.0, 0.0), (0.0, np.inf, 0.0), (0.0, 1.0, np.nan)])
def test_follow_refuses_nonsense(walk, bad):
    source = FollowSource(walk)
    source.estimate(1.0, 6.0)
    before = source.window(AHEAD)
    with pytest.raises(UsageError):
        source.estimate(*bad)
    np.testing.assert_array_equal(source.window(AHEAD)[0], before[0])


def test_follow_limits_absurd_speed(walk):
    source = FollowSource(walk)
    source.estimate(0.0, 1e6)
    assert np.abs(source.window(AHEAD)[1]).max() < 60


def test_only_rhythmic_behaviours_can_be_followed(jump):
    with pytest.raises(UsageError, match='rhythmic'):
        FollowSource(jump)


# --- sequences, files -------------------------------------------------------------------------------------------

def test_frames_of_states_keep_their_times(machine):
    frames = frames_of_states([0, 2, 1], [0.5, 0.25, 1.0], machine)
    np.testing.assert_array_equal(np.bincount(frames), [30, 60, 15])


@pytest.mark.parametrize('states, times', [([0], [0.5, 0.5]), ([], []), ([0, 99], [1, 1]), ([-1], [1.0]),
                                           ([0], [0.0]), ([0], [np.nan]), ([0], [1e9])])
def test_impossible_sequences_are_refused(machine, states, times):
    with pytest.raises(UsageError):
        frames_of_states(states, times, machine)


def test_occupancies_are_resampled_and_checked(machine):
    n = machine.n_states
    rows = np.eye(n)[[0, 0, 1, 1]]
    frames = frames_of_occupancy(rows, 0.25, machine)
    assert frames.shape == (60, n)
    np.testing.assert_allclose(frames.sum(axis=1), 1.0)
    assert frames[0, 0] == 1 and frames[-1, 1] == 1
    for bad in (rows[:, :-1], 0.5 * rows, -rows, np.full_like(rows, np.nan), rows[:0]):
        with pytest.raises(UsageError):
            frames_of_occupancy(bad, 0.25, machine)
    with pytest.raises(UsageError):
        frames_of_occupancy(rows, 0.0, machine)


def test_same_seed_same_walk(machine):
    def poses(seed):
        return MachineSource(machine, visits=random_walk(machine, seed=seed)).window(np.linspace(0, 4, 50))[0]
    np.testing.assert_array_equal(poses(1), poses(1))


def test_loop_has_no_seam():
    source = MotionFileSource(made_gait(seconds=5.3), loop=True)
    positions = source.window(TICK * np.arange(3000))[0]
    assert bend(positions) < 2.0 * bend(made_gait(seconds=5.3).resample(100.0).positions)


def test_files_with_holes_are_refused():
    motion = made_gait()
    holes = motion.positions.copy()
    holes[3, 1] = np.nan
    with pytest.raises(MotionError, match='missing'):
        MotionFileSource(motion.replace(positions=holes))
    with pytest.raises(MotionError, match='single'):
        MotionFileSource(motion.slice(0.0, 0.01))


def test_window_times():
    np.testing.assert_allclose(window_times(0.02, 0.1), [0.0, 0.02, 0.04, 0.06, 0.08, 0.1])
    np.testing.assert_allclose(window_times(0.2, 0.1), [0.0, 0.2])
