"""The command line: dispatch by name and by model kind, help, exit status."""
import argparse
import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from style_core.cli import main, registry
from style_core.cli.number import Count, Number, Positive, Seed
from style_core.errors import UsageError
from style_core.model_file import save_model


@pytest.fixture
def made_kind(monkeypatch):
    """A model kind of its own, registered as a helper of the package would."""
    module = types.ModuleType('made_kind')
    module.__doc__ = 'Made for a test.'

    def add_arguments(parser, argv):
        parser.add_argument('files', nargs='*', metavar='FILES')
        parser.add_argument('--speed', type=float, default=1.0, help='how fast')

    module.add_arguments = add_arguments
    module.run = lambda args: print(vars(args).get('model'), args.files, args.speed)
    module.describe = lambda header, arrays: {'states': len(arrays['x'])}
    monkeypatch.setitem(sys.modules, 'made_kind', module)
    monkeypatch.setitem(registry.TRAINERS, 'made', ('a made kind', 'made_kind'))
    for command in ('predict', 'info'):
        monkeypatch.setitem(registry.KIND_COMMANDS[command], 'made', 'made_kind')


@pytest.fixture
def model(tmp_path):
    path = tmp_path / 'model.npz'
    save_model(path, 'made', {'joint_names': ['a']}, {'x': np.zeros(3)})
    return str(path)


def test_help_lists_what_there_is(capsys):
    with pytest.raises(SystemExit) as end:
        main(['--help'])
    assert end.value.code == 0
    assert 'info' in capsys.readouterr().out


def test_a_trainer_is_found_by_its_kind(made_kind, capsys):
    assert main(['train', 'made', 'x.amc', '--speed', '2']) == 0
    assert "None ['x.amc'] 2.0" in capsys.readouterr().out
    for words in (['train'], ['train', 'unheard'], ['train', 'made', '--speed', 'x']):
        with pytest.raises(SystemExit) as end:
            main(words)
        assert end.value.code == 2


def test_a_model_chooses_its_module(made_kind, model, capsys):
    assert main(['predict', model, 'a.amc', '--speed', '3']) == 0
    assert f"{model} ['a.amc'] 3.0" in capsys.readouterr().out


def test_help_teaches_every_kind_without_a_model(made_kind, capsys):
    with pytest.raises(SystemExit) as end:
        main(['predict', '--help'])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert 'With a made model' in text and '--speed' in text and 'Made for a test.' in text


