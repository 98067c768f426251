"""A file that is called by its name: where it is looked for, and what is said where it is not."""
from pathlib import Path

import pytest

from style_core.errors import ModelError
from style_core.places import find_file, shipped_folder

KINDS = {'model': 'models', 'joint map': 'joint_maps', 'robot': 'robots', 'chain': 'servo'}


@pytest.fixture
def suite(tmp_path, monkeypatch):
    """A sourced workspace with one shipped file of every kind; the working folder is an empty one beside it."""
    for kind, folder in KINDS.items():
        place = tmp_path / 'prefix' / 'share' / 'style_bringup' / 'config' / folder
        place.mkdir(parents=True)
        (place / ('walk.npz' if kind == 'model' else 'walker.yaml')).write_text('shipped')
    (tmp_path / 'here').mkdir()
    monkeypatch.chdir(tmp_path / 'here')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}/other:{tmp_path}/prefix')
    return tmp_path / 'prefix' / 'share' / 'style_bringup' / 'config'


@pytest.mark.parametrize('kind', KINDS)
def test_a_name_is_looked_for_here_and_then_among_the_shipped_files(suite, kind):
    name = 'walk.npz' if kind == 'model' else 'walker.yaml'
    assert find_file(name, kind) == str(suite / KINDS[kind] / name)
    Path(name).write_text('own')
    assert find_file(name, kind) == name


def test_the_message_names_both_places_and_what_may_have_been_meant(suite):
    with pytest.raises(ModelError) as error:
        find_file('wakl.npz', 'model')
    for part in ('wakl.npz does not exist', str(Path.cwd()), str(suite / 'models'), 'did you mean walk.npz?'):
        assert part in str(error.value)
    with pytest.raises(ModelError, match=r'there: walker\.yaml'):
        find_file('zzz', 'chain')


def test_a_folder_that_is_given_is_the_only_place(suite, tmp_path):
    (tmp_path / 'mine').mkdir()
    with pytest.raises(ModelError, match=r'mine/walk\.npz does not exist'):
        find_file('walk.npz', 'model', tmp_path / 'mine')
    (tmp_path / 'mine' / 'walk.npz').write_text('')
    assert find_file('walk.npz', 'model', tmp_path / 'mine') == str(tmp_path / 'mine' / 'walk.npz')


def test_an_absolute_path_is_taken_as_it_is(suite, tmp_path):
    assert find_file(suite / 'models' / 'walk.npz', 'model', tmp_path) == str(suite / 'models' / 'walk.npz')
    with pytest.raises(ModelError, match=r'absent/walk\.npz does not exist$'):
        find_file('/absent/walk.npz', 'model')


def test_what_cannot_be_looked_at_is_left_to_the_reader(suite):
    Path('loop.npz').symlink_to('loop.npz')
    assert find_file('loop.npz', 'model') == 'loop.npz'


def test_without_a_sourced_workspace_the_files_of_the_checkout_count(monkeypatch, tmp_path):
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.chdir(tmp_path)
    folder = shipped_folder('model')
    if folder is None:
        pytest.skip('installed without the suite')
    assert Path(find_file('locomotion.npz', 'model')) == folder / 'locomotion.npz'


def test_where_nothing_is_installed_it_is_said(monkeypatch, tmp_path):
    import style_core.places
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.setattr(style_core.places, '__file__', str(tmp_path / 'a' / 'b.py'))
    with pytest.raises(ModelError, match='no sourced workspace'):
        find_file('walk.npz', 'model')
