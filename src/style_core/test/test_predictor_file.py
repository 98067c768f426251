"""One loader makes the on-line predictor of every kind of model, for the commands and for live use."""
import json

import numpy as np
import pytest
from test_locomotion import made_gait
from test_style_machine import FAST, cycle

from style_core import locomotion, style_machine
from style_core.cli import main
from style_core.errors import ModelError, MotionError, UsageError
from style_core.formats import read_motion, write_motion
from style_core.model_file import save_model
from style_core.predictor_file import read_predictor
from style_core.stream.joint_map import identity_map
from style_core.stream.loading import load_live
from style_core.stream.stream import PredictorStream, StreamSettings

AHEAD = np.array([0.1, 0.2])
KINDS = ('phase-style', 'locomotion', 'style-machine')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A model of each kind and, for each, a recording of the same motion that it has not seen."""
    folder = tmp_path_factory.mktemp('models')
    gaits = [made_gait(0, k, pace=(0.95, 1.05)[k % 2])[0] for k in range(4)]
    for gait in gaits[:2]:
        write_motion(gait, folder / f'{gait.name}.csv')
    assert main(['train', 'phase-style', *(str(folder / f'{gait.name}.csv') for gait in gaits[:2]), '-o',
                 str(folder / 'phase-style.npz')]) == 0
    locomotion.save(locomotion.learn(gaits, 1, restarts=1), folder / 'locomotion.npz')
    machine = style_machine.learn([cycle('walk', 0.9, 0.4, 0.0), cycle('run', 1.5, 0.7, 0.2, seed=1)], FAST,
                                  leading=3, dof=2)
    style_machine.save(machine, folder / 'style-machine.npz')
    for kind in KINDS:
        new = cycle('r', 1.45, 0.7, 0.2, seed=8) if kind == 'style-machine' else made_gait(0, 77)[0]
        write_motion(new, folder / f'{kind}.csv')
    return folder


def recording(folder, kind):
    return read_motion(folder / f'{kind}.csv')


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_follows_a_live_stream(folder, kind):
    live = load_live(folder / f'{kind}.npz', 'full', AHEAD)
    assert (live.name, live.kind, live.method) == (kind, kind, 'full') and live.rate_hz > 0
    stream = PredictorStream(live.predictor, identity_map().bind(live.predictor.joint_names), StreamSettings())
    motion = recording(folder, kind)
    errors, still = [], []
    for i, (time, y) in enumerate(zip(motion.times, motion.positions)):
        stamp = round(1e9 * (5 + time))
        (step,) = stream.receive(motion.joint_names[1:], y[1:], stamp, stamp)     # a sensor is missing throughout
        assert not live.is_discrete(step.estimate)
        outlook = stream.predict(AHEAD)
        if motion.n_frames // 2 < i and time + 0.21 < motion.times[-1]:
            coming = motion.at(time + AHEAD).positions
            errors.append(outlook.mean - coming)
            still.append(y - coming)
    assert stream.tally.total['filter failures'] == 0
    assert np.mean(np.square(errors)) < 0.4 * np.mean(np.square(still))


def test_what_cannot_predict_is_refused(folder, tmp_path):
    save_model(tmp_path / 'library.npz', 'song', {'joint_names': []}, {})
    with pytest.raises(ModelError, match='song model, which cannot predict'):
        load_live(tmp_path / 'library.npz', 'full', AHEAD)
    assert read_predictor(folder / 'phase-style.npz', 'paper').predictor.joint_names
    for kind in KINDS[1:]:
        with pytest.raises(UsageError, match="'paper' is for phase-style"):
            read_predictor(folder / f'{kind}.npz', 'paper')
        assert main(['evaluate', str(folder / f'{kind}.npz'), str(folder / f'{kind}.csv'), '--method', 'paper']) == 2


@pytest.mark.parametrize('kind', KINDS)
def test_commands_predict_and_evaluate(folder, kind, tmp_path, capsys):
    model, file = str(folder / f'{kind}.npz'), str(folder / f'{kind}.csv')
    assert main(['evaluate', model, file, '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    assert said['method'] == ('full' if kind == 'phase-style' else None)     # the others have no choice of it
    (found,) = said['recordings'].values()
    assert found['error_deg2'] < 0.5 * found['zero_velocity_error_deg2']
    assert main(['evaluate', model, file, '--horizon', '1000']) == 1
    assert 'too short' in capsys.readouterr().err
    out, std = tmp_path / 'next.csv', tmp_path / 'std.csv'
    assert main(['predict', model, file, '--at', '1.5', '--seconds', '0.3', '-o', str(out), '--std', str(std)]) == 0
    assert ('phase nan' not in capsys.readouterr().out) and out.exists() and std.exists()


def test_a_predictor_of_gait_serves_angles(tmp_path):
    """Root travel does not repeat and its height is no joint; fill-in still covers height."""
    names = tuple(f'root.{axis}' for axis in ('tx', 'ty', 'tz', 'rx', 'ry', 'rz'))
    gaits = []
    for k in range(3):
        gait, phase = made_gait(0, k)
        root = np.zeros((gait.n_frames, 6))
        root[:, 1] = 0.9 + 0.02 * np.cos(2 * phase)
        root[:, 2] = 1.2 * gait.times
        gaits.append(gait.replace(joint_names=names + gait.joint_names, units=('m',) * 3 + ('rad',) * 9,
                                  positions=np.hstack([root, gait.positions])))
    model = locomotion.learn(gaits, 1, restarts=1, n_iterations=6)
    assert locomotion.LocomotionPredictor(model).joint_names == gaits[0].joint_names[6:]
    with pytest.raises(ModelError, match=r'root\.tx'):
        locomotion.LocomotionPredictor(model, ['root.tx'])
    holed = gaits[0].positions.copy()
    holed[70:, [1, 6]] = np.nan
    filled, std = locomotion.fill_causally(model, gaits[0].replace(positions=holed))
    assert np.abs(filled.positions - gaits[0].positions)[:, 1].max() < 0.02
    assert (std[70:, [1, 6]] > 0).all() and not std[:70].any()
    holed[70:, 2] = np.nan
    with pytest.raises(MotionError, match=r'root\.tz cannot be filled'):
        locomotion.fill_causally(model, gaits[0].replace(positions=holed))
