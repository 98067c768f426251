"""``motion-style convert``, as a user calls it."""
import itertools

import numpy as np
import pytest

from style_core import datasets
from style_core.cli import main
from style_core.formats import read_motion, write_motion
from style_core.skeleton import read_skeleton


def convert(*words):
    return main(['convert', *map(str, words)])


def test_a_chain_through_every_format_changes_nothing(mocap, tmp_path, capsys):
    source = datasets.trial_path('09_01')
    chain = [source, tmp_path / 'a.csv', tmp_path / 'bag', tmp_path / 'b.npz', tmp_path / 'c.mcap', tmp_path / 'd.amc']
    for old, new in itertools.pairwise(chain):
        assert convert(old, new, *(() if new.suffix else ('--storage', 'sqlite3'))) == 0, capsys.readouterr().err
    first, last = read_motion(source), read_motion(chain[-1])
    np.testing.assert_allclose(last.joints(first.joint_names).positions, first.positions, atol=1e-9)
    assert last.rate_hz == first.rate_hz
    assert '148 frames, 62 joints, 120 Hz' in capsys.readouterr().out


def test_bvh_and_what_happens_in_between(mocap, tmp_path):
    source = datasets.trial_path('35_01')
    assert convert(source, tmp_path / 'a.bvh', '--rate', 60, '--start', 1, '--stop', 2, '--continuous') == 0
    motion = read_motion(tmp_path / 'a.bvh')
    assert motion.rate_hz == 60 and motion.n_frames == 60
    assert convert(tmp_path / 'a.bvh', tmp_path / 'b.bvh', '--length-unit', 0.02) == 0
    assert read_skeleton(tmp_path / 'b.bvh').length_m == 0.01
    np.testing.assert_allclose(read_motion(tmp_path / 'b.bvh', length_m=0.02).joints(['root.tx']).positions,
                               read_motion(tmp_path / 'a.bvh', length_m=0.02).joints(['root.tx']).positions, atol=1e-9)
    assert convert(source, tmp_path / 'c.csv', '--select', '*femur*', '--mirror') == 0
    mirrored = read_motion(tmp_path / 'c.csv')
    original = read_motion(source).joints(['rfemur.rx', 'rfemur.ry'])
    np.testing.assert_allclose(mirrored.joints(['lfemur.rx', 'lfemur.ry']).positions, original.positions * [1, -1])


def test_what_cannot_be_is_one_line_and_the_old_file_stays(tmp_path, gait, capsys):
    write_motion(gait, tmp_path / 'a.csv')
    old = tmp_path / 'old.amc'
    old.write_text('precious')
    for words in ((tmp_path / 'a.csv', old), (tmp_path / 'a.csv', tmp_path / 'x.bvh'), (tmp_path / 'no.csv', old),
                  (tmp_path / 'a.csv', tmp_path / 'b.csv', '--select', 'tail*'), (old, tmp_path / 'b.csv'),
                  (tmp_path / 'a.csv', tmp_path / 'b.csv', '--mirror'),
                  (tmp_path / 'a.csv', tmp_path / 'b.csv', '--start', 100),
                  (tmp_path / 'a.csv', tmp_path / 'b.csv', '--storage', 'mcap')):
        assert convert(*words) == 1
        assert capsys.readouterr().err.count('\n') == 1
    assert old.read_text() == 'precious'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a.csv', 'old.amc']
    with pytest.raises(SystemExit) as end:
        convert(tmp_path / 'a.csv')
    assert end.value.code == 2


def test_missing_values_are_reported(tmp_path, gait, capsys):
    values = gait.positions.copy()
    values[3:5, 2] = np.nan
    write_motion(gait.replace(positions=values), tmp_path / 'a.csv')
    assert convert(tmp_path / 'a.csv', tmp_path / 'bag', '--storage', 'sqlite3') == 0
    assert '2 values missing' in capsys.readouterr().out
