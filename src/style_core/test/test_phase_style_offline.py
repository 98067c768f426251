"""Off line: the smoother against a dense batch Gaussian, batch EM, and the commands."""
import json

import numpy as np
import pytest
from test_phase_style_arrow import Dense
from test_phase_style_full import NAMES, jump, made_person, walk  # noqa: F401 (fixtures)
from test_phase_style_learning import made_sequence

from style_core import cli
from style_core.errors import MotionError
from style_core.formats import read_motion, write_motion
from style_core.motion import Motion
from style_core.phase_style import load_behaviours, save_behaviours
from style_core.phase_style.basis_table import Table
from style_core.phase_style.full import filter_table
from style_core.phase_style.matsubara_predictor import batch_em
from style_core.phase_style.smoother import _pieces, fill, smooth_piece


def test_smoother_is_the_dense_batch_gaussian(walk):  # noqa: F811
    """All states of all frames in one Gaussian, conditioned on everything seen, linearised at the same phases."""
    sequence, _ = made_person('n_1', 5.7, 0.8, 5, seconds=0.5)
    y = sequence.y[:14].copy()
    times = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.03, 14))
    y[4:9, :2], y[:, 5] = np.nan, np.nan
    phase, velocity = 1.0 + 5.7 * times, np.full(14, 5.7)
    from dataclasses import replace
    # without a personal cycle and with a single iteration the linearisation is at the phases given
    plain = replace(walk, residual=replace(
        walk.residual, variance={**walk.residual.variance, 'personal': np.zeros(6)}, style_decay=0.0))
    found = smooth_piece(plain, times, y, phase, velocity, iterations=1)
    table = Table(filter_table(plain))
    r = plain.residual
    # states at unit scale: phase, velocity, z, (offset, fast, its velocity) a channel
    dense = Dense(table, r.variance['offset'], r.variance['fast'], np.zeros((0, 6)), r.noise,
                  (r.decay['offset'], r.decay['fast'], 0.1, 0.0), plain.acceleration)
    dense.start(phase[0], plain.velocity[0], 1.0, plain.velocity[1] ** 2 + 1e-6)
    size, count = len(dense.x), len(times)
    mean, covariance = np.zeros(size * count), np.zeros((size * count, size * count))
    mean[:size], covariance[:size, :size] = dense.x, dense.p
    for t, dt in enumerate(np.diff(times)):
        f, q = dense.transition(dt, np.zeros(dense.m - 2))
        here, there = slice(size * t, size * (t + 1)), slice(size * (t + 1), size * (t + 2))
        mean[there] = f @ mean[here]
        covariance[there, :size * (t + 1)] = f @ covariance[here, :size * (t + 1)]
        covariance[:size * (t + 1), there] = covariance[there, :size * (t + 1)].T
        covariance[there, there] = f @ covariance[here, here] @ f.T + q
    rows, pose = [], []
    for t in range(count):
        dense.x = np.zeros(size)
        dense.x[0] = phase[t]
        value, h = dense.observation()
        rows.append(np.zeros((6, size * count)))
        rows[-1][:, size * t:size * (t + 1)] = h
        pose.append(value - h @ dense.x)
    h, constant = np.concatenate(rows), np.concatenate(pose)
    seen = ~np.isnan(y).ravel()
    s = h[seen] @ covariance @ h[seen].T + np.diag(np.tile(r.noise, count)[seen])
    gain = np.linalg.solve(s, h[seen] @ covariance).T
    want = mean + gain @ (y.ravel()[seen] - constant[seen] - h[seen] @ mean)
    spread = covariance - gain @ h[seen] @ covariance
    np.testing.assert_allclose(found.phase, want[::size][:count], atol=1e-6)
    np.testing.assert_allclose(found.mean.ravel(), constant + h @ want, atol=1e-6)
    np.testing.assert_allclose(found.std.ravel() ** 2, np.einsum('ij,jk,ik->i', h, spread, h), rtol=1e-5)


def test_fill_restores_hidden_joints_and_keeps_the_rest(walk, jump):  # noqa: F811
    y = made_person('n_1', 5.7, 0.8, 15, seconds=6)[0].y
    gap = y.copy()
    gap[100:160, :2], gap[:, 3] = np.nan, np.nan
    motion = Motion([*NAMES, 'hat'], np.column_stack([gap, np.arange(len(y))]), np.arange(len(y)) / 60)
    filled, std, report = fill([walk, jump], motion)
    assert len(report) == len(_pieces(360)) > 1 and all(one['behaviour'] == 'walk' for one in report)
    kept = ~np.isnan(motion.positions)
    np.testing.assert_array_equal(filled.positions[kept], motion.positions[kept])
    hidden = np.isnan(gap)
    error = (filled.positions[:, :6] - y)[hidden]
    assert np.sqrt(np.mean(error ** 2)) < 0.35 * np.std(y[:, 3])
    assert np.mean(np.abs(error) < 2 * std[hidden]) > 0.7
    for one in report:
        assert one['converged'] and one['log_evidence'][-1] >= one['log_evidence'][0]


