"""Acclaim motion files, and the folder of real recordings."""
import numpy as np
import pytest

from style_core import datasets
from style_core.errors import MotionError
from style_core.formats import read_motion, write_motion
from style_core.formats.amc import CMU_LENGTH_M

FRAME = 'root 1 2 3 10 20 30\nlfemur -10 5 2.5\nltibia 40\n'
HEAD = '#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n'


def parse(tmp_path, text):
    path = tmp_path / 'file.amc'
    path.write_bytes(text.encode())
    return read_motion(path)


def test_degrees_and_inches_become_radians_and_metres(tmp_path):
    motion = parse(tmp_path, HEAD + '1\n' + FRAME + '2\n' + FRAME)
    assert motion.joint_names[:4] == ('root.tx', 'root.ty', 'root.tz', 'root.rx')
    assert motion.units[2:4] == ('m', 'rad')
    np.testing.assert_allclose(motion.positions[1], np.r_[np.array([1, 2, 3]) * CMU_LENGTH_M,
                                                          np.radians([10, 20, 30, -10, 5, 2.5, 40])])
    assert motion.rate_hz == 120.0


@pytest.mark.parametrize('end', ['\n', '\r\n', '\r', '\r\r\n', ' \n\n'])
def test_every_kind_of_line_end_reads_the_same(tmp_path, end):
    text = HEAD + ''.join(f'{k}\n{FRAME}' for k in range(1, 5))
    np.testing.assert_array_equal(parse(tmp_path, text.replace('\n', end)).positions, parse(tmp_path, text).positions)


def test_radians_and_a_first_number_other_than_one(tmp_path):
    motion = parse(tmp_path, ':RADIANS\n7\nltibia 0.5\n8\nltibia 0.6\n')
    np.testing.assert_array_equal(motion.positions, [[0.5], [0.6]])


def test_a_joint_left_out_is_missing_there(tmp_path):
    motion = parse(tmp_path, HEAD + '1\n' + FRAME + '2\nroot 1 2 3 10 20 30\nltibia 40\n3\n' + FRAME)
    missing = np.isnan(motion.positions)
    assert missing[1, 6:9].all() and missing.sum() == 3


@pytest.mark.parametrize('text, words', [
    ('', 'empty'),
    (HEAD, 'no frames'),
    ('hello\n', 'line 1'),
    (HEAD + '1\n', 'no joint'),
    (HEAD + '1\n' + FRAME + '1\n' + FRAME, 'line 8.*comes again'),
    (HEAD + '1\n' + FRAME + '3\n' + FRAME, 'line 8.*missing'),
    (HEAD + '1\n' + FRAME + '2\n' + FRAME[:-10], 'line 10.*breaks off'),
    (HEAD + '1\n' + FRAME + '2\nroot 1 2 3 10 20 30\n', 'line 9.*breaks off'),
    (HEAD + '1\n' + FRAME + '2\n', 'line 8.*breaks off'),
    (HEAD + '1\n' + FRAME + FRAME, 'line 8.*twice'),
    (HEAD + '1\nlfemur 1 2\n', 'line 5.*3 values'),
    (HEAD + '1\nltibia 1_0\n', 'line 5.*number'),
    (HEAD + '1\nltibia nan\n', 'line 5.*number'),
    (HEAD + '1\nltibia 1e999\n', 'line 5.*number'),
    (HEAD + '1\ntail 1\n', 'tail'),
    ('1\0\n', 'binary'),
])
def test_a_damaged_file_is_named_with_the_line(tmp_path, text, words):
    with pytest.raises(MotionError, match=words):
        parse(tmp_path, text)


def test_absent_files_folders_and_unknown_suffixes(tmp_path):
    for path, words in ((tmp_path / 'no.amc', 'exist'), (tmp_path / 'no.xyz', 'suffix')):
        with pytest.raises(MotionError, match=words):
            read_motion(path)
    (tmp_path / 'folder.amc').mkdir()
    with pytest.raises(MotionError):
        read_motion(tmp_path / 'folder.amc')


def test_what_an_amc_file_cannot_hold_is_refused_and_the_old_file_stays(tmp_path, gait):
    path = tmp_path / 'old.amc'
    path.write_text('old')
    with pytest.raises(MotionError, match='skeleton'):
        write_motion(gait, path)
    whole = parse(tmp_path, HEAD + '1\n' + FRAME)
    with pytest.raises(MotionError, match='missing'):
        write_motion(whole.replace(positions=np.where(np.arange(10) == 4, np.nan, whole.positions)), path)
    with pytest.raises(MotionError, match='lfemur'):
        write_motion(whole.select('!lfemur.rz'), path)
    assert path.read_text() == 'old'
    assert sorted(p.name for p in tmp_path.iterdir()) == ['file.amc', 'old.amc']


def test_the_rate_is_written_as_a_comment(tmp_path):
    whole = parse(tmp_path, HEAD + ''.join(f'{k}\n{FRAME}' for k in range(1, 8)))
    write_motion(whole.replace(times=whole.times * 2), tmp_path / 'b.amc')
    assert read_motion(tmp_path / 'b.amc').rate_hz == 60.0
    assert read_motion(tmp_path / 'b.amc', rate_hz=30.0).rate_hz == 30.0
    with pytest.raises(MotionError, match='resample'):
        write_motion(whole.replace(times=whole.times**2 + whole.times), tmp_path / 'b.amc')
    for rate in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(MotionError, match='positive'):
            read_motion(tmp_path / 'b.amc', rate_hz=rate)


def test_every_trial_reads_whole_and_comes_back(mocap, tmp_path):
    for row in datasets.labels():
        motion = read_motion(datasets.trial_path(row.name), rate_hz=row.rate_hz)
        assert motion.positions.shape == (row.frames, 62), row.name
        assert np.isfinite(motion.positions).all(), row.name
        if row.frames < 300:
            write_motion(motion, tmp_path / 'copy.amc')
            again = read_motion(tmp_path / 'copy.amc', rate_hz=row.rate_hz)
            assert again.joint_names == motion.joint_names
            np.testing.assert_allclose(again.positions, motion.positions, atol=1e-9)


def test_trials_are_listed_by_action_and_subject(mocap, trial):
    assert datasets.trials(action='run', subject='09') == [f'09_{n:02d}' for n in range(1, 11)]
    assert trial('08_01').rate_hz == 60.0
    assert trial('08_01').select(*datasets.BODY).n_joints == 50
    assert trial('35_23', None).rate_hz == 30.0
    with pytest.raises(MotionError, match='99_99'):
        datasets.trial('99_99')


def test_a_wrong_folder_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv('STYLE_MOCAP', str(tmp_path))
    with pytest.raises(MotionError, match='STYLE_MOCAP'):
        datasets.mocap_folder()
