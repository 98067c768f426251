"""Motion that no model knows, on real people whom the shipped model has not seen."""
import numpy as np
import pytest

from style_core import datasets
from style_core.errors import MotionError
from style_core.evaluation import coverage, error_deg2, paper_horizons, roll_out
from style_core.predictor import Status
from style_core.predictor_file import read_predictor

try:
    PRESENT = {row.name for row in datasets.labels()}
except MotionError:
    PRESENT = set()


def rollouts(shipped, name, seconds=20.0):
    """A recording, and what the shipped model says of it without and with what no model knows."""
    if name not in PRESENT:
        pytest.skip(f'needs recording {name} (STYLE_MOCAP)')
    motion = datasets.trial(name).select(*datasets.BODY)
    motion = motion.replace(positions=motion.positions[:round(60 * seconds)], times=motion.times[:round(60 * seconds)])
    return motion, *(roll_out(read_predictor(shipped, without=without).predictor, motion, paper_horizons())
                     for without in (('unknown',), ()))


@pytest.fixture(scope='module')
def shipped(pytestconfig):
    return pytestconfig.rootpath / 'config' / 'models' / 'locomotion.npz'


@pytest.mark.parametrize('action', ['household', 'story', 'climbing', 'styled', 'start_stop'])
def test_other_motion_is_predicted_no_worse_than_holding_still_or_the_model(shipped, action):
    name = datasets.trials(action)[0] if PRESENT else action
    motion, alone, together = rollouts(shipped, name)
    still = np.broadcast_to(motion.positions[:, None], together.mean.shape)
    errors = [error_deg2(said, together.actual) for said in (still, alone.mean, together.mean)]
    assert errors[2] < 1.05 * min(errors[:2])
    assert np.mean(coverage(together.mean, together.std, together.actual, 0.9)) > 0.82


@pytest.mark.parametrize('name', ['07_01', '16_15', '09_05'])
def test_walks_and_runs_stay_known(shipped, name):
    assert not np.any(rollouts(shipped, name)[2].status == Status.UNKNOWN)


@pytest.mark.parametrize('name', ['07_01', '16_15', '02_01'])
def test_walks_are_as_well_predicted_as_by_the_model_alone(shipped, name):
    _, alone, together = rollouts(shipped, name)
    assert error_deg2(together.mean, together.actual) < 1.03 * error_deg2(alone.mean, alone.actual)


@pytest.mark.parametrize('name', ['07_01', '08_01', '16_15', '02_01'])
def test_a_walker_who_freezes_is_said_to_stand(shipped, name):
    """The last pose held for a second, from several instants of the step."""
    if name not in PRESENT:
        pytest.skip(f'needs recording {name} (STYLE_MOCAP)')
    y = datasets.trial(name).select(*datasets.BODY).positions
    predictor = read_predictor(shipped).predictor
    for instant in range(60, 120, 15):
        predictor.reset()
        for frame in range(instant + 60):
            estimate = predictor.update(frame / 60, y[min(frame, instant)])
        assert estimate.behaviours['still'] == 1.0 and estimate.status == Status.TRACKING
        held = predictor.predict(paper_horizons())
        np.testing.assert_allclose(held.mean, np.broadcast_to(y[instant], held.mean.shape), atol=1e-9)
