"""Fixtures that all tests share: real recordings where they are present, and a made gait where they are not needed."""
import matplotlib
import numpy as np
import pytest
from hypothesis import settings

from style_core import datasets
from style_core.errors import MotionError
from style_core.motion import Motion

matplotlib.use('Agg')
settings.register_profile('bounded', max_examples=50, deadline=None, derandomize=True)
settings.load_profile('bounded')


@pytest.fixture(scope='session')
def mocap():
    """Folder of the real recordings; the test is skipped where they are absent."""
    try:
        return datasets.mocap_folder()
    except MotionError as error:
        pytest.skip(str(error))


@pytest.fixture(scope='session')
def trial(mocap):
    """Function ``trial(name, rate_hz=60.0)``: a real recording, each read once a session."""
    from functools import lru_cache
    return lru_cache(maxsize=None)(datasets.trial)


@pytest.fixture
def gait():
    """Eight channels of a made gait, 4 s at 100 Hz."""
    times = np.arange(401) / 100
    names = [f'{side}_{joint}' for side in ('left', 'right') for joint in ('hip', 'knee', 'ankle', 'toe')]
    phase = 2 * np.pi * 1.1 * times[:, None] + np.repeat([0, np.pi], 4) + np.tile([0, 0.6, 1.3, 2.0], 2)
    return Motion(names, 0.2 + 0.5 * np.sin(phase) + 0.1 * np.cos(2 * phase), times, name='made gait')


@pytest.fixture(scope='session')
def models(tmp_path_factory):
    """kind -> file of a small model of it; beside them ``KIND.csv``, a recording that each has not seen."""
    from made_models import make_models
    return make_models(tmp_path_factory.mktemp('made_models'))
