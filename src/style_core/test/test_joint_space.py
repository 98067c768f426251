"""The joint space: exact both ways, blind to wraps and equivalent angles, and what on-line predictors make of it."""
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from style_core.angles import continuous, matrices_of, reordered, triples_from
from style_core.cli import main
from style_core.errors import ModelError
from style_core.evaluation import rms_deg, roll_out
from style_core.formats import write_motion
from style_core.joint_space import fit_space, read_space, space_of
from style_core.joint_space.online import Border, SpacedPredictor
from style_core.locomotion.learn import features_of
from style_core.motion import Motion
from style_core.phase_style import load_behaviours
from style_core.predictor import Estimate, Prediction, Status
from style_core.predictor_file import read_predictor
from style_core.style_machine import Settings, learn, load, save
from style_core.style_machine.online import StyleMachinePredictor
from style_core.style_machine.synthesis import synthesize
from style_core.synthesis.repertoire import load_repertoire

ORDERS = [''.join(order) for order in itertools.permutations('XYZ')]
NAMES = ('hip.rx', 'hip.ry', 'hip.rz', 'knee', 'slide')
UNITS = ('rad',) * 4 + ('m',)
MODELS = Path(__file__).resolve().parents[3] / 'config' / 'models'


def motion_of(seed, order='XYZ', frames=60, size=0.5, name='m'):
    """A hip that swings about any pose, a knee and a slide."""
    rng = np.random.default_rng(seed)
    times = np.arange(frames) / 60
    swing = np.sin(2 * np.pi * times[:, None] + rng.uniform(0, 6, 5)) * rng.uniform(0.2, 1, 5) * size
    home = np.append(rng.uniform(-3, 3, 4), 1.0)
    return Motion(NAMES, home + swing, times, UNITS, name, orders={'hip': order})


def turns_of(positions, order):
    """By SciPy."""
    columns = ['XYZ'.index(letter) for letter in order]
    return Rotation.from_euler(order.lower(), positions[:, columns])


@given(st.sampled_from(ORDERS), st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3))
def test_triples_and_matrices_agree_with_scipy(order, angles):
    matrix = matrices_of(np.array(angles), order)
    np.testing.assert_allclose(matrix, turns_of(np.array([angles]), order).as_matrix()[0], atol=1e-12)
    np.testing.assert_allclose(matrices_of(triples_from(matrix, order), order), matrix, atol=1e-8)


@given(st.sampled_from(ORDERS), st.sampled_from(ORDERS), st.integers(0, 10**6))
def test_another_order_is_the_same_rotation(one, other, seed):
    motion = motion_of(seed, one)
    again = reordered(motion, {'hip': other})
    assert again.order_of('hip') == other
    np.testing.assert_allclose(turns_of(again.positions, other).as_matrix(),
                               turns_of(motion.positions, one).as_matrix(), atol=1e-8)


@given(st.sampled_from(ORDERS), st.integers(0, 10**6), st.floats(0.05, 3.0))
def test_coordinates_come_back_exactly(order, seed, size):
    motion = motion_of(seed, order, size=size)
    space = fit_space([motion.slice(0, 0.3)])   # also poses far from home
    values = space.encode(motion.positions)
    back = space.decode(values)
    np.testing.assert_allclose(turns_of(back, order).as_matrix(), turns_of(motion.positions, order).as_matrix(),
                               atol=1e-9)
    np.testing.assert_array_equal(back[:, 4], motion.positions[:, 4])
    for row in range(0, len(back), 7):
        near = motion.positions[row] + 0.01
        np.testing.assert_allclose(space.decode(values[row], near)[:3], motion.positions[row, :3], atol=1e-6)


@given(st.sampled_from(ORDERS), st.integers(0, 10**6))
def test_coordinates_are_the_rotation_vector_from_home_by_scipy(order, seed):
    motion = motion_of(seed, order)
    space = fit_space([motion])
    values = space.encode(motion.positions)[:, :3]
    home = Rotation.from_matrix(space.homes[0])
    mean = turns_of(motion.positions, order).mean()
    assert (home.inv() * mean).magnitude() < 1e-6
    relative = (home.inv() * turns_of(motion.positions, order)).as_rotvec()
    np.testing.assert_allclose(values @ space.frames[0].T, relative, atol=1e-7)