def test_fill_refuses_what_it_cannot_fill(walk):  # noqa: F811
    times = np.arange(20) / 60
    with pytest.raises(MotionError, match='every value is missing'):
        fill([walk], Motion(NAMES, np.full((20, 6), np.nan), times))
    with pytest.raises(MotionError, match='too few'):
        fill([walk], Motion(NAMES, np.zeros((4, 6)), times[:4]))
    with pytest.raises(MotionError, match='no joint'):
        fill([walk], Motion(NAMES[:5], np.zeros((20, 5)), times))


def test_batch_em_converges_on_the_style(walk):  # noqa: F811
    sequence, _ = made_sequence('p2_1', 5.6, 2.0, 0.6, seconds=2.5, noise=0.01)
    y = sequence.y.copy()
    y[30:60, :3] = np.nan
    result = batch_em(walk, np.arange(120) / 60, y[:120])
    assert result.converged and len(result.log_likelihood) <= 15
    assert result.log_likelihood[-1] > result.log_likelihood[0]
    ahead = np.arange(1, 31) / 60
    np.testing.assert_allclose(result.predict(walk, ahead), sequence.y[120:150], atol=0.08)
    with pytest.raises(MotionError):
        batch_em(walk, np.arange(3) / 60, y[:3])


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recordings')
    paths = []
    for k in range(4):
        y = made_person(f'p{k}_1', 5 + 0.3 * k, 0.3 * k, k, shift=k)[0].y
        path = folder / f'p{k}_1.csv'
        write_motion(Motion(NAMES, y, np.arange(len(y)) / 60), path)
        paths.append(str(path))
    return folder, paths


def test_commands_train_info_evaluate_predict_fill(files, capsys):
    folder, paths = files
    model = str(folder / 'walk.npz')
    assert cli.main(['train', 'phase-style', *paths[:3], '-o', model, '--styles', '2', '--name', 'walk']) == 0
    one, = load_behaviours(model)
    assert one.style_dimension == 2 and one.sequences == ('p0_1', 'p1_1', 'p2_1') and one.residual is not None
    capsys.readouterr()
    assert cli.main(['info', model]) == 0
    assert 'rhythmic' in capsys.readouterr().out
    for method in ('full', 'paper'):
        assert cli.main(['evaluate', model, paths[3], '--json', '--method', method, '--mask', 'j1']) == 0
        result = json.loads(capsys.readouterr().out)['recordings']['p3_1']
        assert result['error_deg2'] < result['zero_velocity_error_deg2'] and len(result['rms_deg']) == 25
        assert np.isfinite(result['hidden_rms_deg'])
    assert cli.main(['evaluate', model, paths[3]]) == 0
    assert 'mean E' in capsys.readouterr().out
    out = str(folder / 'next.csv')
    assert cli.main(['predict', model, paths[3], '-o', out, '--at', '1.5', '--seconds', '0.5',
                     '--std', str(folder / 'std.csv')]) == 0
    prediction, truth = read_motion(out), read_motion(paths[3])
    assert prediction.n_frames == 30 and prediction.times[0] == pytest.approx(1.5 + 1 / 60)
    assert np.sqrt(np.mean((prediction.positions - truth.at(prediction.times).positions) ** 2)) < 0.12
    assert (read_motion(folder / 'std.csv').positions > 0).all()
    assert cli.main(['predict', model, paths[3], '-o', out, '--ahead', '0.1']) == 0
    assert read_motion(out).n_frames == truth.n_frames
    capsys.readouterr()
    assert cli.main(['fill', model, paths[3], '-o', out, '--mask', 'j1', 'j2']) == 0
    assert 'error of the hidden joints' in capsys.readouterr().out
    assert not np.isnan(read_motion(out).positions).any()


def test_commands_say_what_is_wrong(files, walk, capsys):  # noqa: F811
    folder, paths = files
    model = str(folder / 'wrong.npz')
    save_behaviours(model, [walk])
    out = str(folder / 'x.csv')
    for status, argv, words in (
            (2, ['train', 'phase-style', '-o', model], 'give recordings'),
            (2, ['train', 'phase-style', '--behaviour', 'walk', '-o', model], 'no recordings'),
            (1, ['train', 'phase-style', *paths[:2], '-o', model, '--styles', '5'], 'at least as many'),
            (1, ['train', 'phase-style', *paths[:2], '-o', model, '--joints', 'knee'], 'knee'),
            (1, ['train', 'phase-style', 'absent.csv', '-o', model], 'absent.csv'),
            (2, ['evaluate', model, paths[0], '--mask', 'knee'], 'knee'),
            (2, ['evaluate', model, paths[0], '--mask', '*'], 'every joint'),
            (2, ['evaluate', model, paths[0], '--horizon', '0'], 'at least 1'),
            (2, ['predict', model, paths[0], '-o', out, '--at', '99'], 'outside'),
            (2, ['predict', model, paths[0], '-o', out, '--seconds', '0'], 'positive')):
        assert cli.main(argv) == status
        assert words in capsys.readouterr().err


def test_shipped_models_load_and_predict(trial):
    from pathlib import Path

    from style_core.evaluation import paper_horizons, roll_out, summary
    from style_core.phase_style import load_predictor
    folder = Path(__file__).resolve().parents[3] / 'config' / 'models'
    motion = trial('08_01')
    for name in ('locomotion', 'everyday'):
        result = summary(roll_out(load_predictor(folder / f'{name}.npz'), motion, paper_horizons()))
        assert result['error_deg2'] < 0.1 * result['zero_velocity_error_deg2']
