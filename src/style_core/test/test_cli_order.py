"""Options and files of a command in any order, negative numbers, and what is said of words that are none."""
import itertools

import numpy as np
import pytest

from style_core.cli import main, registry
from style_core.cli.parser import Parser, Several, divide
from style_core.formats import read_motion, write_motion


@pytest.fixture
def parser():
    parser = Parser(prog='test')
    parser.add_argument('model')
    parser.add_argument('files', nargs='*')
    parser.add_argument('-o', '--output')
    parser.add_argument('--at', type=float)
    parser.add_argument('--style')
    parser.add_argument('--json', action='store_true')
    parser.add_argument('--mask', action=Several, default=[])
    return parser


def test_every_order_of_groups_means_the_same(parser):
    groups = [['m.npz'], ['a.csv'], ['-o', 'out.npz'], ['--at', '-1.5'], ['--mask', 'left_*', 'right_?'], ['--json']]
    for order in itertools.permutations(groups):
        if order.index(['m.npz']) > order.index(['a.csv']):
            continue
        assert vars(parser.parse_args([word for group in order for word in group])) == {
            'model': 'm.npz', 'files': ['a.csv'], 'output': 'out.npz', 'at': -1.5, 'style': None, 'json': True,
            'mask': ['left_*', 'right_?']}


