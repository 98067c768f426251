"""What evaluate and train say of numbers that mean nothing: noise, recordings of the training, nothing scored."""
import json

import numpy as np
import pytest

from style_core.cli import main
from style_core.evaluation import bands_verdict, verdict
from style_core.formats import read_motion, write_motion
from style_core.motion import Motion


def evaluated(capsys, *words):
    assert main(['evaluate', *map(str, words), '--json']) == 0
    return json.loads(capsys.readouterr().out)['recordings']


def test_verdicts():
    assert verdict(300.0, 594.0, 297.0) == 'no better than a constant pose'
    assert verdict(50.0, 40.0, 297.0) == 'no better than holding still'
    assert verdict(10.0, 40.0, 100.0) == '75% better than either'
    assert verdict(np.nan, np.nan, np.nan) == 'nothing could be scored'
    assert [bands_verdict(share) for share in (0.84, 0.86, 0.94, 0.96, np.nan)] == \
        ['too narrow', 'honest', 'honest', 'too wide', 'no band']


def test_a_model_of_noise_does_not_look_good(models, tmp_path, capsys):
    """White noise: holding still has twice the variance as its error, the mean pose the variance."""
    rng = np.random.default_rng(0)
    names = read_motion(models['phase-style'].with_name('phase-style.csv')).joint_names
    files = []
    for k in range(5):
        noise = Motion(names, 0.3 * rng.standard_normal((240, len(names))), np.arange(240) / 60, name=f'p{k}_1')
        write_motion(noise, tmp_path / f'p{k}_1.csv')
        files.append(str(tmp_path / f'p{k}_1.csv'))
    variance = np.degrees(0.3)**2
    for kind, more in (('locomotion', ['--styles', '1', '--restarts', '1']), ('phase-style', ['--styles', '2'])):
        status = main(['train', kind, *files[:4], '-o', str(tmp_path / f'{kind}.npz'), *more])
        said = capsys.readouterr().err
        assert 'looks like noise' in said
        if status == 0:
            assert 'shows no period' in said and 'explains' in said
            (one,) = evaluated(capsys, tmp_path / f'{kind}.npz', files[4]).values()
            assert one['mean_pose_error_deg2'] == pytest.approx(variance, rel=0.1)
            assert one['zero_velocity_error_deg2'] == pytest.approx(2 * variance, rel=0.1)
            assert one['verdict'] == 'no better than a constant pose' and not one['in_training']


def test_motion_that_repeats_is_not_doubted(models, tmp_path, capsys):
    folder = models['locomotion'].parent
    files = [str(path) for path in sorted(folder.glob('p?_?.csv'))]
    assert main(['train', 'locomotion', *files, '--styles', '1', '--restarts', '1', '-o', str(tmp_path / 'm.npz')]) == 0
    assert not capsys.readouterr().err


def test_a_recording_of_the_training_is_named(models, capsys):
    folder, model = models['phase-style'].parent, models['phase-style']
    found = evaluated(capsys, model, folder / 'p0_0.csv', folder / 'phase-style.csv')
    assert [one['in_training'] for one in found.values()] == [True, False]
    assert main(['evaluate', str(model), str(folder / 'p0_0.csv')]) == 0
    assert 'was in training' in capsys.readouterr().out
    assert main(['evaluate', str(model), str(folder / 'phase-style.csv')]) == 0
    shown = capsys.readouterr().out
    assert 'in training' not in shown and 'better than either; bands' in shown and 'E mean' in shown


def test_nothing_scored_is_no_success(models, tmp_path, capsys):
    motion = read_motion(models['locomotion'].with_name('locomotion.csv'))
    positions = motion.positions.copy()
    positions[10:] = np.nan
    write_motion(motion.replace(positions=positions), tmp_path / 'short.csv')
    assert main(['evaluate', str(models['locomotion']), str(tmp_path / 'short.csv')]) == 1
    assert 'nothing could be scored' in capsys.readouterr().err
    whole = models['locomotion'].with_name('locomotion.csv')
    found = evaluated(capsys, models['locomotion'], tmp_path / 'short.csv', whole)
    (nothing, something) = found.values()
    assert nothing['error_deg2'] is None and nothing['verdict'] == 'nothing could be scored'
    assert 'better' in something['verdict']