@given(st.sampled_from(ORDERS), st.integers(0, 10**6))
def test_wraps_and_equivalent_triples_change_nothing(order, seed):
    motion = motion_of(seed, order)
    rng = np.random.default_rng(seed)
    other = motion.positions.copy()
    flipped = rng.random(len(other)) < 0.5
    middle = 'XYZ'.index(order[1])
    other[flipped, :3] += np.pi
    other[flipped, middle] = np.pi - motion.positions[flipped, middle]
    other[:, :4] += 2 * np.pi * rng.integers(-1, 1, size=(len(other), 4))
    space = fit_space([motion])
    np.testing.assert_allclose(space.encode(other), space.encode(motion.positions), atol=1e-9)


@given(st.sampled_from(ORDERS), st.integers(0, 10**6))
def test_rates_and_deviations_are_the_derivative(order, seed):
    motion = motion_of(seed, order)
    space = fit_space([motion])
    values, near = space.encode(motion.positions[5]), motion.positions[5]
    middle = near['XYZ'.index(order[1])]
    if abs(np.cos(middle)) < 0.1:
        return  # near the lock rates are bounded
    step = 1e-6
    ends = [[space.decode(values + sign * step * unit, near) for sign in (1, -1)] for unit in np.eye(5)]
    slopes = np.stack([(after - before) / (2 * step) for after, before in ends], axis=1)
    velocity, std = np.random.default_rng(seed).normal(size=(2, 5)) * 0.02
    _, spread, rate = space.decode(values, near, np.abs(std), velocity)
    np.testing.assert_allclose(rate, slopes @ velocity, atol=1e-6)
    np.testing.assert_allclose(spread, np.sqrt(slopes**2 @ std**2), atol=1e-6)


def test_away_from_the_lock_a_coordinate_is_its_angle_to_first_order():
    motion = motion_of(0, size=0.01)
    motion = motion.replace(positions=motion.positions - motion.positions.mean(axis=0) + [0.4, 0.1, -0.7, 0.2, 0])
    space = fit_space([motion])
    assert space.apart.all()
    change = motion.positions[:, :3] - space.home[:3]
    np.testing.assert_allclose(space.encode(motion.positions)[:, :3], change, atol=0.15 * np.abs(change).max())


def test_a_joint_that_goes_round_is_not_folded_and_one_at_the_wrap_is():
    times = np.arange(100) / 60
    wheel = np.linspace(0, 20, 100)
    first = Motion(('wheel', 'knee'), np.column_stack([wheel, 3.1 + 0.3 * np.sin(times)]), times)
    second = first.replace(positions=first.positions - [0, 2 * np.pi])
    space = fit_space([first, second])
    assert space.folds.tolist() == [False, True]
    np.testing.assert_allclose(space.encode_motion(first).positions, space.encode_motion(second).positions, atol=1e-12)
    np.testing.assert_array_equal(space.encode_motion(first).positions[:, 0], wheel)


def test_a_space_is_kept_by_a_model_file_and_damage_is_refused():
    space = fit_space([motion_of(1, 'ZXY')])
    header, arrays = space.entries()
    again = read_space(header, arrays)
    for name in ('homes', 'frames', 'centres', 'folds'):
        np.testing.assert_array_equal(getattr(again, name), getattr(space, name))
    assert again.orders == {'hip': 'ZXY'} and read_space({}, {}) is None
    for change in ({'joint_space.homes': np.zeros((1, 3, 3))}, {'joint_space.centres': np.zeros(2)},
                   {'joint_space.folds': np.array(['x'])}):
        with pytest.raises(ModelError, match='joint space'):
            read_space(header, {**arrays, **change})
    with pytest.raises(ModelError, match='whole'):
        space.select(['hip.rx', 'knee'])


class Echo:
    """Predicts what it is shown, in whatever coordinates."""

    joint_names = NAMES

    def reset(self):
        self.values = np.zeros(5)

    def update(self, time, y, mask=None):
        self.shown = y
        self.values = np.where(np.isnan(y), self.values, y)
        nan = float('nan')
        return Estimate(time, nan, nan, np.zeros((2, 2)), np.zeros(1), np.zeros((1, 1)), self.values.copy(),
                        np.full(5, 0.01), ~np.isnan(y), 1.0, 0.0, Status.TRACKING)

    def predict(self, horizons):
        rows = len(horizons)
        return Prediction(horizons, np.tile(self.values, (rows, 1)), np.full((rows, 5), 0.01), np.zeros((rows, 5)))