def test_a_list_of_patterns_ends_at_a_recording_a_bag_or_a_model(parser, tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').write_text('')
    for file in ('a.csv', 'b.AMC', str(tmp_path / 'bag')):
        args = parser.parse_args(['--mask', 'left_*', 'l.rx', 'm.npz', file, '--mask=toe', '--json'])
        assert (args.mask, args.model, args.files) == (['left_*', 'l.rx', 'toe'], 'm.npz', [file])
    assert parser.parse_args(['m.npz']).mask == []


@pytest.mark.parametrize('value', ['-1', '-1.5', '-.5', '-1e-3', '-2E+1'])
def test_a_negative_number_is_a_value(parser, value):
    assert parser.parse_args(['m.npz', '--at', value]).at == float(value)
    assert parser.parse_args([f'--at={value}', 'm.npz']).at == float(value)


def test_a_style_may_begin_with_a_negative_weight(parser):
    assert parser.parse_args(['--style', '-0.5*walk', 'm.npz']).style == '-0.5*walk'


def test_what_follows_two_dashes_is_a_file(parser):
    args = parser.parse_args(['-o', 'x', 'm.npz', '--json', '--', '-a.csv', '--at'])
    assert (args.model, args.files, args.json) == ('m.npz', ['-a.csv', '--at'], True)


def test_abbreviations_and_attached_values_stay(parser):
    args = parser.parse_args(['--js', '-oout.csv', '--sty=x', 'm.npz', '--outp', 'y', 'a.csv'])
    assert (args.json, args.output, args.style, args.files) == (True, 'y', 'x', ['a.csv'])
    parser.add_argument('--jump')
    with pytest.raises(SystemExit):
        parser.parse_args(['--j', 'm.npz'])


def test_an_option_without_its_value_is_refused(parser, capsys):
    for words in (['m.npz', '--at'], ['--at', '--json', 'm.npz'], ['m.npz', '--mask', '--json']):
        with pytest.raises(SystemExit):
            parser.parse_args(words)
        assert 'expected' in capsys.readouterr().err


@pytest.mark.parametrize('words, said', [
    (['prdict', 'm.npz'], 'there is no prdict; did you mean predict?'),
    (['train', 'phase_style', 'a.amc'], 'did you mean phase-style?'),
    (['convert', 'a.amc', 'b.csv', '--strat', '1'], 'no option --strat; did you mean --start'),
    (['convert', 'a.amc', 'b.csv', '--zz', '1'], 'no option --zz\n'),
    (['convert', 'a.amc', 'b.csv', '--rat=1'], ''),
    (['convert', 'a.amc', 'b.csv', '--unit', 'degg'], 'there is no degg; did you mean deg?'),
    (['convert', 'a.amc', 'b.csv', '--unit', 'furlong'], 'there is no furlong; there are rad, deg')])
def test_what_may_have_been_meant_is_said(words, said, capsys):
    try:
        status = main(words)
    except SystemExit as end:
        status = end.code
    assert status == (2 if said else 1) and said in capsys.readouterr().err


def test_the_kinds_of_a_command_agree_which_options_have_values():
    """So that MODEL is found before its kind is known."""
    import importlib
    for kinds in registry.KIND_COMMANDS.values():
        numbers = {}
        for path in set(kinds.values()):
            one = Parser()
            module = importlib.import_module(path)
            if not hasattr(module, 'add_arguments'):
                continue
            module.add_arguments(one, [])
            for option, action in one._option_string_actions.items():
                assert numbers.setdefault(option, (action.nargs, type(action) is Several)) == (
                    action.nargs, type(action) is Several), option


def test_divide_keeps_every_word(parser):
    words = ['x', '-o', 'a', '--mask', 'p', 'q', 'f.csv', '--nothing', 'y']
    found = divide(parser._option_string_actions, words)
    assert sorted(itertools.chain(*found)) == sorted(words) and found[2] == ['--nothing']


def test_predict_takes_the_output_for_the_output_in_every_order(models, tmp_path):
    model, file = str(models['phase-style']), str(models['phase-style'].parent / 'phase-style.csv')
    joint = read_motion(file).joint_names[0]
    groups = [[model, file], ['-o', str(tmp_path / 'out.npz')], ['--mask', joint], ['--seconds', '0.2']]
    results = []
    for order in ([0, 1, 2, 3], [1, 0, 2, 3], [2, 0, 1, 3], [1, 2, 3, 0], [3, 2, 0, 1]):
        assert main(['predict', *(word for index in order for word in groups[index])]) == 0
        results.append(read_motion(tmp_path / 'out.npz').positions)
    assert all(np.array_equal(results[0], one) for one in results[1:])
    assert main(['predict', '-o', str(tmp_path / 'out.npz'), model, '--mask', joint, file, '--seconds', '0.2']) == 0
    assert np.array_equal(results[0], read_motion(tmp_path / 'out.npz').positions)


def test_predict_from_a_negative_time(models, tmp_path):
    """A recording that begins before 0 is predicted as the same recording is from 0 on."""
    model, file = str(models['phase-style']), models['phase-style'].parent / 'phase-style.csv'
    motion = read_motion(file)
    shift = motion.times[0] + motion.duration_s
    write_motion(motion.replace(times=motion.times - shift), tmp_path / 'early.csv')
    at = 0.5 * motion.duration_s
    for name, words in (('a', [str(file), '--at', str(motion.times[0] + at)]),
                        ('b', [str(tmp_path / 'early.csv'), '--at', str(at - motion.duration_s)])):
        assert main(['predict', '-o', str(tmp_path / f'{name}.csv'), model, *words]) == 0
    first, second = read_motion(tmp_path / 'a.csv'), read_motion(tmp_path / 'b.csv')
    assert second.times[0] < 0 and np.allclose(first.times - shift, second.times)
    assert np.allclose(first.positions, second.positions, atol=1e-6)


def test_a_shipped_model_is_found_by_its_name(models, tmp_path, monkeypatch, capsys):
    folder = tmp_path / 'prefix' / 'share' / 'style_bringup' / 'config' / 'models'
    folder.mkdir(parents=True)
    (folder / 'gaits.npz').write_bytes(models['locomotion'].read_bytes())
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    monkeypatch.chdir(tmp_path)
    file = str(models['locomotion'].parent / 'locomotion.csv')
    assert main(['analyze', 'gaits.npz', file]) == 0
    assert main(['info', 'gaits.npz']) == 0
    assert main(['predict', 'gait.npz', file, '-o', 'x.csv']) == 1
    said = capsys.readouterr().err
    assert str(tmp_path) in said and str(folder) in said and 'did you mean gaits.npz?' in said


def test_styles_of_a_shipped_model_are_not_renamed(models, tmp_path, monkeypatch, capsys):
    folder = tmp_path / 'prefix' / 'share' / 'style_bringup' / 'config' / 'models'
    folder.mkdir(parents=True)
    (folder / 'gaits.npz').write_bytes(models['locomotion'].read_bytes())
    before = (folder / 'gaits.npz').read_bytes()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    monkeypatch.chdir(tmp_path)
    assert main(['analyze', 'gaits.npz', '--rename', 'style0=stroll']) == 2
    assert 'copy it' in capsys.readouterr().err and (folder / 'gaits.npz').read_bytes() == before
