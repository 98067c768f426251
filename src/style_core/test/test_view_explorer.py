"""The style explorer without any viewer: mixtures, reach, content kept while the style changes, files; commands."""
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from style_core.cli import main
from style_core.errors import UsageError
from style_core.formats import read_motion
from style_core.skeleton import read_skeleton
from style_core.style_machine import load
from style_core.view.explorer import (
    SAVED_AS,
    expression,
    file_of,
    mixed,
    of_recording,
    of_sequence,
    of_walk,
    performed,
    reach,
    same_place,
)

CONFIG = Path(__file__).parents[3] / 'config'
MACHINE, PERSON = CONFIG / 'models' / 'locomotion_styles.npz', CONFIG / 'skeletons' / 'person.asf'
pytestmark = pytest.mark.skipif(not MACHINE.is_file(), reason='needs the config folder of the repository')


@pytest.fixture(scope='module')
def machine():
    return load(MACHINE)


def test_mixtures_are_those_of_style_expressions(machine):
    limits = reach(machine, 3.0)
    np.testing.assert_allclose(mixed(machine, 'walk_02', 'run_02', 0.25, 1.2, limits),
                               machine.style('1.2*(0.75*walk_02 + 0.25*run_02)'))
    np.testing.assert_allclose(mixed(machine, 'walk_02', 'run_02', 0.0, 1.0, limits), machine.styles['walk_02'])


def test_no_mixture_leaves_the_reach(machine):
    low, high = limits = reach(machine, 0.1)
    v = mixed(machine, 'walk_02', 'run_02', 1.5, 2.0, limits)
    assert (v >= low).all() and (v <= high).all()
    assert all((style > low).all() and (style < high).all() for style in machine.styles.values())


def test_an_expression_says_its_coordinates(machine):
    v = mixed(machine, 'walk_02', 'run_02', 0.3, 1.0, reach(machine))
    np.testing.assert_allclose(machine.style(expression(v)), v, rtol=1e-3)


def test_a_style_changes_how_and_not_what(machine):
    content = of_walk(machine, 3.0, seed=2)
    walk, run = (performed(machine, content, machine.style(name)) for name in ('walk_07', 'run_16'))
    assert len(content.visits) > 3 and walk.joint_names == run.joint_names
    middle = [motion.at([motion.times[0] + 0.5 * motion.duration_s]).positions for motion in (walk, run)]
    assert np.degrees(np.abs(middle[0] - middle[1]).max()) > 5.0
    # the same content in its own style again: the same motion, bit for bit
    again = performed(machine, content, machine.style('walk_07'))
    np.testing.assert_array_equal(again.positions, walk.positions)


def test_a_recording_in_its_own_style_is_nearer_to_it_than_in_another(machine):
    walk = performed(machine, of_sequence(machine, 'walk_07'), machine.style('walk_07'))
    content = of_recording(machine, walk)

    def away(v):
        made = performed(machine, content, v)
        times = made.times * walk.duration_s / made.duration_s
        return np.sqrt(np.mean((made.positions - walk.at(np.minimum(times, walk.times[-1])).positions)**2))

    assert away(content.style) < 0.5 * away(machine.style('run_16'))


def test_an_unknown_sequence_is_refused(machine):
    with pytest.raises(UsageError):
        of_sequence(machine, 'no_such_thing')
    assert of_sequence(machine, 's1 s2').visits


def test_a_change_of_style_keeps_the_place():
    assert same_place(2.0, 8.0, 4.0) == 1.0 and same_place(1.0, 0.0, 4.0) == 0.0


@pytest.mark.parametrize('suffix', SAVED_AS)
def test_what_is_saved_reads_back(machine, tmp_path, suffix):
    skeleton = read_skeleton(PERSON)
    motion = performed(machine, of_walk(machine, 1.0), machine.style('run_16'))
    (tmp_path / 'person.asf').write_bytes(PERSON.read_bytes())
    path = tmp_path / f'person_01{suffix}'
    path.write_bytes(file_of(motion, suffix, skeleton))
    back = read_motion(path)
    here = skeleton.forward(motion if suffix != '.amc' else motion.resample(120.0))     # the rate of AMC files
    if suffix == '.bvh':    # bodies sit at their joint and not at their far end, with angles in frames of their own
        own = read_skeleton(path)
        places = own.forward(back)
        pairs = [(body.parent, own.body_names.index(body.name)) for body in skeleton.bodies
                 if body.name in own.body_names and body.parent >= 0]
        assert len(pairs) > 20
        assert max(np.abs(here[:, parent] - places[:, joint]).max() for parent, joint in pairs) < 2e-3
    else:
        assert set(motion.joint_names) <= set(back.joint_names)
        assert np.abs(here - skeleton.forward(back.joints(motion.joint_names))).max() < 2e-3


def test_other_formats_are_refused(machine):
    motion = performed(machine, of_walk(machine, 1.0), machine.style('run_16'))
    with pytest.raises(UsageError, match='saves'):
        file_of(motion, '.exe')


def test_without_viser_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'viser', None)
    assert main(['view', 'walk.npz']) == 2
    message = capsys.readouterr().err
    assert 'pip install viser==' in message and message.count('\n') == 1


@pytest.mark.parametrize('arguments, words', [
    ([], 'what should be shown'), (['a.npz', 'b.npz', 'c.npz'], 'two motions at most'),
    (['--explore', 'm.npz', '--predict', 'm.npz'], 'two pages'), (['--predict', 'm.npz'], 'one recording'),
    (['--explore', str(MACHINE)], '--skeleton')])
def test_wrong_use_is_said_in_one_line(monkeypatch, capsys, arguments, words):
    monkeypatch.setitem(sys.modules, 'viser', object())
    assert main(['view', *arguments]) == 2
    message = capsys.readouterr().err
    assert words in message and message.count('\n') == 1


def test_a_port_in_use_is_an_error_and_not_another_port():
    from style_core.view.page import need_free
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        with pytest.raises(UsageError, match='cannot serve'):
            need_free('127.0.0.1', taken.getsockname()[1])