def test_a_model_of_the_wrong_kind_or_none_is_one_clear_line(made_kind, model, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(registry.KIND_COMMANDS, 'predict', {'other': 'made_kind'})
    assert main(['predict', model]) == 1
    assert 'made model' in capsys.readouterr().err
    assert main(['predict', str(tmp_path / 'absent.npz')]) == 1
    assert 'does not exist' in capsys.readouterr().err
    for words in (['model.txt'], ['model.txt', 'walk.amc', '-o', 'out.csv']):
        assert main(['predict', *words]) == 1
        said = capsys.readouterr().err
        assert said == 'motion-style predict: model.txt is not a model file: its name must end in .npz\n'


def test_a_damaged_model_is_one_clear_line(made_kind, model, tmp_path, capsys):
    """Whatever is damaged: the archive, the compressed arrays, the header."""
    sound = Path(model).read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(60):
        damaged = bytearray(sound)
        for place in rng.integers(0, len(sound), 4):
            damaged[place] ^= 0xff
        (tmp_path / 'damaged.npz').write_bytes(damaged)
        status = main(['info', str(tmp_path / 'damaged.npz')])
        said = capsys.readouterr().err
        assert status == 0 or (status == 1 and said.startswith('motion-style info: ')), said
        refused += status
    assert refused > 30


def test_info_shows_a_model(made_kind, model, capsys):
    assert main(['info', model]) == 0
    assert 'states: 3' in capsys.readouterr().out
    assert main(['info', model, '--json']) == 0
    assert json.loads(capsys.readouterr().out)['states'] == 3


def test_info_shows_a_motion(tmp_path, capsys):
    path = tmp_path / 'short.amc'
    path.write_text(':DEGREES\n' + ''.join(f'{k}\nltibia {k}\n' for k in range(1, 4)))
    assert main(['info', str(path)]) == 0
    text = capsys.readouterr().out
    assert 'frames: 3' in text and 'ltibia.rx' in text
    path.write_text('nonsense')
    assert main(['info', str(path)]) == 1
    assert capsys.readouterr().err.count('\n') == 1


def test_info_draws_a_motion(tmp_path, mocap, capsys):
    from matplotlib.image import imread

    from style_core import datasets
    source = str(datasets.trial_path('09_01'))
    assert main(['info', source, '--picture', str(tmp_path / 'a.png'), '--select', '*femur*']) == 0
    assert {path.name for path in tmp_path.iterdir()} == {'a.png', 'a_pose.png'}
    assert all(imread(path).std() > 0.05 for path in tmp_path.iterdir())
    shown = capsys.readouterr().out
    assert 'lfemur.rx' in shown and 'ltibia.rx' not in shown


def test_info_of_a_model_has_no_picture(made_kind, model, capsys):
    assert main(['info', model, '--picture', 'a.png']) == 2
    assert 'motion files' in capsys.readouterr().err


@pytest.mark.parametrize('limits, word, wanted', [
    ({'above': 0}, '-5', 'be positive'), ({'above': 0}, '0', 'be positive'), ({'above': 0}, 'nan', 'be positive'),
    ({}, 'inf', 'be finite'), ({'type': int, 'least': 2}, '1', 'be at least 2'),
    ({'least': 1, 'most': 10}, '11', 'lie between 1 and 10'), ({'most': 3}, '3.5', 'be at most 3')])
def test_a_number_outside_its_limits_is_wrong_use(limits, word, wanted):
    parser = argparse.ArgumentParser()
    parser.add_argument('--size', action=Number, **limits)
    with pytest.raises(UsageError, match=f'--size must {wanted}.*, not {word}'):
        parser.parse_args(['--size', word])


def test_a_number_within_its_limits_is_taken():
    parser = argparse.ArgumentParser()
    parser.add_argument('--rate', action=Positive, default=60.0)
    parser.add_argument('--count', action=Count, most=3)
    parser.add_argument('--seed', action=Seed)
    assert vars(parser.parse_args([])) == {'rate': 60.0, 'count': None, 'seed': None}
    assert vars(parser.parse_args(['--rate', '0.5', '--count', '3', '--seed', '0'])) == {
        'rate': 0.5, 'count': 3, 'seed': 0}
    with pytest.raises(SystemExit):
        parser.parse_args(['--count', '1.5'])


@pytest.mark.parametrize('words', [
    ['convert', 'a.csv', 'b.csv', '--rate', '-5'], ['convert', 'a.bvh', 'b.csv', '--length-unit', '0'],
    ['info', 'a.amc', '--input-rate', 'nan'], ['train', 'phase-style', 'a.amc', '--rate', '0', '-o', 'm.npz'],
    ['train', 'phase-style', 'a.amc', '--recorded-rate', '-1', '-o', 'm.npz'],
    ['train', 'locomotion', 'a.amc', '--seed', '-1', '-o', 'm.npz'],
    ['train', 'style-machine', 'a.amc', '--rate', 'inf', '-o', 'm.npz'],
    ['train', 'effort', 'a.amc', '--interpolations', '0', '-o', 'm.npz'],
    ['retarget', 'plan.yaml', 'a.amc', '--rate', '-5', '-o', 'r.yaml']])
def test_impossible_numbers_are_refused_in_one_line_before_any_file_is_read(words, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert ' must be ' in error and error.count('\n') == 1
