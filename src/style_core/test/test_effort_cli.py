"""The effort commands from the user's side."""
import csv
import json
from itertools import pairwise

import numpy as np
import pytest

from style_core.cli import main
from style_core.effort import restyle, train_library
from style_core.effort.labels import append_label, labelled, read_labels
from style_core.errors import MotionError
from style_core.formats import read_motion, write_motion
from style_core.motion import Motion, concatenate

NAMES = ('hip', 'knee', 'ankle')


def made(name, content, manner):
    """A swing of three joints; the manner sets size and speed."""
    count = 40 + 4 * manner
    u = np.linspace(0, 1, count)
    u = u + 0.03 * manner * np.sin(2 * np.pi * u)
    sign = np.array([1.0, -1.0, 0.5]) if content else np.array([-0.5, 0.4, 1.0])
    size = 1.0 + 0.1 * (manner % 3)
    return Motion(NAMES, size * sign * np.sin(np.pi * u)[:, None], np.arange(count) / 60, name=name)


@pytest.fixture
def recordings(tmp_path):
    motions = [made(f'{"swing" if c else "kick"}{m}', c, m) for c in (0, 1) for m in range(5)]
    for motion in motions:
        write_motion(motion, tmp_path / f'{motion.name}.csv')
    source = concatenate([motions[1], motions[7], motions[3]])
    write_motion(source, tmp_path / 'source.csv')
    return tmp_path, motions


def train(folder, motions, *more):
    files = [str(folder / f'{motion.name}.csv') for motion in motions]
    return main(['train', 'effort', *files, '--joints', '*', '--interpolations', '24', '-o', str(folder / 'lib.npz'),
                 *more])


def test_train_restyle_and_info(recordings, capsys):
    folder, motions = recordings
    assert train(folder, motions) == 0
    assert '2 contents' in capsys.readouterr().out
    command = ['effort', str(folder / 'source.csv'), '--library', str(folder / 'lib.npz'), '--weight', '2', '-o',
               str(folder / 'out.csv'), '--json']
    assert main(command) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [piece['matches'][:4] for piece in answer['pieces']] == ['kick', 'swin', 'kick']
    result = read_motion(folder / 'out.csv')
    assert result.joint_names == NAMES
    assert np.isfinite(result.positions).all()
    assert main(['info', str(folder / 'lib.npz')]) == 0
    assert 'computed' in capsys.readouterr().out


def test_a_rate_for_a_recording_that_says_its_own_is_refused(recordings, capsys):
    folder, motions = recordings
    assert train(folder, motions) == 0
    assert main(['effort', str(folder / 'source.csv'), '--library', str(folder / 'lib.npz'), '--weight', '2', '-o',
                 str(folder / 'out.csv'), '--recorded-rate', '120']) == 1
    assert 'rate_hz means nothing for .csv' in capsys.readouterr().err
    assert not (folder / 'out.csv').exists()


def test_table_of_fragments(recordings, capsys):
    folder, motions = recordings
    long = concatenate(motions)
    write_motion(long, folder / 'long.csv')
    start = 0.0
    with open(folder / 'fragments.csv', 'w', newline='') as stream:
        table = csv.writer(stream)
        table.writerow(['fragment', 'file', 'start_s', 'stop_s', 'content'])
        for motion in motions:
            stop = start + motion.n_frames / 60
            table.writerow([motion.name, 'long.csv', start, stop - 0.5 / 60, motion.name[:4]])
            start = stop
    assert main(['train', 'effort', '--fragments', str(folder / 'fragments.csv'), '--joints', '*', '--interpolations',
                 '24', '-o', str(folder / 'lib.npz')]) == 0
    assert '10 fragments in 2 contents' in capsys.readouterr().out
    (folder / 'bad.csv').write_text('fragment,file\n')
    assert main(['train', 'effort', '--fragments', str(folder / 'bad.csv'), '-o', str(folder / 'x.npz')]) == 1
    assert 'start_s' in capsys.readouterr().err


@pytest.mark.parametrize('content', [b'', b'\xff\xfe\x81', b'PK\x03\x04\0\0', b'fragment,file\na,b\n'])
def test_table_of_fragments_that_is_none(tmp_path, capsys, content):
    """Binary files, empty ones, columns that lack: one line, no traceback."""
    table = tmp_path / 'table.csv'
    table.write_bytes(content)
    assert main(['train', 'effort', '--fragments', str(table), '-o', str(tmp_path / 'out.npz')]) == 1
    said = capsys.readouterr().err
    assert 'table.csv' in said and len(said.splitlines()) == 1


