import pytest

from style_core.errors import UsageError
from style_node.parameter_table import Parameter, ParameterTable


def horizon_covers_a_step(values):
    if values['step'] > values['horizon']:
        raise UsageError('step must not exceed horizon')


TABLE = ParameterTable((
    Parameter('horizon', 0.5, 'How far', unit='s', lower=0.0, upper=5.0),
    Parameter('step', 0.1, 'How fine', unit='s', lower=0.001, upper=1.0),
    Parameter('points', 3, 'How many', lower=1, upper=9),
    Parameter('method', 'full', 'How', choices=('full', 'paper'), live=False),
    Parameter('masked', (), 'Which not'),
    Parameter('loop', True, 'Again'),
), together=horizon_covers_a_step)
DEFAULTS = {one.name: one.default for one in TABLE}


def test_defaults_pass():
    TABLE.check(DEFAULTS)


@pytest.mark.parametrize('changes, message', [
    ({'horizon': -1.0}, 'horizon must lie in 0 to 5 s, not -1'),
    ({'horizon': float('nan')}, 'horizon must lie'),
    ({'horizon': 'far'}, 'horizon must be number'),
    ({'points': 2.5}, 'points must be integer'),
    ({'loop': 1}, 'loop must be true or false'),
    ({'method': 'magic'}, 'one of full, paper'),
    ({'masked': ['a', 1]}, 'masked must be list of text'),
    ({'step': 0.7}, 'step must not exceed horizon'),
    ({'horizon': -1.0, 'points': 99}, 'horizon.*points'),
])
def test_bad_values_are_named(changes, message):
    with pytest.raises(UsageError, match=message):
        TABLE.check({**DEFAULTS, **changes})


def test_changes_are_taken_together_or_not_at_all():
    assert TABLE.check_change(DEFAULTS, {'step': 0.7, 'horizon': 0.9, 'other': 1}, True)['step'] == 0.7
    with pytest.raises(UsageError):
        TABLE.check_change(DEFAULTS, {'step': 0.7, 'loop': False}, True)


def test_fixed_parameters_change_only_before_the_node_is_configured():
    assert TABLE.check_change(DEFAULTS, {'method': 'paper'}, False)['method'] == 'paper'
    with pytest.raises(UsageError, match='clean it up first'):
        TABLE.check_change(DEFAULTS, {'method': 'paper'}, True)
    TABLE.check_change(DEFAULTS, {'method': 'full'}, True)  # no change


def test_parameters_that_are_fixed_at_the_start_never_change():
    table = ParameterTable((Parameter('folder', 'here', 'Where', fixed=True), Parameter('name', 'a', 'What')))
    values = {'folder': 'here', 'name': 'a'}
    for configured in (False, True):
        with pytest.raises(UsageError, match='folder cannot change while the node runs'):
            table.check_change(values, {'folder': '/', 'name': 'b'}, configured)
        assert table.check_change(values, {'folder': 'here', 'name': 'b'}, configured)['name'] == 'b'
    assert 'fixed when the node is started' in table.markdown()


def test_the_documentation_table_has_a_row_a_parameter():
    text = TABLE.markdown()
    assert text.count('\n') == 1 + len(DEFAULTS)
    assert '| `method` | `full` | How (one of full, paper; takes effect when the node is configured) |' in text
