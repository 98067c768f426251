"""What a newcomer needs of the command line: other ways to start it, completion, hints, progress, what was written."""
import os
import subprocess
import sys

import pytest

from style_core.errors import MotionError, UsageError
from style_core.motion import matching_names
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
