"""What comes from outside has bounds: files, YAML, archives, texts that are printed."""
import bz2
import io
import itertools
import os
import struct
import threading
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from style_core import archive, budgets, yaml_file
from style_core.archive import read_archive
from style_core.errors import ModelError, MotionError, UsageError
from style_core.formats import read_motion
from style_core.model_file import load_model, save_model
from style_core.motion import matching_names
from style_core.regular_file import read_regular
from style_core.stream.joint_map import read_joint_map
from style_core.synthesis.retargeting import read_robot
from style_core.text import fitting, shown
from style_core.yaml_file import read_yaml


@given(st.text(max_size=200), st.integers(1, 80))
def test_what_is_shown_is_short_and_on_one_line(text, most):
    out = shown(text, most)
    assert len(out) <= 10 * most + 30
    assert len(out.splitlines()) <= 1 and '\x1b' not in out and '\x7f' not in out
    out.encode()


@given(st.lists(st.text(max_size=100), max_size=50), st.integers(20, 500))
def test_names_one_after_the_other_fit(names, most):
    assert len(fitting(names, most)) <= most + 20


@pytest.mark.parametrize('kind', [MotionError, ModelError, UsageError])
def test_no_error_message_is_long_or_forges_a_line(kind):
    message = str(kind('x\n[ERROR] forged \x1b[31m\u2028' + 'y' * 10**6))
    assert len(message) < 1100 and message.isprintable()


@pytest.mark.parametrize('patterns', [['[' * 20_000], ['*a' * 200], ['a'] * 513,
                                      [f'{"x" * 250}{n}' for n in range(200)],
                                      ['\ud800' * 300]])
def test_patterns_beyond_the_budgets_are_refused(patterns):
    with pytest.raises(MotionError, match='refused'):
        matching_names(['a', 'b'], patterns)


BOMB = 'joints: {' + 'a: &a0 [x, x, x, x, x, x, x, x, x, x], ' + \
    ', '.join(f'b{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]' for n in range(1, 9)) + '}'


@pytest.mark.parametrize('text', [
    BOMB, '[' * 100_000, 'joints: ' + '[' * 40 + ']' * 40, '&a [*a, *a]', '- x\n' * 6000,
    'joints: {a: "' + 'x' * 300_000,
    '{' * 5000, 'a: &a {b: c}\n' + ''.join(f'k{n}: {{<<: [*a, *a]}}\n' for n in range(900)), '\x00', '? [a]\n: b',
    'a: 2021-99-99', '!!python/object/apply:os.system [true]', '*nothing'], ids=itertools.count())
@pytest.mark.parametrize('read', [read_joint_map, read_robot])
def test_yaml_that_grows_is_refused_in_few_words_and_little_memory(tmp_path, text, read, monkeypatch):
    monkeypatch.setattr(yaml_file, 'YAML_NODES', 5000)
    path = tmp_path / 'joints.yaml'
    path.write_text(text)
    tracemalloc.start()
    try:
        with pytest.raises(ModelError) as caught:
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 1100 and str(caught.value).isprintable()


def test_yaml_with_honest_aliases_is_read(tmp_path):
    path = tmp_path / 'joints.yaml'
    path.write_text('joints:\n  a: &rule {robot: left, scale: 2.0}\n  b: {<<: *rule, robot: right}\n')
    assert read_joint_map(path).rules['b'].scale == 2.0


@pytest.fixture
def not_files(tmp_path):
    """A FIFO, a folder, a device, a socket's place in the file system."""
    os.mkfifo(tmp_path / 'fifo.npz')
    (tmp_path / 'folder.npz').mkdir()
    os.symlink('/dev/zero', tmp_path / 'zero.npz')
    os.symlink('/dev/tty', tmp_path / 'tty.npz')
    return [tmp_path / name for name in ('fifo.npz', 'folder.npz', 'zero.npz', 'tty.npz')]


@pytest.mark.parametrize('read', [load_model, read_motion, lambda path: read_yaml(path, 'map'), read_joint_map])
def test_only_regular_files_are_read_and_none_is_waited_for(not_files, read):
    failures = []

    def all_of_them():
        for path in not_files:
            with pytest.raises((ModelError, MotionError)) as caught:
                read(path)
            failures.append(str(caught.value))
    thread = threading.Thread(target=all_of_them, daemon=True)
    thread.start()
    thread.join(30.0)
    assert len(failures) == 4, 'it waits for the other end'


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / 'large'
    with open(path, 'wb') as stream:
        stream.truncate(1 << 40)    # a hole, as large as a disk
    with pytest.raises(ValueError, match='at most'):
        read_regular(path, 1000)


def zipped(path, parts, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, 'w', method) as made:
        for name, data in parts.items():
            made.writestr(name, data)
    return path


