"""motion-style analyze with a phase-style model: on line and in batch, tables, pictures, events."""
import csv
import json

import numpy as np
import pytest
from test_phase_style_learning import made_cycle
from test_phase_style_published import RATE, behaviours, files  # noqa: F401

from style_core.cli import main
from style_core.errors import MotionError
from style_core.formats import read_motion, write_motion
from style_core.phase_style import load_behaviours
from style_core.phase_style.analysis import Course, course_of_batch, events, follow
from style_core.phase_style.matsubara_predictor import batch_em
from style_core.predictor import Status
from style_core.predictor_file import read_predictor


@pytest.fixture
def walk(files, tmp_path):  # noqa: F811
    """The first half of the recording, one style throughout."""
    write_motion(read_motion(files[1]).slice(None, 1.999), tmp_path / 'walk.csv')
    return str(tmp_path / 'walk.csv')


def table(path):
    with open(path, newline='') as stream:
        return list(csv.DictReader(stream))


def test_on_line_course_is_what_the_predictor_said(files, walk, tmp_path, capsys):  # noqa: F811
    out = tmp_path / 'course.csv'
    assert main(['analyze', files[0], walk, '--method', 'paper', '-o', str(out)]) == 0
    said, motion = capsys.readouterr().out, read_motion(walk)
    predictor = read_predictor(files[0], 'paper').predictor
    rows = table(out)
    assert len(rows) == motion.n_frames and 'status     TRACKING' in said
    for row, time, y in zip(rows, motion.times, motion.positions):
        estimate = predictor.update(time, y)
        assert (row['status'], row['behaviour']) == (estimate.status.name, 'walk')
        got = [float(row[name]) for name in ('time_s', 'phase', 'phase_velocity', 'innovation', 'style1', 'style3')]
        want = [time, estimate.phase, estimate.phase_velocity, estimate.innovation, *estimate.style[[0, 2]]]
        np.testing.assert_allclose(got, want, rtol=1e-8)


