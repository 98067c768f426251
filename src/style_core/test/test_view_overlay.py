"""Predictions laid over a recording, without any viewer: stamps, switched-off sensors, the band in space."""
from pathlib import Path

import numpy as np
import pytest

from style_core.motion import Motion
from style_core.predictor import Estimate, Prediction, Status
from style_core.skeleton import read_skeleton
from style_core.view.clock_face import clock_face
from style_core.view.overlay import beforehand, ghost_motion, sensors_of, spread

PERSON = Path(__file__).parents[3] / 'config' / 'skeletons' / 'person.asf'
TIMES = np.arange(60) / 50.0


class Straight:
    """A predictor that goes on with the last value seen of each joint at a velocity that it is told."""

    joint_names = ('lfemur.rx', 'rfemur.rx')

    def __init__(self, velocity):
        self._velocity = np.asarray(velocity)

    def reset(self):
        self._time, self._last = None, np.zeros(2)

    def update(self, time, y, mask=None):
        observed = np.isfinite(y) & (True if mask is None else mask)
        self._time, self._last = time, np.where(observed, y, self._last)
        return Estimate(time, 1.0, 2.0, np.eye(2), np.zeros(1), np.eye(1), self._last, np.full(2, 0.1), observed, 1.0,
                        0.0, Status.TRACKING, {'walk': 0.75, '<b>': 0.25})

    def predict(self, horizons):
        steps = np.asarray(horizons)[:, None]
        return Prediction(self._time + horizons, self._last + steps * self._velocity, 0.1 + 0 * steps * self._velocity,
                          np.repeat(self._velocity[None], len(horizons), 0))


def line(velocity=(0.3, -0.2)):
    return Motion(Straight.joint_names, TIMES[:, None] * velocity, TIMES)


def test_a_perfect_predictor_has_no_error_at_any_horizon():
    for ahead in (0.0, 0.1, 0.155):
        overlay = beforehand(Straight((0.3, -0.2)), line(), ahead)
        errors = overlay.errors()
        assert np.nanmax(errors) < 1e-9
        assert np.isnan(errors).sum() == np.sum(TIMES + ahead > TIMES[-1] + 1e-9)


def test_an_error_is_that_of_the_moment_predicted():
    overlay = beforehand(Straight((0.0, 0.0)), line((0.3, 0.4)), 0.2)
    np.testing.assert_allclose(overlay.errors()[:-10], 0.2 * np.sqrt((0.3**2 + 0.4**2) / 2))


def test_a_sensor_is_off_from_its_frame_on():
    use = np.ones((60, 2), dtype=bool)
    use[30:, 0] = False
    overlay = beforehand(Straight((0.0, 0.0)), line(), 0.1, use)
    assert overlay.observed[:30].all() and not overlay.observed[30:, 0].any() and overlay.observed[30:, 1].all()
    np.testing.assert_allclose(overlay.mean[30:, 0], line().positions[29, 0])


def test_following_can_be_cancelled():
    asked = iter([False] * 5 + [True])
    assert beforehand(Straight((0.0, 0.0)), line(), 0.1, cancelled=lambda: next(asked)) is None


def test_a_ghost_stands_where_the_recording_has_its_root():
    root = Motion(('root.tx', *Straight.joint_names), np.concatenate([TIMES[:, None], line().positions], 1), TIMES,
                  ('m', 'rad', 'rad'))
    ghost, std = ghost_motion(beforehand(Straight((0.3, -0.2)), line(), 0.2), root)
    np.testing.assert_allclose(ghost.times, TIMES[:-10] + 0.2)
    np.testing.assert_allclose(ghost.positions, root.positions[10:], atol=1e-12)
    assert (std[:, 0] == 0).all() and (std[:, 1:] == 0.1).all()


@pytest.mark.skipif(not PERSON.is_file(), reason='needs the config folder of the repository')
def test_the_band_is_as_wide_as_samples_of_it():
    skeleton = read_skeleton(PERSON)
    names = ('lfemur.rx', 'lfemur.rz', 'ltibia.rx')
    pose, std = np.array([0.3, -0.1, 0.6]), np.array([0.02, 0.01, 0.03])
    found = spread(skeleton, Motion(names, pose[None], [0.0]), std[None])[0]
    rng = np.random.default_rng(1)
    samples = pose + std * rng.standard_normal((20000, 3))
    places = skeleton.forward(Motion(names, samples, np.arange(20000.0)))
    expected = np.sqrt(places.var(axis=0).sum(axis=1))
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=1e-9)
    assert found[skeleton.body_names.index('lfoot')] > 0.005 and found[skeleton.body_names.index('head')] == 0


def test_channels_of_a_joint_are_one_sensor():
    assert sensors_of(('lfemur.rx', 'lfemur.ry', 'hip')) == {'lfemur': [0, 1], 'hip': [2]}


def test_the_panel_escapes_names_and_says_the_status():
    html = clock_face(beforehand(Straight((0.0, 0.0)), line(), 0.1), 3)
    assert 'tracking' in html and 'width:75%' in html and '&lt;b&gt;' in html and '<b>' not in html
    assert 'phase 0.16' in html