def array_bytes(values):
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def bomb(path, size=130 << 20):
    """A few MB that NumPy unpacks to half a gigabyte: arrays of zeros."""
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED, compresslevel=1) as made:
        for k in range(4):
            with made.open(f'a{k}.npy', 'w', force_zip64=True) as stream:
                stream.write(array_bytes(np.zeros(size // 8))[:128])
                for _ in range(size >> 20):
                    stream.write(bytes(1 << 20))
    return path


def lying_size(path, data, size):
    """An archive whose directory and local head give another size than there is."""
    zipped(path, {'a.npy': data})
    raw = bytearray(path.read_bytes())
    for mark, offset in ((b'PK\x03\x04', 22), (b'PK\x01\x02', 24)):
        at = raw.index(mark)
        raw[at + offset:at + offset + 4] = struct.pack('<I', size)
    path.write_bytes(raw)
    return path


def peak_of(call):
    tracemalloc.start()
    try:
        with pytest.raises((ValueError, ModelError)) as caught:
            call()
        return tracemalloc.get_traced_memory()[1], str(caught.value)
    finally:
        tracemalloc.stop()


def test_a_zip_bomb_is_refused_unread(tmp_path):
    path = bomb(tmp_path / 'bomb.npz')
    assert path.stat().st_size < 4 << 20
    peak, message = peak_of(lambda: load_model(path))
    assert peak < 8 << 20 and 'unpacked' in message


@pytest.mark.parametrize('size', [0, 100, 5000, 2**32 - 2])
def test_a_directory_that_lies_about_the_size_gains_nothing(tmp_path, size, monkeypatch):
    monkeypatch.setattr(archive, 'UNPACKED_BYTES', 2**33)       # so that reading begins
    path = lying_size(tmp_path / 'liar.npz', array_bytes(np.zeros(1 << 21)), size)
    peak, _ = peak_of(lambda: load_model(path))
    assert peak < 80 << 20      # the 16 MB there are, a few times


def test_an_array_head_that_lies_about_the_shape_allocates_nothing(tmp_path):
    data = array_bytes(np.zeros(100))
    for shape in ('(99999999999,)', '(10**9,)', '(-1,)', '(2**70, 2**70)', '(100, 100, 100)', '(1.5,)', '("a",)',
                  '[[[['):
        lie = data[:10] + data[10:128].replace(b'(100,)', shape.encode()).ljust(200)[:118] + data[128:]
        path = zipped(tmp_path / 'liar.npz', {'a.npy': lie})
        peak, _ = peak_of(lambda path=path: load_model(path))
        assert peak < 4 << 20, shape


def test_other_packers_and_objects_and_namesakes_are_refused(tmp_path):
    path = tmp_path / 'a.npz'
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        zipped(path, {'a.npy': bytes(1 << 20)}, method)
        assert 'packed otherwise' in peak_of(lambda: load_model(path))[1]
    with pytest.warns(UserWarning), zipfile.ZipFile(path, 'w') as made:
        made.writestr('a.npy', array_bytes(np.zeros(1)))
        made.writestr('a.npy', array_bytes(np.ones(1)))
    assert 'same name' in peak_of(lambda: load_model(path))[1]
    stream = io.BytesIO()
    np.save(stream, np.array([{}], dtype=object), allow_pickle=True)
    assert 'objects' in peak_of(lambda: load_model(zipped(path, {'a.npy': stream.getvalue()})))[1]
    path.write_bytes(bz2.compress(b'x'))
    assert 'not a readable model file' in peak_of(lambda: load_model(path))[1]


def test_what_numpy_writes_is_read_bit_for_bit(tmp_path):
    """NumPy is the judge."""
    arrays = {'f': np.random.default_rng(0).normal(size=(3, 4, 5)), 'i': np.arange(7), 'b': np.array([True, False]),
              'u': np.array(['a', 'bcd']), 's': np.float32(1.5), 'o': np.asfortranarray(np.ones((2, 3))),
              'e': np.zeros((0, 3)),
              'big': np.arange(3, dtype='>f8')}
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / 'a.npz', **arrays)
        read = read_archive(tmp_path / 'a.npz')
        with np.load(tmp_path / 'a.npz') as judge:
            assert set(read) == set(judge.files)
            for name in judge.files:
                np.testing.assert_array_equal(read[name], judge[name])
                assert read[name].dtype == judge[name].dtype
                assert read[name].flags.f_contiguous == judge[name].flags.f_contiguous
    assert set(read_archive(tmp_path / 'a.npz', ('i',))) == {'i'}


def test_damage_anywhere_in_a_model_file_is_an_error_or_nothing(tmp_path):
    path = tmp_path / 'model.npz'
    save_model(path, 'test', {'joint_names': ['a']}, {'x': np.arange(50.0)})
    whole, random = path.read_bytes(), np.random.default_rng(1)
    for _ in range(600):
        data = bytearray(whole[:random.integers(1, len(whole) + 1)])
        for at in random.integers(0, len(data), random.integers(0, 3)):
            data[at] = random.integers(256)
        path.write_bytes(data)
        try:
            _, arrays = load_model(path)
        except ModelError:
            continue
        np.testing.assert_array_equal(arrays['x'], np.arange(50.0))     # the checksum of the archive holds


def test_the_table_of_budgets_names_every_budget():
    numbers = {name: getattr(budgets, name) for name in dir(budgets) if name.isupper() and name != 'TABLE'}
    text = ' '.join(part for row in budgets.TABLE for part in row[:2])
    for name, value in numbers.items():
        if name == 'ARRAY_HEADER_BYTES':
            continue
        assert f'{value:g}' in text or f'{value}' in text or f'{value // (1 << 20)} MiB' in text, name


def test_the_documentation_shows_the_budgets_as_they_are():
    page = Path(__file__).resolve().parents[3] / 'docs' / 'strangers.md'
    assert budgets.markdown() in page.read_text()