def spaced(motion):
    predictor = SpacedPredictor(Echo(), fit_space([motion]))
    predictor.reset()
    return predictor


@pytest.mark.parametrize('order', ORDERS)
def test_what_comes_out_is_on_the_branch_of_what_came_in(order):
    motion = motion_of(3, order)
    predictor = spaced(motion)
    shifted = motion.positions + [2 * np.pi, 0, -2 * np.pi, 2 * np.pi, 0]
    for k, y in enumerate(shifted):
        estimate = predictor.update(k / 60, y)
        np.testing.assert_allclose(estimate.mean, y, atol=1e-8)
        np.testing.assert_allclose(predictor.predict(np.array([0.1, 0.2])).mean, [y, y], atol=1e-8)
        assert estimate.observed.all()


def test_a_single_angle_of_a_ball_joint_counts():
    motion = motion_of(4)
    motion = motion.replace(positions=motion.positions - motion.positions.mean(axis=0) + [0.5, 0.1, 0.2, 0.3, 1.0])
    predictor = spaced(motion)
    y = predictor._border.space.home.copy()
    y[0] += 0.2
    y[1:3] = np.nan
    estimate = predictor.update(0.0, y)
    assert estimate.observed.tolist() == [True, False, False, True, True]
    assert np.isnan(predictor.predictor.shown[1:3]).all()
    assert estimate.mean[0] == pytest.approx(y[0], abs=0.01)
    masked = predictor.update(0.1, np.nan_to_num(y), np.array([True, False, False, False, True]))
    assert masked.observed.tolist() == [True, False, False, False, True]


def test_near_the_gimbal_lock_single_angles_hide_the_joint():
    motion = motion_of(5, size=0.05)
    motion = motion.replace(positions=motion.positions - motion.positions.mean(axis=0) + [0, 1.5, 0, 0, 1])
    border = Border(fit_space([motion]))
    y = motion.positions[0].copy()
    y[2] = np.nan
    assert np.isnan(border.enter(y, None)[:3]).all()
    assert np.isfinite(border.enter(motion.positions[0], None)).all()


def test_garbage_of_sensors_is_not_made_plausible():
    motion = motion_of(6)
    border = Border(fit_space([motion]))
    y = motion.positions[0].copy()
    y[0], y[3] = 4096.0, 4096.0
    values = border.enter(y, None)
    assert np.isnan(values[:3]).all() and values[3] == 4096.0
    with pytest.raises(ValueError, match='shape'):
        border.enter(y[:3], None)


@pytest.fixture(scope='module')
def pair():
    """Two recordings, and the same two as another program would have written them: other turns, other triples."""
    times = np.arange(150) / 60
    files = []
    for k, speed in enumerate((1.0, 1.25)):
        phase = 2 * np.pi * speed * times
        positions = np.column_stack([0.4 * np.sin(phase), 1.5 + 0.2 * np.cos(phase), 0.3 * np.sin(phase + 1),
                                     3.1 + 0.4 * np.sin(phase), 0.1 * np.cos(phase)])
        files.append(Motion(NAMES, positions, times, UNITS, f'r{k}', orders={'hip': 'ZXY'}))
    second = files[1].positions.copy()
    second[:, :3] += np.pi
    second[:, 0] = np.pi - files[1].positions[:, 0]
    second[:, 3] -= 2 * np.pi
    return files, [files[0], files[1].replace(positions=second)]


@pytest.fixture(scope='module')
def machines(pair):
    return [learn(motions, Settings(states=10, anneal=15), rate_hz=60.0) for motions in pair]


def test_a_style_machine_does_not_depend_on_where_angles_wrap(machines, pair):
    one, other = machines
    np.testing.assert_allclose(other.generic.positions, one.generic.positions, atol=1e-6)
    np.testing.assert_allclose(np.array(list(other.styles.values())), np.array(list(one.styles.values())), atol=1e-6)
    assert np.abs(one.at('r0').pose - one.at('r1').pose).max() < 0.2    # the same pose on another turn is no style


