"""The bench command: what it offers exists, and what it cannot do it says."""
import fcntl
from pathlib import Path

import pytest

from style_core import cli
from style_core.cli import bench

ROOT = next((folder for folder in Path(bench.__file__).resolve().parents if (folder / 'benchmarks').is_dir()), None)


@pytest.mark.skipif(ROOT is None, reason='needs a checkout with benchmarks/experiments')
def test_every_table_has_its_script_with_a_main():
    for tables in bench.AREAS.values():
        for script, what in tables.values():
            source = (ROOT / 'benchmarks' / 'experiments' / f'{script}.py').read_text()
            assert 'def main(argv=None):' in source and what


def test_unknown_tables_are_named(capsys):
    assert cli.main(['bench', 'prediction', '--table', '1', '--table', '99']) == 2
    assert '99' in capsys.readouterr().err


@pytest.mark.skipif(ROOT is None, reason='needs a checkout with benchmarks/experiments')
def test_two_benches_do_not_write_the_same_pages(mocap, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(bench, '_checkout', lambda: tmp_path)
    (tmp_path / '.cache').mkdir()
    with open(tmp_path / '.cache' / 'bench_prediction.lock', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert cli.main(['bench', 'prediction', '--table', 'bars', '-o', str(tmp_path)]) == 2
    assert 'another' in capsys.readouterr().err
