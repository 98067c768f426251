"""What a newcomer needs of the command line: other ways to start it, completion, hints, progress, what was written."""
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from style_core.cli import main
from style_core.cli.answer import plain
from style_core.errors import MotionError, UsageError
from style_core.formats import read_motion, write_motion
from style_core.motion import matching_names
from style_core.progress import progress
from style_core.style_expression import evaluate_style
from style_core.text import did_you_mean


def completions(line, folder, **more):
    """What argcomplete answers a shell, which speaks by variables and a file, for a line."""
    pytest.importorskip('argcomplete')
    answer = folder / 'answer'
    environment = {**os.environ, '_ARGCOMPLETE': '1', 'COMP_LINE': line, 'COMP_POINT': str(len(line)),
                   '_ARGCOMPLETE_STDOUT_FILENAME': str(answer), '_ARGCOMPLETE_IFS': '\n', 'COMP_TYPE': '9', **more}
    subprocess.run([sys.executable, '-m', 'style_core'], env=environment, cwd=folder, check=True,
                   stderr=subprocess.DEVNULL)
    return [word.strip() for word in answer.read_text().split('\n')]


def test_the_package_runs_as_the_command():
    done = subprocess.run([sys.executable, '-m', 'style_core', '--help'], capture_output=True, text=True)
    assert done.returncode == 0 and 'usage: motion-style' in done.stdout and not done.stderr


def test_commands_and_their_options_are_completed(tmp_path):
    assert completions('motion-style conv', tmp_path) == ['convert']
    assert set(completions('motion-style convert a.csv b.csv --r', tmp_path)) == {'--rate', '--recorded-rate'}
    assert set(completions('motion-style convert a.csv b.csv --unit ', tmp_path)) == {'rad', 'deg'}
    assert completions('motion-style train loc', tmp_path) == ['locomotion']


def test_options_are_completed_for_the_kind_of_the_model(models, tmp_path):
    assert completions(f'motion-style synthesize {models["locomotion"]} --bl', tmp_path) == ['--blend']
    assert completions('motion-style synthesize absent.npz --bl', tmp_path) == ['']


def test_a_word_that_is_like_a_name_is_answered_with_it():
    assert did_you_mean('wlak', ['walk', 'run']) == '; did you mean walk?'
    assert did_you_mean('Walk', ['walk', 'run']) == '; did you mean walk?'
    assert did_you_mean('zzz', ['walk', 'run']) == did_you_mean('', []) == ''
    assert len(did_you_mean('x' * 10**6, ['x' * 10**6, *map(str, range(10**5))])) == 0


def test_joints_and_styles_are_hinted_at():
    with pytest.raises(MotionError, match=r'did you mean left_knee'):
        matching_names(['left_knee', 'right_hip'], ['left_kneee*'])
    with pytest.raises(UsageError, match=r'did you mean strut\?'):
        evaluate_style('0.5*strutt', {'strut': [1.0], 'walk': [0.0]}, 1)


def test_without_a_terminal_progress_is_a_line_every_ten_seconds(monkeypatch, capsys):
    """Four seconds pass with every item; the lines come at 12, 24 and 36 s."""
    now = iter(range(0, 1000, 4))
    monkeypatch.setattr('style_core.progress.monotonic', lambda: next(now))
    assert list(progress(range(10), 'reading', 'file')) == list(range(10))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split('[')[0].split()[-1] for line in lines] == ['3/10', '6/10', '9/10']
    assert all(line.startswith('reading: ') and '\r' not in line for line in lines) and 'file' in lines[0]


def test_progress_without_items_counts_updates(monkeypatch, capsys):
    now = iter(range(0, 1000, 11))
    monkeypatch.setattr('style_core.progress.monotonic', lambda: next(now))
    with progress(desc='training', total=3) as bar:
        bar.set_postfix_str('temperature 2')
        bar.update()
    assert '1/3' in (said := capsys.readouterr().err) and 'temperature 2' in said


def test_what_is_done_soon_or_not_to_be_shown_says_nothing(monkeypatch, capsys):
    assert list(progress([1, 2], 'reading')) == [1, 2]
    now = iter(range(0, 1000, 11))
    monkeypatch.setattr('style_core.progress.monotonic', lambda: next(now))
    assert list(progress([1, 2], 'reading', shown=False)) == [1, 2]
    assert capsys.readouterr().err == ''