def test_a_style_machine_in_another_order_follows_and_performs_in_angles(machines, pair, tmp_path):
    save(machines[0], tmp_path / 'm.npz')
    machine = load(tmp_path / 'm.npz')
    predictor = StyleMachinePredictor(machine)
    motion = pair[1][1]
    for time, y in zip(motion.times[:90], motion.positions[:90]):
        estimate = predictor.update(time, y)
    np.testing.assert_allclose(estimate.mean, motion.positions[89], atol=1e-6)
    ahead = predictor.predict(np.arange(1, 7) / 60)
    error = np.abs(ahead.mean - motion.positions[90:96]).max()
    assert error < 0.35 and error < 1.5 * np.abs(motion.positions[90:96] - motion.positions[89]).max()
    made = synthesize(machine, machine.recordings['r0'], 'r0')
    assert made.order_of('hip') == 'ZXY'
    gap = (turns_of(made.positions, 'ZXY').inv() * turns_of(pair[0][0].positions, 'ZXY')).magnitude()
    assert np.median(gap) < 0.25 and read_predictor(tmp_path / 'm.npz').predictor.orders == {'hip': 'ZXY'}


def test_features_of_locomotion_do_not_depend_on_where_angles_wrap(pair):
    (one_map, one, _), (_, other, _) = (features_of(motions) for motions in pair)
    for a, b in zip(one, other):
        np.testing.assert_allclose(a, b, atol=1e-9)
    back = one_map.decode(one[1], pair[0][1].times)
    np.testing.assert_allclose(turns_of(back.positions, 'ZXY').as_matrix(),
                               turns_of(pair[0][1].positions, 'ZXY').as_matrix(), atol=1e-9)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_gaps_are_filled_on_the_branch_of_what_is_there(seed):
    motion = continuous(motion_of(seed, 'YZX'))
    space = fit_space([motion])
    values = space.encode(motion.positions)
    holed = motion.positions.copy()
    holed[:5] = holed[20:30, :3] = holed[40:50, 1] = np.nan
    filled, std = space.fill_in(holed, values, np.full(values.shape, 0.01))
    there = ~np.isnan(holed)
    np.testing.assert_array_equal(filled[there], holed[there])
    np.testing.assert_allclose(turns_of(filled, 'YZX').as_matrix(), turns_of(motion.positions, 'YZX').as_matrix(),
                               atol=1e-8)
    assert np.isfinite(std).all()


@pytest.mark.parametrize('name', ['locomotion', 'everyday', 'jump', 'locomotion_styles'])
def test_models_from_before_work_in_angles_as_they_did(name):
    assert space_of(MODELS / f'{name}.npz') is None
    found = read_predictor(MODELS / f'{name}.npz').predictor
    assert not isinstance(found, SpacedPredictor) and getattr(found, '_border', None) is None


def test_a_phase_style_model_does_not_depend_on_where_angles_wrap(pair, tmp_path):
    for k, motions in enumerate(pair):
        for motion in motions:
            write_motion(motion, tmp_path / f'{motion.name}.npz')
        files = [str(tmp_path / f'{motion.name}.npz') for motion in motions]
        model = ['-o', str(tmp_path / f'm{k}.npz')]
        assert main(['train', 'phase-style', *files, *model, '--joints', 'hip.*', 'knee']) == 0
    one, other = (load_behaviours(tmp_path / f'm{k}.npz')[0] for k in range(2))
    np.testing.assert_allclose(other.bases, one.bases, atol=1e-6)
    np.testing.assert_allclose(other.styles, one.styles, atol=1e-6)
    found = read_predictor(tmp_path / 'm1.npz', without=['unknown']).predictor
    motion = pair[1][1].joints(found.joint_names)
    rollout = roll_out(found, motion, np.arange(1, 11) / 60)
    assert found.orders == {'hip': 'ZXY'}
    np.testing.assert_allclose(rollout.filtered[60:], motion.positions[60:], atol=0.1)  # on the recording's branch
    assert rms_deg(rollout.mean, rollout.actual)[-1] < 0.5 * rms_deg(rollout.present[:, None], rollout.actual)[-1]
    source = load_repertoire(str(tmp_path / 'm1.npz')).source('cycle')
    ahead = np.arange(0, 0.5, 0.01)
    positions, velocities = source.window(ahead)
    np.testing.assert_allclose(velocities, np.gradient(positions, ahead, axis=0, edge_order=2), atol=0.15)
    near = [min((Rotation.from_euler('zxy', row[[2, 0, 1]]).inv() * turns_of(motion.positions, 'ZXY')).magnitude())
            for row in positions]
    assert max(near) < 0.3      # poses that were recorded, in angles
