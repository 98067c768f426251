"""Pages of results: what they say of the data."""
import itertools
import json

from style_core.report import Report


def hash_of(files, folder):
    Report('page', 'A page', 'a command', data=files).write(folder)
    return json.loads((folder / 'page.json').read_text())['data']


def test_hash_of_the_data_depends_on_names_and_contents_alone(tmp_path):
    files = []
    for folder, text in (('train', 'one'), ('test', 'two'), ('more', 'three')):
        (tmp_path / folder).mkdir()
        files.append(tmp_path / folder / 'walking_1.txt')
        files[-1].write_text(text)
    found = [hash_of(order, tmp_path) for order in itertools.permutations(files)]
    assert all(one == found[0] for one in found) and found[0]['files'] == ['walking_1.txt'] * 3
    for one, other in zip(files, ('a', 'b', 'c')):  # the same contents in other folders
        one.rename(tmp_path / other)
        (tmp_path / f'folder_{other}').mkdir()
        (tmp_path / other).rename(tmp_path / f'folder_{other}' / 'walking_1.txt')
    moved = [tmp_path / f'folder_{name}' / 'walking_1.txt' for name in 'bca']
    assert hash_of(moved, tmp_path) == found[0]
    moved[0].write_text('changed')
    assert hash_of(moved, tmp_path) != found[0]
