"""What a newcomer needs of the command line: other ways to start it, completion, hints, progress, what was written."""
import os
import subprocess
import sys

import pytest

from style_core.errors import MotionError, UsageError
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
