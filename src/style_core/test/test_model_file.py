"""Model files of every kind: what is written can be read, what is damaged is refused, an old file is never lost."""
import json
import os
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
from made_models import KINDS, LOADERS

from style_core import model_file
from style_core.cli import main
from style_core.cli.registry import TRAINERS
from style_core.errors import ModelError
from style_core.model_schema import KINDS as CHECKED
from style_core.motion import Motion


def changed(path, to, header=None, arrays=None):
    """Write a copy with other contents but the old checksum, as a tool that knows nothing of it would."""
    with np.load(path) as archive:
        old = json.loads(str(archive['header_json'][()]))
        parts = {name: archive[name] for name in archive.files if name != 'header_json'}
    np.savez_compressed(to, header_json=np.array(json.dumps({**old, **(header or {})})), **{**parts, **(arrays or {})})


def test_every_kind_that_can_be_trained_is_checked():
    assert set(KINDS) == set(CHECKED) == set(TRAINERS)


@pytest.mark.parametrize('kind', KINDS)
def test_renamed_or_reordered_joints_and_changed_numbers_are_found(models, kind, tmp_path):
    path, other = models[kind], tmp_path / 'other.npz'
    header, arrays = model_file.load_model(path, kind)
    names = header['joint_names']
    name = max((name for name in arrays if arrays[name].dtype.kind == 'f'), key=lambda name: arrays[name].size)
    tilted = arrays[name].copy()
    tilted.flat[0] = np.nextafter(tilted.flat[0], np.inf, dtype=tilted.dtype)
    for spoiled in ({'header': {'joint_names': names[::-1]}}, {'header': {'joint_names': ['other', *names[1:]]}},
                    {'header': {'rate_hz': 61.0}}, {'arrays': {name: tilted}}, {'arrays': {'extra': np.zeros(2)}}):
        changed(path, other, **spoiled)
        with pytest.raises(ModelError, match='checksum'):
            LOADERS[kind](other)


@pytest.mark.parametrize('kind', KINDS)
def test_a_file_from_before_checksums_loads(models, kind, tmp_path):
    header, arrays = model_file.load_model(models[kind])
    np.savez_compressed(tmp_path / 'old.npz', header_json=np.array(json.dumps(header)), **arrays)
    assert LOADERS[kind](tmp_path / 'old.npz') is not None


@pytest.mark.parametrize('kind', KINDS)
def test_no_damage_ends_in_anything_but_one_clear_error(models, kind, tmp_path):
    """Every array lost, cut, turned, emptied, of another type, with a wild value; every entry of the header changed."""
    header, arrays = model_file.load_model(models[kind])
    header.pop('checksum', None)
    outcomes = {'refused': 0, 'taken': 0}

    def attempt(header, arrays):
        model_file.write_archive(tmp_path / 'damaged.npz', header, arrays)
        try:
            LOADERS[kind](tmp_path / 'damaged.npz')
            outcomes['taken'] += 1
        except ModelError as error:
            assert '\n' not in str(error) and str(error)
            outcomes['refused'] += 1

    for name, array in arrays.items():
        damages = [None, array[:-1] if array.ndim else array, array[..., None], np.zeros(0), array.astype(str)]
        if array.ndim > 1:
            damages.append(np.swapaxes(array, 0, 1))
        if array.size and array.dtype.kind == 'f':
            for wild in (np.nan, np.inf):
                spoiled = array.copy()
                spoiled.flat[array.size // 2] = wild
                damages.append(spoiled)
        for damaged in damages:
            rest = {key: value for key, value in arrays.items() if key != name}
            attempt(header, rest if damaged is None else {**rest, name: damaged})
    for key in header:
        for value in (None, -1, 'x', [], {}, ['x'], 1e308):
            attempt({**header, key: value}, arrays)
        attempt({other: value for other, value in header.items() if other != key}, arrays)
    assert outcomes['refused'] > 2 * len(arrays)


@pytest.mark.parametrize('kind', KINDS)
def test_damaged_arrays_are_not_written_over_a_good_file(models, kind, tmp_path):
    path = tmp_path / 'good.npz'
    path.write_bytes(Path(models[kind]).read_bytes())
    before = path.read_bytes()
    header, arrays = model_file.load_model(path)
    name = next(name for name in arrays if arrays[name].dtype.kind == 'f' and arrays[name].size)
    with pytest.raises(ModelError, match='not written'):
        model_file.save_model(path, kind, header, {**arrays, name: arrays[name] * np.nan})
    with pytest.raises(ModelError, match='not finite'):
        model_file.save_model(path, kind, {**header, 'rate_hz': float('nan')}, arrays)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_training_that_fails_leaves_the_old_file(tmp_path, capsys):
    """Three recordings with one step each: residuals that are nothing, or refused before; never a file of no use."""
    from style_core.formats import write_motion
    files = []
    for k in range(3):
        y = np.zeros((60, 3))
        y[30:] = 0.5 + 0.1 * k
        write_motion(Motion(('a', 'b', 'c'), y, np.arange(60) / 60.0, name=f'p{k}_1'), tmp_path / f'p{k}_1.csv')
        files.append(str(tmp_path / f'p{k}_1.csv'))
    old = tmp_path / 'model.npz'
    for kind in ('phase-style', 'style-machine', 'locomotion'):
        old.write_bytes(b'the old file')
        status = main(['train', kind, *files, '-o', str(old), *(['--styles', '1'] if kind == 'locomotion' else [])])
        said = capsys.readouterr()
        if status:
            assert status == 1 and old.read_bytes() == b'the old file', said
            assert said.err.strip().splitlines()[-1].startswith('motion-style train: ')
        else:
            LOADERS[kind](old)


@pytest.mark.parametrize('umask, mode', [(0o077, 0o600), (0o027, 0o640), (0o022, 0o644)])
def test_private_files_stay_private(models, tmp_path, umask, mode):
    header, arrays = model_file.load_model(models['locomotion'])
    path = tmp_path / 'model.npz'
    before = os.umask(umask)
    try:
        model_file.save_model(path, 'locomotion', header, arrays)
        assert stat.S_IMODE(path.stat().st_mode) == mode
        path.chmod(0o600)
        os.umask(0)
        model_file.save_model(path, 'locomotion', header, arrays)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    finally:
        os.umask(before)


def test_a_symbolic_link_is_written_through(models, tmp_path):
    header, arrays = model_file.load_model(models['locomotion'])
    (tmp_path / 'shelf').mkdir()
    link = tmp_path / 'model.npz'
    link.symlink_to(tmp_path / 'shelf' / 'real.npz')
    model_file.save_model(link, 'locomotion', header, arrays)
    assert link.is_symlink() and zipfile.is_zipfile(tmp_path / 'shelf' / 'real.npz')


def test_a_model_knows_the_files_it_was_trained_on(tmp_path):
    (tmp_path / 'bag').mkdir()
    for name in ('a.csv', 'bag/part'):
        (tmp_path / name).write_text(name)
    header = {'training_files': model_file.training_files([tmp_path / 'a.csv', tmp_path / 'bag'])}
    (tmp_path / 'copy.csv').write_text('a.csv')
    assert all(model_file.was_trained_on(header, tmp_path / name) for name in ('copy.csv', 'bag'))
    (tmp_path / 'copy.csv').write_text('a.csv.')
    assert not model_file.was_trained_on(header, tmp_path / 'copy.csv')
    assert not model_file.was_trained_on({}, tmp_path / 'copy.csv')