def test_every_file_that_is_written_is_named_once(models, gait, tmp_path, monkeypatch, capsys):
    """Tables, motions, pictures and models, by what lies in the folder afterwards."""
    folder = models['phase-style'].parent
    monkeypatch.chdir(tmp_path)
    write_motion(gait, folder / 'gait.csv')
    for words in (['predict', models['phase-style'], folder / 'phase-style.csv', '-o', 'a.csv', '--std', 'b.csv'],
                  ['fill', models['locomotion'], folder / 'locomotion.csv', '-o', 'c.npz'],
                  ['analyze', models['locomotion'], folder / 'locomotion.csv', '-o', 'd.csv', '--picture', 'e.png'],
                  ['analyze', models['style-machine'], '--map', 'f.png', '--graph', 'g.dot'],
                  ['info', folder / 'gait.csv', '--picture', 'h.png'],
                  ['convert', folder / 'gait.csv', 'i.npz'],
                  ['convert', folder / 'gait.csv', 'bag', '--storage', 'mcap'],
                  ['blend', folder / 'gait.csv', folder / 'gait.csv', '--alpha', '0.5', '-o', 'j.csv']):
        before = set(os.listdir())
        assert main([str(word) for word in words]) == 0
        said = [line[6:] for line in capsys.readouterr().out.splitlines() if line.startswith('wrote ')]
        assert sorted(said) == sorted(set(os.listdir()) - before) and said, words


def test_beside_json_it_is_said_on_stderr(models, tmp_path, capsys):
    assert main(['analyze', str(models['style-machine']), str(models['style-machine'].parent / 'style-machine.csv'),
                 '--json', '--map', str(tmp_path / 'a.png')]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) and f'wrote {tmp_path / "a.png"}' in said.err


def test_what_was_not_written_is_not_said_to_be(gait, tmp_path, capsys):
    write_motion(gait, tmp_path / 'a.csv')
    (tmp_path / 'b.csv').write_text('old')
    assert main(['convert', str(tmp_path / 'a.csv'), str(tmp_path / 'b.csv'), '--select', 'nothing']) == 1
    assert 'wrote' not in capsys.readouterr().out


def test_commands_that_make_motion_answer_in_json(models, gait, tmp_path, capsys):
    """One object, nothing else on stdout, with the frames that are in the file."""
    folder, out = models['phase-style'].parent, str(tmp_path / 'out.npz')
    write_motion(gait, tmp_path / 'gait.csv')
    joint = read_motion(folder / 'phase-style.csv').joint_names[0]
    for words, keys in (
            (['predict', models['phase-style'], folder / 'phase-style.csv'], {'status', 'phase', 'first', 'last'}),
            (['fill', models['phase-style'], folder / 'phase-style.csv', '--mask', joint],
             {'hidden_rms_deg', 'course'}),
            (['fill', models['locomotion'], folder / 'locomotion.csv'], {'missing'}),
            (['synthesize', models['locomotion'], '--blend', '0', '--duration', '1'], {'rate_hz'}),
            (['synthesize', models['style-machine'], '--content', folder / 'style-machine.csv'], {'nearest', 'style'}),
            (['convert', tmp_path / 'gait.csv'], {'joints', 'missing'}),
            (['blend', tmp_path / 'gait.csv', tmp_path / 'gait.csv', '--alpha', '0.5'], {'first_s'})):
        target = [out] if words[0] == 'convert' else ['-o', out]
        assert main([str(word) for word in (*words, *target, '--json')]) == 0
        said = capsys.readouterr()
        found = json.loads(said.out)
        assert keys | {'output'} <= set(found) and found['output'] == out and f'wrote {out}' in said.err
        assert 'frames' not in found or words[0] == 'fill' or found['frames'] == read_motion(out).n_frames


def test_what_is_no_number_is_null_in_json():
    value = {'a': float('nan'), 'b': [np.float64(1.5), np.int64(2)], 'c': np.array([np.inf, 1.0]), 'd': (True, None)}
    assert plain(value) == {'a': None, 'b': [1.5, 2], 'c': [None, 1.0], 'd': [True, None]}
