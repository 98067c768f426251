"""Path maps and the style machine as an on-line predictor, on made motion."""
import numpy as np
import pytest
from test_style_machine import FAST, cycle

from style_core.errors import ModelError
from style_core.hmm import log_density, occupancy
from style_core.predictor import Status
from style_core.style_machine import StreamingSynthesizer, learn
from style_core.style_machine.analysis import joint_gaussians
from style_core.style_machine.online import StyleMachinePredictor
from style_core.style_machine.path_map import FollowingFilter, cue_features, fit_path_map, follow


@pytest.fixture(scope='module')
def motions():
    return [cycle('walk', 0.9, 0.4, 0.0), cycle('run', 1.5, 0.7, 0.2, seed=1)]


@pytest.fixture(scope='module')
def machine(motions):
    return learn(motions, FAST, leading=3, dof=2)


@pytest.fixture(scope='module')
def path_map(machine, motions):
    return fit_path_map(machine, [cue_features(motion.positions[:, :2]) for motion in motions], ['walk', 'run'])


def test_whole_body_from_two_joints(machine, path_map):
    for name, new in (('walk', cycle('w', 0.92, 0.41, 0.0, seed=7)), ('run', cycle('r', 1.47, 0.69, 0.2, seed=8))):
        motion, style, gamma = follow(path_map, cue_features(new.positions[:, :2]))
        assert style == name
        np.testing.assert_allclose(gamma.sum(axis=1), 1.0)
        hidden = motion.positions[:, 2:] - new.positions[:, 2:]
        assert np.sqrt((hidden ** 2).mean()) < 0.3 * new.positions[:, 2:].std()


def test_following_on_line(machine, path_map):
    new = cycle('r', 1.47, 0.69, 0.2, seed=8)
    following = FollowingFilter(path_map)
    stream = StreamingSynthesizer(machine, 'run', lag=6)
    frames = []
    for x in cue_features(new.positions[:, :2]):
        gamma, styles = following.update(x)
        assert gamma.sum() == pytest.approx(1.0) and sum(styles.values()) == pytest.approx(1.0)
        frame = stream.push(gamma)
        frames += [] if frame is None else [frame.positions]
    assert max(styles, key=styles.get) == 'run'
    hidden = np.array(frames)[20:, 2:] - new.positions[20:len(frames), 2:]
    assert np.sqrt((hidden ** 2).mean()) < 0.5 * new.positions[:, 2:].std()


def test_filter_density_is_the_marginal_density(path_map, motions):
    following = FollowingFilter(path_map)
    x = cue_features(motions[0].positions[:, :2])[20]
    for seen in (np.ones(4, dtype=bool), np.array([True, False, True, True]), np.zeros(4, dtype=bool)):
        masked = np.where(seen, x, np.nan)
        expected = [log_density(masked[None], means, path_map.covs)[0] for means in path_map.means]
        np.testing.assert_allclose(following._density(masked), expected, rtol=1e-9, atol=1e-9)


def test_cues_may_be_missing_or_wrong(machine, path_map, motions):
    cues = cue_features(motions[1].positions[:, :2])
    cues[30:60, 0] = np.nan
    cues[100:110] = np.nan
    motion, style, _ = follow(path_map, cues)
    assert style == 'run' and np.isfinite(motion.positions).all()
    with pytest.raises(ModelError, match='no training recording'):
        fit_path_map(machine, [cues[:-1]], ['run'])
    with pytest.raises(ModelError, match='same width'):
        fit_path_map(machine, [cues, cues[:, :1]], ['run', 'walk'])
    with pytest.raises(ModelError, match='shape'):
        cue_features(np.zeros(4))


def test_density_of_a_pattern_is_the_marginal_density(machine, motions):
    """Exact masking: the whitening tables against the HMM core's marginalised density."""
    predictor = StyleMachinePredictor(machine)
    y = motions[0].positions[10].copy()
    seen = np.array([True, False, True, True, False])
    white, offset, constant = predictor._pattern(seen)
    z = (white @ y[seen]).reshape(len(offset), -1) - offset
    masked = np.where(seen, y, np.nan)
    np.testing.assert_allclose(constant - 0.5 * (z ** 2).sum(axis=1),
                               log_density(masked[None], predictor._means, predictor._covs)[0], rtol=1e-9)


def test_joint_gaussians_agree_with_the_training_coordinates(machine, motions):
    """All joints seen, tails included: the same states as in the leading coordinates."""
    c, emission = machine.coordinates, machine.at('walk')
    means, covs = joint_gaussians(machine, emission)
    whole = occupancy(log_density(motions[0].positions, means, covs), machine.start, machine.trans)
    assert (whole.gamma.argmax(axis=1) == machine.recordings['walk']).mean() > 0.7
    x = c.encode(motions[0].positions) - emission.pose
    full = emission.position_covariances()
    ratio = log_density(motions[0].positions, means, covs) - log_density(x, emission.positions, full)
    np.testing.assert_allclose(ratio, ratio[0, 0], atol=1e-6)  # the Jacobian only


def test_predictions_beat_standing_still(machine):
    new = cycle('r', 1.48, 0.7, 0.22, seed=11)
    predictor = StyleMachinePredictor(machine)
    ours, still = [], []
    for t in range(new.n_frames - 15):
        estimate = predictor.update(t / 60, new.positions[t])
        if t >= 60:
            prediction = predictor.predict(np.array([0.0, 5 / 60, 15 / 60]))
            np.testing.assert_allclose(prediction.times - t / 60, [0, 5 / 60, 15 / 60], atol=1e-12)
            ours.append(prediction.mean[1:] - new.positions[[t + 5, t + 15]])
            still.append(new.positions[t] - new.positions[[t + 5, t + 15]])
            np.testing.assert_allclose(prediction.mean[0], new.positions[t], atol=1e-9)
    assert estimate.status == Status.TRACKING
    assert max(estimate.behaviours, key=estimate.behaviours.get) == 'run'
    ratio = np.sqrt((np.array(ours) ** 2).mean(axis=(0, 2)) / (np.array(still) ** 2).mean(axis=(0, 2)))
    assert (ratio < 0.8).all()


def test_masked_joints_are_filled_in_and_rates_may_differ(machine):
    new = cycle('r', 1.48, 0.7, 0.22, seed=11, rate=120.0)
    predictor = StyleMachinePredictor(machine)
    errors = []
    for t in range(new.n_frames):
        mask = np.array([True, True, True, t < 100, True])
        y = np.where(mask, new.positions[t], 99.0)  # a masked value is not looked at
        estimate = predictor.update(new.times[t], y, mask)
        if t >= 150:
            errors.append(estimate.mean[3] - new.positions[t, 3])
            assert estimate.std[3] > 0 and not estimate.observed[3]
    assert np.sqrt(np.mean(np.square(errors))) < 0.5 * new.positions[:, 3].std()
    nothing = predictor.update(new.times[-1] + 0.5, np.full(5, np.nan))
    assert np.isnan(nothing.innovation) and np.isfinite(nothing.mean).all()


def test_wrong_observations_are_refused(machine):
    predictor = StyleMachinePredictor(machine)
    predictor.update(0.0, np.zeros(5))
    for time, y, mask in ((0.0, np.zeros(5), None), (-1.0, np.zeros(5), None), (1.0, np.zeros(4), None),
                          (1.0, np.zeros(5), np.ones(4, dtype=bool)), (1.0, np.full(5, np.inf), None),
                          (np.nan, np.zeros(5), None)):
        with pytest.raises(ValueError):
            predictor.update(time, y, mask)
    with pytest.raises(ValueError):
        predictor.predict(np.array([-0.1]))
