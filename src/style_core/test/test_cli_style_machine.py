"""The style machine's commands, end to end on made motion; and on real recordings where they are present."""
import json

import numpy as np
import pytest
from test_style_machine import cycle

from style_core.cli import main
from style_core.formats import read_motion, write_motion


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('commands')
    for motion in (cycle('walk', 0.9, 0.4, 0.0), cycle('run', 1.5, 0.7, 0.2, seed=1),
                   cycle('jog', 1.3, 0.6, 0.1, seed=3)):
        write_motion(motion, folder / f'{motion.name}.csv')
    assert main(['train', 'style-machine', str(folder / 'walk.csv'), str(folder / 'run.csv'), '-o',
                 str(folder / 'm.npz'), '--states', '10', '--dimensions', '3', '--anneal', '10']) == 0
    return folder


def test_training_leaves_a_model_and_no_checkpoint(folder, capsys):
    assert not list(folder.glob('*.checkpoint'))
    assert main(['info', str(folder / 'm.npz')]) == 0
    text = capsys.readouterr().out
    assert 'style-machine' in text and 'walk' in text and 'c1' in text
    assert main(['info', str(folder / 'm.npz'), '--json']) == 0
    record = json.loads(capsys.readouterr().out)
    assert {row['style'] for row in record['styles']} == {'walk', 'run'}
    assert record['states'] <= 10 and len(record['graph']) == record['states']


def test_analyze(folder, capsys):
    pictures = [str(folder / name) for name in ('map.png', 'content.png', 'graph.png')]
    assert main(['analyze', str(folder / 'm.npz'), str(folder / 'jog.csv'), '--map', pictures[0], '--occupancies',
                 pictures[1], '--graph', pictures[2]]) == 0
    assert 'nearest style run' in capsys.readouterr().out
    for picture in pictures:
        with open(picture, 'rb') as stream:
            assert stream.read(4) == b'\x89PNG'
    assert main(['analyze', str(folder / 'm.npz'), str(folder / 'walk.csv'), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['nearest'] == 'walk'
    assert main(['analyze', str(folder / 'm.npz'), '--graph', str(folder / 'graph.dot')]) == 0
    assert (folder / 'graph.dot').read_text().startswith('digraph')
    assert main(['analyze', str(folder / 'm.npz')]) == 2


@pytest.mark.parametrize('arguments', [
    ['--content', 'walk.csv', '--style', '1.5*run - 0.5*walk'], ['--content', 'jog.csv', '--keep-timing'],
    ['--sequence', 'c1*2 run@0.5-1.0', '--style', 'run'], ['--random-walk', '3', '--seed', '5'],
    ['--random-walk', '3', '--style', '[0.5]', '--rate', '100']])
def test_synthesize(folder, arguments, capsys):
    arguments = [str(folder / word) if word.endswith('.csv') else word for word in arguments]
    out = folder / 'made.csv'
    assert main(['synthesize', str(folder / 'm.npz'), *arguments, '-o', str(out)]) == 0
    motion = read_motion(out)
    assert np.isfinite(motion.positions).all() and motion.n_frames > 20
    assert motion.joint_names == ('hip', 'knee', 'ankle', 'arm', 'neck')
    assert motion.rate_hz == pytest.approx(100 if '--rate' in arguments else 60)


@pytest.mark.parametrize('arguments, status, message', [
    (['--sequence', 'c1', '--style', 'ballet'], 2, "no style 'ballet'"), (['--sequence', 'zz'], 2, "no 'zz'"),
    (['--random-walk', '-1'], 2, 'more than 0'), (['--content', 'absent.csv'], 1, 'absent.csv'),
    (['--sequence', 'c1', '--picture', 'x.png'], 2, 'needs --skeleton')])
def test_synthesize_refuses_with_one_line(folder, arguments, status, message, capsys):
    assert main(['synthesize', str(folder / 'm.npz'), *arguments, '-o', str(folder / 'no.csv')]) == status
    error = capsys.readouterr().err
    assert message in error and len(error.strip().splitlines()) == 1


@pytest.mark.parametrize('arguments, message', [
    ([], 'give recordings'), (['walk.csv', 'walk.csv'], 'twice'),
    (['walk.csv', '--dimensions', '11'], 'between 1 and 10'),
    (['walk.csv', '--states', '0'], 'at least 1'), (['--style', 'a'], 'no recordings')])
def test_train_refuses(folder, arguments, message, capsys):
    arguments = [str(folder / word) if word.endswith('.csv') else word for word in arguments]
    assert main(['train', 'style-machine', *arguments, '-o', str(folder / 'x.npz')]) == 2
    assert message in capsys.readouterr().err


def test_a_walk_of_the_mocap_in_the_style_of_a_run(mocap, tmp_path, capsys):
    files = [str(mocap / 'cmu' / name) for name in ('07/07_01.amc', '09/09_01.amc')]
    model, out = str(tmp_path / 'm.npz'), tmp_path / 'walk_as_run.amc'
    assert main(['train', 'style-machine', *files, '-o', model, '--states', '12', '--anneal', '10']) == 0
    assert main(['synthesize', model, '--content', files[0], '--style', '09_01', '-o', str(out)]) == 0
    capsys.readouterr()
    made, walk = read_motion(out), read_motion(files[0])
    assert set(made.joint_names) == set(walk.joint_names)  # the root comes from the content
    assert made.duration_s < walk.duration_s               # a run is quicker
    assert main(['analyze', model, str(out)]) == 0
    assert 'nearest style 09_01' in capsys.readouterr().out
