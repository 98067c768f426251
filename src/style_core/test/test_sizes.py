"""Sizes are worked out before memory is asked for, and styles far out are refused: one line, soon, nothing written."""
import numpy as np
import pytest

from style_core import sizes
from style_core.cli import main
from style_core.errors import UsageError
from style_core.formats import read_motion, write_motion


def one_line(capsys, words, status, *said):
    assert main([str(word) for word in words]) == status
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1 and len(complaint) < 800, complaint
    assert all(word in complaint for word in said), complaint


def test_the_figure_is_given(monkeypatch):
    monkeypatch.setattr(sizes, 'free_bytes', lambda: 2**30)
    sizes.demand(2**26, 'this', 'less')
    with pytest.raises(UsageError, match=r'this would take 8 GiB of memory, of which 1 GiB are free: less'):
        sizes.demand(2**30, 'this', 'less')
    for endless in (np.inf, np.nan):
        with pytest.raises(UsageError):
            sizes.demand(endless, 'this', 'less')


@pytest.mark.parametrize('kind', ['phase-style', 'locomotion', 'style-machine'])
def test_numbers_without_measure(models, kind, tmp_path, capsys):
    model, file, out = models[kind], models[kind].with_name(f'{kind}.csv'), tmp_path / 'out.csv'
    one_line(capsys, ['convert', file, out, '--rate', '1e12'], 2, 'GiB', '1e+12 Hz')
    one_line(capsys, ['predict', model, file, '-o', out, '--rate', '1e12'], 2, 'GiB', '--rate')
    one_line(capsys, ['predict', model, file, '-o', out, '--seconds', '1e12'], 2, 'GiB', '--seconds')
    one_line(capsys, ['evaluate', model, file, '--horizon', '1000000000000'], 1, 'too short')
    assert not out.exists()


def test_learning_at_a_rate_without_measure(models, tmp_path, monkeypatch, capsys):
    """At 10 kHz positions and frames both grow: the product is refused."""
    monkeypatch.setattr(sizes, 'free_bytes', lambda: 2**28)
    files = sorted(models['locomotion'].parent.glob('p?_?.csv'))
    one_line(capsys, ['train', 'locomotion', *files, '--styles', '1', '--rate', '10000', '-o', tmp_path / 'm.npz'], 2,
             'positions', '10000 Hz', 'GiB')


def test_more_predictions_than_fit_at_once_are_the_same(models, tmp_path):
    model, file = models['locomotion'], models['locomotion'].with_name('locomotion.csv')
    for rate, name in ((400, 'few'), (1200, 'many')):
        assert main(['predict', str(model), str(file), '-o', str(tmp_path / f'{name}.csv'), '--rate', str(rate)]) == 0
    few, many = (read_motion(tmp_path / f'{name}.csv').positions for name in ('few', 'many'))
    np.testing.assert_allclose(many[2::3], few, atol=1e-9)


@pytest.mark.parametrize('style', ['1000*walk', '5000*run', '-50*walk', '1e6*run', '1e300*run'])
def test_styles_far_out_are_refused_as_in_the_node(models, tmp_path, capsys, style):
    for content in (['--sequence', 'c1'], ['--random-walk', '5'],
                    ['--content', models['style-machine'].with_name('style-machine.csv')]):
        one_line(capsys, ['synthesize', models['style-machine'], *content, f'--style={style}', '-o',
                          tmp_path / 'a.csv'], 2, 'too far outside')
    assert not (tmp_path / 'a.csv').exists()


def test_what_lies_near_is_made_and_further_on_request(models, tmp_path, capsys):
    words = ['synthesize', str(models['style-machine']), '--random-walk', '2', '-o', str(tmp_path / 'a.csv'), '--style']
    for style in ('1.5*run - 0.5*walk', 'generic', 'run'):
        assert main([*words, style]) == 0
    one_line(capsys, [*words, '6*run - 5*walk'], 2, 'too far')
    assert main([*words, '6*run - 5*walk', '--max-exaggeration', '9']) == 0


@pytest.mark.parametrize('blend', ['1e15*0 - 999999999999999*0', '5*0 - 4*0', '1*0', '0'])
def test_blends_far_out(models, tmp_path, capsys, blend):
    """Of one style the only blend is itself, however it is spelt."""
    status = main(['synthesize', str(models['locomotion']), '--blend', blend, '-o', str(tmp_path / 'a.csv')])
    assert status in (0, 2)
    if status == 0:
        assert np.abs(read_motion(tmp_path / 'a.csv').positions).max() < 4.0


@pytest.mark.parametrize('style', ['(' * 2000 + 'walk' + ')' * 2000, '-' * 5000 + 'walk', '1e6*', '*', '1e999*walk',
                                   'walk' * 3000, '[' + '1,' * 5000 + '1]'])
def test_expressions_of_any_shape_are_one_line(models, tmp_path, capsys, style):
    words = ['synthesize', models['style-machine'], '--random-walk', '1', f'--style={style}', '-o', tmp_path / 'a.csv']
    assert main([str(word) for word in words]) in (1, 2)
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1 and len(complaint) < 800 and not (tmp_path / 'a.csv').exists()


def test_a_lack_of_memory_is_one_line(models, monkeypatch, capsys):
    from style_core.cli import info
    monkeypatch.setattr(info, 'run', lambda args: np.empty(2**55))
    one_line(capsys, ['info', models['effort']], 1, 'not enough memory')


def test_a_short_recording_at_any_rate(tmp_path, gait, capsys):
    write_motion(gait, tmp_path / 'a.csv')
    assert main(['convert', str(tmp_path / 'a.csv'), str(tmp_path / 'b.csv'), '--rate', '2000']) == 0