def test_json_holds_every_frame_and_event(files, walk, capsys):  # noqa: F811
    assert main(['analyze', files[0], walk, '--method', 'paper', '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said['frames']['phase']) == read_motion(walk).n_frames and said['method'] == 'paper'
    first, second, *rest = said['events']
    assert (first['value'], second['value']) == ('ACQUIRING', 'walk')
    cycles = [one['time'] for one in rest if one['kind'] == 'cycle']
    np.testing.assert_allclose(np.diff(cycles), 2 * np.pi / 5.6, atol=0.04)


def test_batch_says_how_it_converged(files, walk, tmp_path, capsys):  # noqa: F811
    out = tmp_path / 'batch.csv'
    assert main(['analyze', files[0], walk, '--batch', '-o', str(out), '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    behaviour, motion = load_behaviours(files[0])[0], read_motion(walk)
    want = batch_em(behaviour, motion.times, motion.positions)
    assert said['converged'] and said['iterations'] == len(want.log_likelihood) < 15
    assert said['style_change'][-1] < 1e-3 < said['style_change'][0]
    np.testing.assert_allclose(said['style'], want.style)
    rows = table(out)
    np.testing.assert_allclose([float(row['phase']) for row in rows], want.phase, rtol=1e-8)
    assert {row['status'] for row in rows} == {''} and len({row['style1'] for row in rows}) == 1
    assert main(['analyze', files[0], walk, '--batch']) == 0
    assert f'batch EM of walk, converged in {said["iterations"]} iterations' in capsys.readouterr().out


def test_batch_finds_the_style_of_a_made_up_motion(files, walk):  # noqa: F811
    behaviour, motion = load_behaviours(files[0])[0], read_motion(walk)
    result = batch_em(behaviour, motion.times, motion.positions)
    again = np.tensordot(result.style, np.stack([one.evaluate(result.phase)[0] for one in behaviour.processes()]), 1)
    assert np.sqrt(np.mean((again - made_cycle(5.6 * motion.times, 0.1))[30:] ** 2)) < 0.05


@pytest.mark.parametrize('more', [['--method', 'paper'], ['--batch'], ['--batch', '--behaviour', 'jump']])
def test_pictures(files, walk, tmp_path, more):  # noqa: F811
    assert main(['analyze', files[0], walk, *more, '--picture', str(tmp_path / 'a.png')]) == 0
    assert (tmp_path / 'a.png').read_bytes().startswith(b'\x89PNG')


def test_wrong_use_is_said_in_one_line(files, walk, capsys):  # noqa: F811
    for wrong in (['--batch', '--forgetting', '0.9'], ['--batch', '--without', 'unknown'],
                  ['--batch', '--behaviour', 'hop']):
        assert main(['analyze', files[0], walk, *wrong]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_hidden_joints_and_gaps_are_nothing_to_a_batch(files, walk, tmp_path, capsys):  # noqa: F811
    assert main(['analyze', files[0], walk, '--batch', '--json', '--mask', 'j0']) == 0
    masked = json.loads(capsys.readouterr().out)
    motion = read_motion(walk)
    positions = motion.positions.copy()
    positions[:, 0] = np.nan
    write_motion(motion.replace(positions=positions), tmp_path / 'holed.csv')
    assert main(['analyze', files[0], str(tmp_path / 'holed.csv'), '--batch', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['style'] == masked['style']


@pytest.mark.parametrize('wild', [1e5, -1e200, np.inf])
def test_what_no_joint_can_be_is_nothing_to_a_batch(files, walk, wild):  # noqa: F811
    behaviour, motion = load_behaviours(files[0])[0], read_motion(walk)
    holed, spoilt = motion.positions.copy(), motion.positions.copy()
    holed[40:43, :2], spoilt[40:43, :2] = np.nan, wild
    one, two = (batch_em(behaviour, motion.times, y) for y in (holed, spoilt))
    np.testing.assert_array_equal(one.style, two.style)
    np.testing.assert_array_equal(one.phase, two.phase)


def test_a_batch_of_nothing_but_zeros_has_figures(files):  # noqa: F811
    result = batch_em(load_behaviours(files[0])[0], np.arange(60) / RATE, np.zeros((60, 6)))
    assert np.isfinite(result.style_change).all() and np.isfinite(result.log_likelihood).all()


def test_events_of_a_course():
    names = ('walk', 'walk', 'walk', 'run', 'run', 'still')
    status = tuple(map(Status, (0, 1, 1, 1, 2, 1)))
    phase = np.array([6.0, 6.2, 0.1, 6.2, 0.1, np.nan])
    empty = np.zeros((6, 0))
    course = Course(np.arange(6.0), names, np.ones(6), phase, phase, empty, status, phase, empty, empty)
    assert [(one.time, one.kind, one.value) for one in events(course, {'walk': True, 'run': True})] == [
        (0.0, 'status', 'ACQUIRING'), (0.0, 'behaviour', 'walk'), (1.0, 'status', 'TRACKING'), (2.0, 'cycle', 'walk'),
        (3.0, 'behaviour', 'run'), (4.0, 'status', 'LOST'), (5.0, 'status', 'TRACKING'), (5.0, 'behaviour', 'still')]


def test_following_begins_anew_each_time(files, walk):  # noqa: F811
    predictor, motion = read_predictor(files[0], 'paper').predictor, read_motion(walk)
    one, two = follow(predictor, motion), follow(predictor, motion)
    np.testing.assert_array_equal(one.style, two.style)
    assert course_of_batch(load_behaviours(files[0])[0], motion.times, batch_em(
        load_behaviours(files[0])[0], motion.times, motion.positions)).status == ()
    with pytest.raises(MotionError, match='too few'):
        batch_em(load_behaviours(files[0])[0], motion.times[:3], motion.positions[:3])