def test_labels_are_collected_and_learned(recordings, capsys, monkeypatch):
    folder, motions = recordings
    assert train(folder, motions) == 0
    answers = iter(['nonsense', '1 2', '1 -2 0.5', 'q'])
    monkeypatch.setattr('builtins.input', lambda prompt: next(answers))
    label = ['label', str(folder / 'lib.npz'), '-o', str(folder / 'labels.csv'), '--labeller', 'anna', '--pictures',
             str(folder / 'pictures')]
    assert main(label) == 0
    assert labelled(folder / 'labels.csv', 'anna') == {'kick0'}
    assert (folder / 'pictures' / 'kick0.png').stat().st_size > 5000
    generator = np.random.default_rng(0)
    monkeypatch.setattr('builtins.input', lambda prompt: ' '.join(map(str, generator.uniform(-3, 3, 3).round(1))))
    assert main(label) == 0
    np.testing.assert_allclose(read_labels(folder / 'labels.csv')['kick0'], [1, -2, 0.5])
    capsys.readouterr()
    assert train(folder, motions, '--labels', str(folder / 'labels.csv')) == 0
    assert 'by a person' in capsys.readouterr().out


def test_labels_refuse(tmp_path):
    path = tmp_path / 'labels.csv'
    append_label(path, 'a', (0, 0, 4), 'x')
    with pytest.raises(MotionError, match='line 2'):
        read_labels(path)
    path.write_text('fragment,flow,weight,time,labeller\na,1,2,three,x\n')
    with pytest.raises(MotionError, match='numbers'):
        read_labels(path)
    path.write_text('fragment,flow,weight,time,labeller\na,1,2,3,x\n')
    with pytest.raises(MotionError, match='no labels by y'):
        read_labels(path, 'y')


@pytest.mark.parametrize('command, status, message', [
    (['--flow', '9'], 2, r'\[-3, 3\]'), ([], 2, 'at least one'), (['--flow', '1', '--picture', 'x.png'], 2, 'skeleton'),
])
def test_effort_refuses(recordings, capsys, command, status, message):
    import re
    folder, motions = recordings
    train(folder, motions)
    full = ['effort', str(folder / 'source.csv'), '--library', str(folder / 'lib.npz'), '-o', str(folder / 'o.csv')]
    assert main([*full, *command]) == status
    assert re.search(message, capsys.readouterr().err)
    assert not (folder / 'o.csv').exists()


def test_blend(recordings, capsys):
    folder, motions = recordings
    command = ['blend', str(folder / 'kick0.csv'), str(folder / 'kick4.csv'), '-o', str(folder / 'o.csv'), '--alpha']
    assert main([*command, '0']) == 0
    np.testing.assert_allclose(read_motion(folder / 'o.csv').positions, motions[0].positions, atol=1e-9)
    assert main([*command, '2']) == 2
    assert 'alpha' in capsys.readouterr().err


def test_real_steps_of_a_person_never_seen(trial):
    """Walking of subject 16 restyled by a library of subjects 07, 08 and 35: segments alternate left and right."""
    from style_core.contacts import foot_contacts
    from style_core.datasets import mocap_folder
    from style_core.skeleton import read_skeleton
    keep = ('!*fingers*', '!*thumb*', '!*hand*', '!*wrist*', '!*toes*')

    def steps(name):
        subject = name.split('_')[0]
        motion = trial(name)
        feet = foot_contacts(motion, read_skeleton(mocap_folder() / 'cmu' / subject / f'{subject}.asf'))
        strikes = sorted([(t, 'left') for t in feet['left'].heel_strikes]
                         + [(t, 'right') for t in feet['right'].heel_strikes])
        for k in range(len(strikes) - 1):
            piece = motion.slice(strikes[k][0], strikes[k + 1][0] + 0.5 / 60).select(*keep)
            yield strikes[k][1], piece.replace(name=f'{name}.{k}', times=piece.times - piece.times[0])

    fragments = [item for name in ('07_01', '07_02', '08_02', '08_03', '35_01', '35_02') for item in steps(name)]
    library = train_library([motion for _, motion in fragments], blends=40)
    sides = [side for side, _ in fragments]
    for group in range(library.groups.max() + 1):
        assert len({side for side, g in zip(sides, library.groups) if g == group}) == 1
    own = [motion for _, motion in steps('16_15')]
    source = trial('16_15').slice(trial('16_15').times[0], None).select(*keep)
    source = source.slice(own[0].times[0] + 0.53, 3.4)
    heavy, light = (restyle(library, source, (np.nan, value, np.nan)) for value in (2, -2))
    found = [sides[choice.segment.fragment] for choice in heavy.choices]
    assert all(a != b for a, b in pairwise(found))
    efforts = [np.mean([choice.effort[1] for choice in result.choices]) for result in (heavy, light)]
    assert efforts[0] > efforts[1] + 1.0
    fastest = np.abs(np.diff(library.space.encode(heavy.motion).joints, axis=0)).max()
    assert fastest < 1.5 * max(np.abs(np.diff(fragment.joints, axis=0)).max() for fragment in library.fragments)
