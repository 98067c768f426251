"""Learning, analysing, filling, blending and predicting with the locomotion model, on made gaits and real ones."""
import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core.cli import main
from style_core.errors import ModelError, MotionError, UsageError
from style_core.formats import write_motion
from style_core.locomotion import model as model_file
from style_core.locomotion.choose import choose_styles
from style_core.locomotion.features import FeatureMap, feature_map
from style_core.locomotion.infer import aligned_cycles, analyze, fill, smooth
from style_core.locomotion.learn import learn
from style_core.locomotion.online import LocomotionPredictor, fill_causally
from style_core.locomotion.personal import Personal, bridge, departure
from style_core.locomotion.synthesis import parse_blend, prototypes, synthesize
from style_core.motion import Motion
from style_core.predictor import Status

NAMES = tuple(f'{side}_{joint}' for side in ('left', 'right') for joint in ('hip', 'knee', 'ankle'))
RATE = 40.0


def made_gait(style, seed, duration=3.5, pace=1.0, name='', noise=0.01):
    """Two styles of a made gait; returns the motion and its true phase."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(duration * RATE)) / RATE
    speed = 2 * np.pi * (1.0, 1.5)[style] * pace
    phase = rng.uniform(0, 2 * np.pi) + speed * times + 0.15 * np.sin(2 * np.pi * 0.3 * times + rng.uniform(0, 6))
    at = phase[:, None] + np.repeat([0, np.pi], 3) + np.tile([0, 0.7, 1.5], 2)
    y = (0.3, 0.5)[style] * np.sin(at) + (0.1, 0.25)[style] * np.cos(2 * at) + (0.0, 0.2)[style]
    return Motion(NAMES, y + noise * rng.normal(size=y.shape), times, name=name or f's{style}_{seed}'), phase


@pytest.fixture(scope='module')
def gaits():
    return [made_gait(k % 2, k, pace=(0.93, 1.0, 1.06)[k % 3])[0] for k in range(8)]


@pytest.fixture(scope='module')
def learned(gaits):
    return learn(gaits, 2, seed=0, restarts=2)


def test_two_made_styles_are_found_without_labels(gaits, learned):
    groups = learned.labels.argmax(axis=1)
    assert (groups[::2] == groups[0]).all() and (groups[1::2] == groups[1]).all() and groups[0] != groups[1]
    slow, fast = groups[0], groups[1]
    assert learned.periods_s[slow] == pytest.approx(1.0, rel=0.06)
    assert learned.periods_s[fast] == pytest.approx(1 / 1.5, rel=0.06)
    assert (np.diff(learned.bounds) >= -1e-7 * np.abs(learned.bounds[1:])).all()
    # the size of the cycle follows from the data: twice the middle period
    assert 1.5 * RATE < learned.n_positions < 2.2 * RATE


def test_learning_is_reproducible_bit_for_bit(gaits, learned):
    again = learn(gaits, 2, seed=0, restarts=2, threads=2)
    np.testing.assert_array_equal(again.mean, learned.mean)
    np.testing.assert_array_equal(again.labels, learned.labels)


def test_phase_follows_the_true_phase_of_a_new_recording(learned):
    motion, truth = made_gait(0, 100, pace=1.05)
    found = analyze(learned, motion)
    drift = found.phase - truth
    assert np.std(drift) < 0.12
    assert (np.diff(found.phase) > 0).all()
    cycles, times = aligned_cycles(learned, motion, n_samples=50)
    assert cycles.shape == (len(found.cycle_times_s) - 1, 50, 6)
    assert np.abs(cycles[0] - cycles[1]).max() < 0.12
    assert (np.diff(times.ravel()) > 0).all()


def test_a_recording_shorter_than_a_cycle_is_analysed(learned):
    motion, _ = made_gait(1, 5, duration=0.3)
    found = analyze(learned, motion)
    assert np.isfinite(found.phase).all()
    cycles, _ = aligned_cycles(learned, motion)
    assert len(cycles) == 0


def test_model_file_round_trip_and_damage(learned, tmp_path):
    path = tmp_path / 'model.npz'
    model_file.save(learned, path, seed=0)
    back = model_file.load(path)
    np.testing.assert_array_equal(back.mean, learned.mean)
    np.testing.assert_array_equal(back.personal.noise, learned.personal.noise)
    assert back.style_names == learned.style_names
    header, arrays = model_file.load_model(path)
    with pytest.raises(ModelError, match='lacks'):
        model_file.from_arrays(header, {k: v for k, v in arrays.items() if k != 'noise'})
    with pytest.raises(ModelError, match='shape'):
        model_file.from_arrays(header, dict(arrays, noise=arrays['noise'][:, :-1]))
    with pytest.raises(ModelError, match='cannot be right'):
        model_file.from_arrays(header, dict(arrays, noise=-arrays['noise']))


def test_filled_values_come_close_and_others_stay(learned):
    whole, _ = made_gait(1, 200, noise=0.005)
    shown = whole.positions.copy()
    shown[60:, [1, 3]] = np.nan
    filled, std = fill(learned, whole.replace(positions=shown))
    hidden = np.isnan(shown)
    np.testing.assert_array_equal(filled.positions[~hidden], shown[~hidden])
    error = (filled.positions - whole.positions)[hidden]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.mean(np.abs(error) < 3 * std[hidden]) > 0.9
    assert np.abs(np.diff(filled.positions[:, 1])).max() < 1.3 * np.abs(np.diff(whole.positions[:, 1])).max()
    causal, _ = fill_causally(learned, whole.replace(positions=shown))
    assert np.sqrt(np.mean((causal.positions - whole.positions)[hidden]**2)) < 0.06


def test_causal_filling_never_looks_ahead(learned):
    whole, _ = made_gait(0, 201)
    shown = whole.positions.copy()
    shown[30:90, 2] = np.nan
    changed = shown.copy()
    changed[70:] += 0.5
    first, _ = fill_causally(learned, whole.replace(positions=shown))
    second, _ = fill_causally(learned, whole.replace(positions=changed))
    np.testing.assert_array_equal(first.positions[:70], second.positions[:70])


def test_learning_with_missing_values_finds_the_same_styles(gaits, learned):
    rng = np.random.default_rng(3)
    holes = []
    for motion in gaits:
        y = motion.positions.copy()
        y[rng.random(y.shape) < 0.15] = np.nan
        holes.append(motion.replace(positions=y))
    holes[0] = holes[0].replace(positions=np.where(np.arange(6) == 2, np.nan, holes[0].positions))
    found = learn(holes, 2, seed=0, restarts=2)
    groups = found.labels.argmax(axis=1)
    assert (groups[::2] == groups[0]).all() and (groups[1::2] == groups[1]).all() and groups[0] != groups[1]


def test_degenerate_recordings(gaits):
    one = learn([made_gait(0, 1)[0]], 3, seed=0, restarts=1, n_iterations=3)     # one recording, more styles than that
    assert np.isfinite(one.mean).all() and (one.noise > 0).all()
    still = gaits[0].replace(positions=np.where(np.arange(6) == 4, 0.3, gaits[0].positions))
    flat = learn([still, still], 1, seed=0, restarts=1, n_iterations=4)          # a constant channel
    assert np.sqrt(flat.noise[0, 4]) == pytest.approx(np.radians(0.5), rel=0.1)
    assert flat.mean[0, :, 4] == pytest.approx(0.3, abs=1e-3)
    with pytest.raises(MotionError, match='repeats'):
        learn([gaits[0].slice(0, 0.5)], 1)
    with pytest.raises(MotionError, match='no recordings'):
        learn([], 2)
    with pytest.raises(MotionError, match="'blank' holds no value"):
        learn([gaits[0], gaits[1].replace(positions=np.full(gaits[1].positions.shape, np.nan), name='blank')], 1)
    with pytest.raises(MotionError, match='left_knee'):
        learn([gaits[0], gaits[1].select('!left_knee')], 2)
    with pytest.raises(MotionError, match='leave such joints out'):
        learn([gaits[0].replace(positions=np.where(np.arange(6) == 4, np.nan, gaits[0].positions))], 1)
    with pytest.raises(UsageError):
        learn(gaits, 0)


def test_the_number_of_styles_is_found_by_held_out_likelihood(gaits):
    choice = choose_styles(gaits, [1, 2], seed=0, n_iterations=6)
    assert choice.best == 2
    assert choice.rows[1].held_out > choice.rows[0].held_out + 0.5
    with pytest.raises(UsageError, match='too few'):
        choose_styles(gaits[:2], [1, 2])


def test_a_new_recording_is_more_likely_under_its_own_style(learned):
    for style in (0, 1):
        motion, _ = made_gait(style, 300 + style)
        result = smooth(learned, motion.positions, n_rounds=0)
        assert result.styles[learned.labels[style].argmax()] > 0.99
        np.testing.assert_allclose(result.occupancy.sum(axis=2), 1.0)


def test_prototypes_repeat_and_have_the_styles_period(learned):
    shapes = prototypes(learned)
    np.testing.assert_allclose(shapes.pose(np.array([0.3])), shapes.pose(np.array([0.3 + 2 * np.pi])), atol=1e-9)
    for c in range(2):
        motion, phases = synthesize(learned, parse_blend(str(c), learned), 6.0, 100.0)
        assert (phases[-1] - phases[0]) / 6.0 == pytest.approx(2 * np.pi / learned.periods_s[c], rel=0.05)
        assert np.isfinite(motion.positions).all()
    value, slope = shapes.curve(0, np.array([1.0]))
    step = 1e-6
    np.testing.assert_allclose(slope, (shapes.curve(0, np.array([1 + step]))[0] - value) / step, rtol=1e-3, atol=1e-4)


def test_a_blend_lies_between_and_changes_smoothly(learned):
    shapes = prototypes(learned)
    blend = parse_blend('0 @ 0; 0.5*0 + 0.5*1 @ 2; 1 @ 4', learned)
    np.testing.assert_allclose(blend.at(np.array([-1.0, 0.0, 2.0, 4.0, 9.0])),
                               [[1, 0], [1, 0], [0.5, 0.5], [0, 1], [0, 1]])
    motion, phases = synthesize(learned, blend, 4.0, 100.0)
    both = shapes.pose(phases)
    assert (motion.positions <= both.max(axis=0) + 1e-9).all() and (motion.positions >= both.min(axis=0) - 1e-9).all()
    fastest = max(np.abs(shapes.curve(c, np.linspace(0, 7, 200))[1]).max() for c in (0, 1))
    assert np.abs(np.diff(motion.positions, axis=0)).max() < 1.5 * fastest * np.diff(phases).max()
    assert (np.diff(phases) > 0).all()


@pytest.mark.parametrize('text, fault', [
    ('0.3*0 + 0.6*1', 'sum to 0.9'), ('', 'empty'), ('0 @ 0; 1', 'needs its time'), ('0 @ 2; 1 @ 1', 'increase'),
    ('0 @ now', 'not a time'), ('0.5*0 & 0.5*1', 'cannot read'), ('1..2*0', 'not a number')])
def test_blends_that_make_no_sense(learned, text, fault):
    with pytest.raises(UsageError, match=fault):
        parse_blend(text, learned)


def test_an_unknown_style_is_named(learned):
    with pytest.raises(ModelError, match='trot'):
        parse_blend('trot', learned)
    np.testing.assert_allclose(parse_blend('1.5*style1 - 0.5*style0', learned).weights, [[-0.5, 1.5]])
    with pytest.raises(UsageError, match='positive'):
        synthesize(learned, parse_blend('0', learned), -1.0)


def test_predictor_tracks_and_predicts_a_made_gait(learned):
    whole, truth = made_gait(1, 400, duration=5.0)
    predictor = LocomotionPredictor(learned)
    offsets, errors = [], []
    for i in range(whole.n_frames - 10):
        found = predictor.update(whole.times[i], whole.positions[i])
        if i > 60:
            offsets.append(np.angle(np.exp(1j * (found.phase - truth[i]))))
            ahead = predictor.predict(np.array([0.0, 0.1, 0.2]))
            errors.append(ahead.mean[1:] - whole.positions[[i + 4, i + 8]])
            np.testing.assert_allclose(ahead.mean[0], found.mean, atol=1e-3)
            assert (ahead.std > 0).all()
    assert found.status is Status.TRACKING
    assert found.phase_velocity == pytest.approx(2 * np.pi * 1.5, rel=0.15)
    assert found.behaviours[learned.style_names[learned.labels[1].argmax()]] > 0.9
    assert np.std(offsets) < 0.25
    assert np.sqrt(np.mean(np.square(errors))) < 0.06


def test_predictor_keeps_going_without_sensors_and_refuses_nonsense(learned):
    whole, _ = made_gait(0, 401)
    predictor = LocomotionPredictor(learned)
    for i in range(60):
        predictor.update(whole.times[i], whole.positions[i])
    mask = np.zeros(6, bool)
    for i in range(60, 80):
        found = predictor.update(whole.times[i], whole.positions[i], mask)
        assert not found.observed.any() and np.isnan(found.innovation)
    assert np.sqrt(np.mean((found.mean - whole.positions[79])**2)) < 0.1
    assert np.isfinite(found.mean).all() and (np.linalg.eigvalsh(found.phase_covariance) >= -1e-12).all()
    with pytest.raises(ValueError, match='increase'):
        predictor.update(whole.times[79], whole.positions[79])
    with pytest.raises(ValueError, match='shape'):
        predictor.update(whole.times[80], np.zeros(5))
    with pytest.raises(ValueError, match='horizons'):
        predictor.predict(np.array([-1.0]))
    assert predictor.predict(np.zeros(0)).mean.shape == (0, 6)


def test_an_empty_style_takes_over_nothing_on_line(learned):
    """A style without recordings has the widest noise: compared by distance alone it would fit everything best."""
    empty = dataclasses.replace(
        learned, mean=np.concatenate([learned.mean, learned.mean.mean(axis=0)[None]]),
        variance=np.concatenate([learned.variance, learned.variance[:1]]),
        noise=np.concatenate([learned.noise, 200 * learned.noise.max(axis=0)[None]]),
        weights=np.append(0.98 * learned.weights, 0.02), jumps=np.concatenate([learned.jumps, learned.jumps[:1]]),
        dwell=np.concatenate([learned.dwell, learned.dwell[:1]]),
        labels=np.concatenate([learned.labels, np.zeros((len(learned.labels), 1))], axis=1),
        style_names=(*learned.style_names, 'empty'))
    with pytest.warns(UserWarning, match='1 of 3 styles'):
        assert model_file.without_empty_styles(empty).style_names == learned.style_names
    for style in (0, 1):
        whole, _ = made_gait(style, 410 + style)
        errors = []
        for model in (learned, empty):
            predictor, gaps = LocomotionPredictor(model), []
            for t, y in zip(whole.times[:-8], whole.positions):
                found = predictor.update(t, y)
                gaps.append(predictor.predict(np.array([0.2])).mean[0])
            errors.append(np.mean((np.array(gaps)[40:] - whole.positions[48:])**2))
        assert found.behaviours['empty'] < 0.1 and errors[1] < 1.2 * errors[0]


def test_styles_that_find_no_recording_are_dropped_and_it_is_said(gaits):
    """Twice the same recording cannot part into three styles."""
    same = [gaits[0], gaits[0].replace(name='again')]
    with pytest.warns(UserWarning, match='of 3 styles found no recording'):
        model = learn(same, 3, restarts=1, n_iterations=4)
    assert model.n_styles == len(model.style_names) < 3
    assert analyze(model, gaits[0]).style_probabilities.shape == (model.n_styles,)
    np.testing.assert_allclose([model.weights.sum(), *model.labels.sum(axis=1)], 1.0)


def test_a_stranger_is_of_no_certain_style(learned, gaits):
    """Somebody far from both styles is of neither for certain, however many frames say so; a training recording is."""
    for gait in gaits[:2]:
        assert analyze(learned, gait).style_probabilities.max() > 0.99
    slow, _ = made_gait(0, 420, noise=0.0)
    middle = slow.replace(positions=slow.positions + 0.6 * np.array([1, -1, 1, -1, 1, -1]), name='stranger')
    longer = middle.replace(positions=np.tile(middle.positions, (4, 1)), times=np.arange(4 * middle.n_frames) / RATE)
    for motion in (middle, longer):
        assert analyze(learned, motion).style_probabilities.max() < 0.99


def test_an_absent_joint_equals_a_masked_one(learned):
    """Exact marginalisation: what a masked sensor says makes no difference at all."""
    whole, _ = made_gait(1, 402)
    states = []
    for junk in (0.0, 1e3, np.nan):
        predictor = LocomotionPredictor(learned)
        mask = np.arange(6) != 2
        for t, y in zip(whole.times[:40], whole.positions[:40]):
            found = predictor.update(t, np.where(mask, y, junk), mask)
        states.append((found.phase, found.log_likelihood, *found.mean))
    assert states[0] == states[1] == states[2]


def test_departure_and_bridge_are_the_conditional_gaussians():
    rng = np.random.default_rng(0)
    M, count = 6, rng.integers(0, 4, (6, 1)).astype(float)
    total = rng.normal(size=(M, 1)) * count
    personal = Personal(np.array([0.5]), np.array([2.0]), np.array([0.3]), np.array([0.6]))
    found = departure(personal, count, total)
    ring = 2 * np.eye(M) - np.roll(np.eye(M), 1, 0) - np.roll(np.eye(M), -1, 0)
    gain = (1 - 0.6) / (1 + 0.6) / 0.3
    covariance = np.linalg.inv(0.5 * np.eye(M) + 2.0 * ring + gain * np.diag(count[:, 0]))
    np.testing.assert_allclose(found.mean[:, 0], covariance @ (gain * total[:, 0]))
    np.testing.assert_allclose(found.variance[:, 0], np.diag(covariance))

    residual = np.array([np.nan, 0.4, np.nan, np.nan, -0.7, np.nan])
    mean, share = bridge(residual[:, None], np.array([0.8]))
    lag = np.abs(np.arange(6)[:, None] - np.arange(6))
    prior = 0.8**lag
    seen = np.isfinite(residual)
    weights = prior[:, seen] @ np.linalg.inv(prior[np.ix_(seen, seen)])
    np.testing.assert_allclose(mean[:, 0], weights @ residual[seen], atol=1e-12)
    np.testing.assert_allclose(share[:, 0], np.diag(prior - weights @ prior[seen]), atol=1e-12)


def test_root_travel_goes_there_and_back():
    rng = np.random.default_rng(1)
    times = np.arange(120) / 60
    heading = 0.8 * times + 3.0
    place = np.cumsum(np.stack([np.sin(heading), np.cos(heading)], axis=1) / 60, axis=0)
    tilt = 0.1 * np.sin(times[:, None] * [3.0, 4.0])
    angles = (Rotation.from_euler('y', heading[:, None]) * Rotation.from_euler('xz', tilt)).as_euler('xyz')
    names = tuple('root.' + axis for axis in ('tx', 'ty', 'tz', 'rx', 'ry', 'rz'))
    height = 0.9 + 0.02 * rng.normal(size=120)
    positions = np.column_stack([place[:, 0], height, place[:, 1], np.unwrap(angles, axis=0)])
    motion = Motion(names, positions, times, ('m',) * 3 + ('rad',) * 3)
    channels = feature_map(motion)
    features = channels.encode(motion)
    # steady in the walker's own frame: forward 1 m/s, turning 0.8 rad/s
    np.testing.assert_allclose(features[2:-2, 2], 1.0, atol=0.02)
    np.testing.assert_allclose(features[2:-2, 4], 0.8, atol=0.1)
    turned = Rotation.from_euler('xyz', positions[0, 3:]).apply([0, 0, 1])
    back = channels.decode(features, times, positions[0, [0, 2]], np.arctan2(turned[0], turned[2]))
    np.testing.assert_allclose(back.positions[:, [0, 2]], positions[:, [0, 2]], atol=0.02)
    gap = Rotation.from_euler('xyz', back.positions[:, 3:]) * Rotation.from_euler('xyz', positions[:, 3:]).inv()
    assert gap.magnitude().max() < 0.03
    with pytest.raises(MotionError, match='all six'):
        feature_map(motion.select('!root.ty'))
    with pytest.raises(MotionError, match='unit'):
        FeatureMap(('a',), ('m',)).encode(Motion(('a',), np.zeros((2, 1)), [0, 1]))


def test_its_phases_train_a_phase_style_model(gaits, learned):
    from style_core.phase_style.training import train

    def phase_of(motion):
        found = analyze(learned, motion)
        return found.times, found.phase

    behaviour = train(gaits, joints=NAMES, rate_hz=RATE, residual=False, phase_of=phase_of)
    assert behaviour.sequences == tuple(motion.name for motion in gaits)
    # the common phases are the locomotion model's own: a pose of each style at phase 0 is that of the style's cycle
    shapes = prototypes(learned).pose(np.array([0.0]))[:, 0]
    poses = np.tensordot(behaviour.styles, behaviour.bases[:, 0], axes=1)
    for k in range(2):
        np.testing.assert_allclose(poses[k], shapes[learned.labels[k].argmax()], atol=0.1)


def test_commands(gaits, tmp_path, capsys):
    files = []
    for motion in gaits[:4]:
        files.append(str(tmp_path / f'{motion.name}.csv'))
        write_motion(motion, files[-1])
    labels = tmp_path / 'labels.csv'
    rows = [f'{motion.name},{("stroll", "trot")[k % 2]}' for k, motion in enumerate(gaits)]
    labels.write_text('\n'.join(['trial,action', *rows]))
    model = str(tmp_path / 'gaits.npz')
    assert main(['train', 'locomotion', *files, '--styles', '2', '--restarts', '1', '--iterations', '6',
                 '--labels', str(labels), '-o', model]) == 0
    assert set(model_file.load(model).style_names) == {'stroll', 'trot'}
    capsys.readouterr()
    assert main(['info', model, '--json']) == 0
    assert {row['style'] for row in json.loads(capsys.readouterr().out)['styles']} == {'stroll', 'trot'}
    assert main(['analyze', model, *files, '--json', '-o', str(tmp_path / 'phases.csv'),
                 '--picture', str(tmp_path / 'aligned.png')]) == 0
    found = json.loads(capsys.readouterr().out)['recordings']
    assert [row['style'] for row in found] == ['stroll', 'trot', 'stroll', 'trot']
    assert len((tmp_path / 'phases.csv').read_text().splitlines()) > 400 and (tmp_path / 'aligned.png').stat().st_size
    assert main(['synthesize', model, '--blend', '0.3*trot + 0.7*stroll', '-o', str(tmp_path / 'blend.csv')]) == 0
    assert main(['synthesize', model, '--blend', '0.3*trot', '-o', str(tmp_path / 'blend.csv')]) == 2
    assert main(['fill', model, files[0], '--hide', 'left_*', '--from', '1', '--score']) == 0
    assert 'mean squared error' in capsys.readouterr().out
    assert main(['fill', model, files[0], '--hide', 'left_*', '--score', '--causal', '--from', '1']) == 0
    assert main(['analyze', model, '--rename', 'trot=run']) == 0
    assert 'run' in model_file.load(model).style_names
    assert main(['train', 'locomotion', *files, '--styles', 'many', '-o', model]) == 2


def test_real_walks_and_runs_come_apart(trial):
    names = ['07_01', '07_02', '07_03', '09_01', '09_02', '09_03']
    motions = [trial(name, 30.0).select('!*fingers*', '!*thumb*') for name in names]
    model = learn(motions, 2, seed=0, restarts=2)
    groups = model.labels.argmax(axis=1)
    assert len(set(groups[:3])) == 1 and len(set(groups[3:])) == 1 and groups[0] != groups[3]
    assert model.periods_s[groups[3]] == pytest.approx(0.75, abs=0.05)
    test = trial('07_07', 30.0).select('!*fingers*', '!*thumb*')
    shown = test.positions.copy()
    upper = [k for k, name in enumerate(test.joint_names) if 'humerus' in name or 'radius' in name]
    shown[len(shown) // 2:, upper] = np.nan
    filled, _ = fill(model, test.replace(positions=shown))
    hidden = np.isnan(shown)
    assert np.degrees(np.sqrt(np.mean((filled.positions - test.positions)[hidden]**2))) < 5.0
