"""Parameters: the defaults are sound, the shipped file and the documentation agree with them."""
from pathlib import Path

import numpy as np
import pytest
import yaml

from style_core.errors import UsageError
from style_core.phase_style import FORGETTING
from style_core.stream.joint_map import read_joint_map
from style_core.stream.stream import StreamSettings
from style_core.synthesis.player import Faults
from style_core.synthetic import synthetic_gait
from style_predictor.parameters import PLAYER, PREDICTOR, faults_of, horizons_of, settings_of

ROOT = Path(__file__).resolve().parents[3]


def defaults(table):
    return {one.name: one.default for one in table}


def test_defaults_are_those_of_the_mathematics():
    PREDICTOR.check(defaults(PREDICTOR))
    PLAYER.check(defaults(PLAYER))
    assert settings_of(defaults(PREDICTOR)) == StreamSettings()
    assert faults_of(defaults(PLAYER)) == Faults()


def test_forgetting_is_that_of_the_paper_and_live():
    now = defaults(PREDICTOR)
    assert now['forgetting'] == FORGETTING == 0.8
    assert PREDICTOR.check_change(now, {'forgetting': 0.95}, True)['forgetting'] == 0.95
    with pytest.raises(UsageError, match='behaviour'):
        PREDICTOR.check_change(now, {'behaviour': 'jump'}, True)


def test_horizons():
    np.testing.assert_allclose(horizons_of({'horizon': 0.4, 'step': 1 / 60}), np.arange(25) / 60)
    np.testing.assert_allclose(horizons_of({'horizon': 0.1, 'step': 0.1}), [0.0, 0.1])


@pytest.mark.parametrize('changes, message', [
    ({'step': 0.5}, 'must not exceed horizon'), ({'horizon': 10.0, 'step': 0.001}, '1000 points'),
    ({'max_gap': 0.05}, 'max_gap'), ({'method': 'magic'}, 'method'), ({'forgetting': 0.0}, 'forgetting'),
    ({'forgetting': 1.01}, 'forgetting')])
def test_values_that_do_not_go_together(changes, message):
    with pytest.raises(UsageError, match=message):
        PREDICTOR.check({**defaults(PREDICTOR), **changes})


def test_the_shipped_file_holds_defaults():
    values = yaml.safe_load((ROOT / 'config' / 'predictor.yaml').read_text())['/**']['ros__parameters']
    assert {name: pytest.approx(value) for name, value in defaults(PREDICTOR).items() if name in values} == values


def test_the_example_joint_map_fits_a_model_of_the_body():
    for path in (ROOT / 'config' / 'joint_maps').glob('*.yaml'):
        assert len(read_joint_map(path).bind(synthetic_gait(1.0)[0].joint_names).robot_joints) > 0


@pytest.mark.parametrize('table', [PREDICTOR, PLAYER])
def test_the_documentation_holds_the_table(table):
    assert table.markdown() in (ROOT / 'docs' / 'predictor_node.md').read_text()
