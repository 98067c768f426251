"""The synthesizer without ROS: modes, styles, following, what is refused, what is reported."""
from pathlib import Path

import numpy as np
import pytest
from test_synthesis import made_gait

from style_core.errors import ModelError, UsageError
from style_core.formats import write_motion
from style_core.style_machine import Settings, learn
from style_core.style_machine import save as save_machine
from style_core.synthesis.performer import window_times
from style_core.synthesis.repertoire import Score, list_models, load_repertoire
from style_core.synthesis.retargeting import plain_robot, read_robot
from style_core.synthesis.stage import CHANGING, FINISHED, IDLE, PLAYING, Stage, StageSettings

CONFIG = Path(__file__).resolve().parents[3] / 'config'
AHEAD = window_times(0.02, 0.4)


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Folder with a machine and a recording of the same joints."""
    folder = tmp_path_factory.mktemp('files')
    machine = learn([made_gait(), made_gait(1.4, 0.6, 0.3, name='run')],
                    Settings(states=8, anneal=8, max_iterations=15), leading=2, dof=1)
    save_machine(machine, folder / 'machine.npz')
    write_motion(made_gait(), folder / 'walk.csv')
    return folder


@pytest.fixture(scope='module')
def everyday():
    return load_repertoire(CONFIG / 'models' / 'everyday.npz')


def run(stage, seconds, tick=0.02):
    """Advance; the windows' first points."""
    out = []
    for _ in range(round(seconds / tick)):
        window = stage.window(AHEAD)
        out.append(None if window is None else window[0][0])
        stage.advance(tick)
    return out


def test_what_each_file_can_serve(files, everyday):
    assert everyday.modes == ('cycle', 'follow')
    assert load_repertoire(files / 'machine.npz').modes == ('sequence', 'random_walk')
    assert load_repertoire(file=files / 'walk.csv').modes == ('file',)
    both = load_repertoire(files / 'machine.npz', files / 'walk.csv')
    assert set(both.modes) == {'sequence', 'random_walk', 'file'}
    with pytest.raises(UsageError):
        load_repertoire()
    with pytest.raises(ModelError):
        load_repertoire(files / 'absent.npz')
    assert list_models(files) == [('machine.npz', 'style-machine')]


@pytest.mark.parametrize('mode', ['sequence', 'random_walk', 'file', 'nonsense'])
def test_a_mode_that_does_not_fit_is_refused_and_nothing_changes(everyday, mode):
    stage = Stage(everyday, plain_robot())
    stage.choose('cycle')
    before = stage.source
    with pytest.raises(UsageError):
        stage.choose(mode)
    assert stage.source is before and stage.mode == 'cycle'


def test_style_by_name_coordinates_and_expression(everyday):
    stage = Stage(everyday, plain_robot())
    with pytest.raises(UsageError):
        stage.set_style('mean')     # nothing is performed yet
    stage.choose('cycle')
    names = list(stage.source.styles)
    v = stage.set_style(f'"{names[0]}"', 0.4)
    np.testing.assert_array_equal(v, stage.source.styles[names[0]])
    assert stage.standing().state == CHANGING
    run(stage, 0.5)
    assert stage.standing().state == PLAYING
    np.testing.assert_allclose(stage.standing().style, v)
    np.testing.assert_array_equal(stage.set_style(v + 0.01), v + 0.01)
    for bad in ('nobody', '', '2', v[:-1], np.full(len(v), np.nan), v + 1e6, f'1000*"{names[0]}"'):
        with pytest.raises(UsageError):
            stage.set_style(bad)
    for seconds in (-1.0, np.nan, np.inf):
        with pytest.raises(UsageError):
            stage.set_style('mean', seconds)
    np.testing.assert_array_equal(stage.source.target, v + 0.01)


def test_follow_changes_behaviour_and_ignores_what_it_cannot_follow(files):
    stage = Stage(load_repertoire(CONFIG / 'models' / 'everyday.npz'), plain_robot())
    stage.choose('follow')
    assert stage.standing().state == IDLE and stage.window(AHEAD) is None
    assert not stage.observe(1.0, 0.5, 'jump')      # discrete
    assert not stage.observe(1.0, 0.5, 'dancing')   # unknown
    assert stage.window(AHEAD) is None
    assert stage.observe(1.0, 6.0, 'locomotion')
    stage.advance(0.01)
    assert stage.standing().state == PLAYING and stage.window(AHEAD) is not None
    assert abs(stage.source.phase - 1.06) < 1e-6
    run(stage, 0.7)
    assert 'no estimates' in stage.standing().message
    run(stage, 1.5)
    assert stage.standing().message == 'no estimates: standing still'


def test_style_of_the_person(everyday):
    stage = Stage(everyday, plain_robot())
    stage.choose('follow')
    stage.observe(1.0, 6.0, 'locomotion')
    stage.advance(0.01)
    other = list(stage.source.styles.values())[3]
    stage.set_style('person')
    for k in range(200):
        stage.observe((1.0 + 0.06 * k) % 6.28, 6.0, 'locomotion', other)
        stage.advance(0.01)
    np.testing.assert_allclose(stage.source.target, other)


def test_a_sequence_waits_plays_and_finishes(files):
    stage = Stage(load_repertoire(files / 'machine.npz'), plain_robot())
    stage.choose('sequence')
    assert stage.standing().state == IDLE
    stage.choose('sequence', score=Score((0, 1, 2), (0.3, 0.3, 0.3)))
    run(stage, 0.5)
    assert stage.standing().state == PLAYING and 0.3 < stage.standing().phase < 0.8
    run(stage, 1.5)
    assert stage.standing().state == FINISHED
    np.testing.assert_allclose(stage.window(AHEAD)[1], 0.0, atol=1e-12)
    with pytest.raises(UsageError):
        stage.choose('sequence', score=Score((99,), (0.3,)))
    assert stage.standing().state == FINISHED


def test_another_model_takes_over_smoothly_or_is_refused(files, everyday):
    stage = Stage(everyday, plain_robot())
    stage.choose('cycle')
    run(stage, 0.3)
    before = stage.window(np.array([0.0]))
    stage.replace(load_repertoire(CONFIG / 'models' / 'locomotion.npz'))
    for one, other in zip(stage.window(np.array([0.0])), before):
        np.testing.assert_allclose(one, other, atol=1e-9)
    old = stage.repertoire
    with pytest.raises(UsageError, match='other joints'):
        stage.replace(load_repertoire(files / 'machine.npz'))
    assert stage.repertoire is old


def test_loaded_style_survives_a_change_of_mode(everyday):
    stage = Stage(everyday, plain_robot(), StageSettings(blend_time=0.1))
    stage.choose('cycle')
    name = list(stage.source.styles)[2]
    v = stage.set_style(f'"{name}"')
    stage.choose('cycle', speed=0.5)
    np.testing.assert_allclose(stage.source.style, v)


@pytest.mark.parametrize('robot', ['humanoid20', 'exosuit6', 'cmu'])
def test_shipped_robots_perform_every_style_within_limits(everyday, robot):
    stage = Stage(everyday, read_robot(CONFIG / 'robots' / f'{robot}.yaml'))
    stage.choose('cycle')
    lower, upper = stage.performer._bound.lower, stage.performer._bound.upper
    for name in list(stage.source.styles):
        stage.set_style(f'"{name}"', 0.3)
        for _ in range(20):
            positions, velocities = stage.window(AHEAD)
            assert ((positions >= lower) & (positions <= upper)).all()
            assert np.abs(velocities).max() < 30
            stage.advance(0.05)
