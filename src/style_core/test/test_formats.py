"""BVH, tables and archives: what they mean, what they refuse, and round trips of every recording there is."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core import datasets
from style_core.errors import MotionError
from style_core.formats import read_motion, skeleton_of, write_motion
from style_core.motion import Motion
from style_core.skeleton import read_skeleton

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 90 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT LeftUpLeg
  {
    OFFSET 10 0 0
    CHANNELS 3 Yrotation Xrotation Zrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
1 2 3 10 20 30 5 6 7
1 2 3 11 21 31 5 6 8
"""


def put(tmp_path, text, name):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_bvh_means_what_its_channels_say(tmp_path):
    path = put(tmp_path, BVH, 'a.bvh')
    motion, skeleton = read_motion(path), read_skeleton(path)
    assert motion.joint_names[3:] == ('Hips.rz', 'Hips.rx', 'Hips.ry', 'LeftUpLeg.ry', 'LeftUpLeg.rx', 'LeftUpLeg.rz')
    assert motion.rate_hz == 100.0 and motion.units[:4] == ('m', 'm', 'm', 'rad')
    hips = Rotation.from_euler('ZXY', [10, 20, 30], degrees=True)  # upper case: each about the turned axes
    leg = hips * Rotation.from_euler('YXZ', [5, 6, 7], degrees=True)
    place = np.array([0.01, 0.02, 0.03])  # a position takes the place of OFFSET
    joint = place + hips.apply([0.1, 0, 0])
    np.testing.assert_allclose(skeleton.forward(motion)[0], [place, joint, joint + leg.apply([0, -0.4, 0])], atol=1e-12)
    assert skeleton.body_names[-1] == 'LeftUpLeg_end'
    loose = put(tmp_path, BVH.replace('MOTION', '\n MOTION \n').replace('Frames: 2', '\nFrames:\t2 \n\n')
                .replace('End Site', 'End site').replace('{', ' {\n'), 'b.bvh')
    np.testing.assert_array_equal(read_motion(loose).positions, motion.positions)
    assert skeleton.orders == {'Hips': 'YXZ', 'LeftUpLeg': 'ZXY'}


def test_bvh_comes_back_as_it_was_and_inches_are_possible(tmp_path):
    path = put(tmp_path, BVH.replace('\n', '\r\n'), 'a.bvh')
    motion = read_motion(path, length_m=0.0254)
    skeleton = read_skeleton(path, 0.0254)
    write_motion(motion, tmp_path / 'b.bvh', skeleton, length_m=0.0254)
    again = read_motion(tmp_path / 'b.bvh', length_m=0.0254)
    assert again.joint_names == motion.joint_names
    np.testing.assert_allclose(again.positions, motion.positions, atol=1e-9)
    np.testing.assert_allclose(read_skeleton(tmp_path / 'b.bvh', 0.0254).rest()[0], skeleton.rest()[0], atol=1e-9)
    with pytest.raises(MotionError, match='length unit'):
        read_skeleton(tmp_path / 'x.asf', 0.01)


@pytest.mark.parametrize('change, words', [
    (('HIERARCHY', 'TREE'), 'HIERARCHY'), (('MOTION', ''), 'cannot stand|MOTION'),
    (('Frames: 2', 'Frames: 3'), '3 frames'),
    (('Frame Time: 0.01', 'Frame Time: 0'), 'positive'), (('5 6 8', '5 6'), 'line 20.*breaks off'),
    (('5 6 7', '5 x 7'), 'number'), (('5 6 7', '5 nan 7'), 'line 19'), (('OFFSET 10 0 0', 'OFFSET 10 0'), 'OFFSET'),
    (('CHANNELS 3', 'CHANNELS 2'), 'Zrotation'), (('Yrotation Xrotation', 'Xrotation Xrotation'), 'CHANNELS'),
    (('JOINT LeftUpLeg', 'JOINT Hips'), 'name'), (('    OFFSET 10 0 0\n', ''), 'no OFFSET'),
    (('  }\n}\nMOTION', '  }\nMOTION'), 'closed'), (('{\n  OFFSET 0 90', 'OFFSET 0 90'), 'OFFSET'),
])
def test_a_damaged_bvh_is_refused_with_the_reason(tmp_path, change, words):
    assert change[0] in BVH
    with pytest.raises(MotionError, match=words):
        read_motion(put(tmp_path, BVH.replace(*change), 'a.bvh'))


def test_what_a_bvh_cannot_hold_is_refused(tmp_path, gait):
    path = put(tmp_path, BVH, 'a.bvh')
    motion, skeleton = read_motion(path), read_skeleton(path)
    holed = np.where(np.arange(9) == 4, np.nan, motion.positions)
    uneven = Motion(motion.joint_names, np.zeros((3, 9)), [0, 0.01, 0.05], motion.units)
    for bad, tree, words in ((motion, None, 'skeleton'), (motion.replace(positions=holed), skeleton, 'missing'),
                             (uneven, skeleton, 'resample'), (motion.slice(0, 0.005), skeleton, 'two frames'),
                             (gait, skeleton, 'left_hip')):
        with pytest.raises(MotionError, match=words):
            write_motion(bad, tmp_path / 'out.bvh', tree)
    assert not (tmp_path / 'out.bvh').exists()


def test_acclaim_recordings_keep_their_poses_in_bvh(trial, tmp_path):
    for name in ('35_01', '131_09'):
        motion, skeleton = trial(name), datasets.skeleton(name)
        for part in (motion, motion.select(*datasets.BODY)):
            write_motion(part, tmp_path / 'a.bvh', skeleton)
            again, tree = read_motion(tmp_path / 'a.bvh'), read_skeleton(tmp_path / 'a.bvh')
            ends = {body.parent: index for index, body in enumerate(tree.bodies)}  # any child sits at the bone's end
            columns = [ends[tree.body_names.index(body)] for body in skeleton.body_names]
            np.testing.assert_allclose(tree.forward(again)[:, columns], skeleton.forward(part), atol=1e-7)
            assert again.n_joints < 3 * len(skeleton.bodies) and abs(again.rate_hz - 60) < 1e-6


def test_tables_take_units_gaps_and_any_separator(tmp_path):
    text = '# made\nTime; hip [deg] ;root.tx;knee [rad];slide [m]\n0;90;1.5;;2\n0.1; -45 ;nan;1;2\n'
    path = put(tmp_path, text.replace('\n', '\r\n'), 'a.csv')
    motion = read_motion(path)
    assert motion.joint_names == ('hip', 'root.tx', 'knee', 'slide') and motion.units == ('rad', 'm', 'rad', 'm')
    np.testing.assert_allclose(motion.positions, [[np.pi / 2, 1.5, np.nan, 2], [-np.pi / 4, np.nan, 1, 2]])


@pytest.mark.parametrize('text, words', [
    ('time,a\n', 'empty'), ('a,b\n0,1\n', 'time'), ('time\n0\n', 'time'), ('time,a\n1,1\n\n0,2\n', 'line 4'),
    ('time,a\n0,1,2\n', 'line 2 has 3'), ('time,a\n0,x\n', "line 2: 'x'"), ('time,a,a\n0,1,1\n', 'more than once'),
    ('time,a,\n0,1,1\n', 'no name'), ('time,a\n,1\n', 'finite'), ('time,a\n0,inf\n', 'infinite'),
    ('time,a\n0,1_0\n', '1_0'), ('#\n', 'no header'),
])
def test_a_damaged_table_is_refused_with_the_line(tmp_path, text, words):
    with pytest.raises(MotionError, match=words):
        read_motion(put(tmp_path, text, 'a.csv'))


def test_tables_and_archives_come_back_bit_for_bit(tmp_path, gait):
    values = gait.positions.copy()
    values[3, 2] = np.nan
    motion = gait.replace(positions=values, times=gait.times * 1.1 + 1e-3, units=('m',) + gait.units[1:],
                          joint_names=('left, hip',) + gait.joint_names[1:], epoch_ns=1_700_000_000_123_456_789)
    for name in ('a.csv', 'a.npz'):
        write_motion(motion, tmp_path / name)
        again = read_motion(tmp_path / name)
        assert again.joint_names == motion.joint_names and again.units == motion.units
        np.testing.assert_array_equal(again.positions, motion.positions)
        np.testing.assert_array_equal(again.times, motion.times)
    assert again.epoch_ns == motion.epoch_ns and again.name == motion.name
    for bad in ('a"b', 'a [m]', ' a'):
        with pytest.raises(MotionError, match='header'):
            write_motion(gait.replace(joint_names=(bad,) + gait.joint_names[1:]), tmp_path / 'b.csv')


def test_archives_that_are_no_motion_are_refused(tmp_path):
    path = tmp_path / 'a.npz'
    good = {'joint_names': np.array(['a']), 'positions': np.zeros((2, 1)), 'times': np.arange(2.0)}
    for change, words in (({'positions': np.array([['x'], ['y']])}, 'type'), ({'units': np.array('rad')}, 'lists'),
                          ({'positions': np.array([[None], [1]], dtype=object)}, 'readable'),
                          ({'name': np.array(['a', 'b'])}, 'single'), ({'times': np.zeros(2)}, 'increase')):
        np.savez(path, **dict(good, **change))
        with pytest.raises(MotionError, match=words):
            read_motion(path)
    np.savez(path, a=np.zeros(2))
    with pytest.raises(MotionError, match='lacks'):
        read_motion(path)
    path.write_bytes(b'PK\x03\x04 broken')
    with pytest.raises(MotionError, match='readable'):
        read_motion(path)


def test_every_recording_survives_every_format(mocap, tmp_path):
    for row in datasets.labels():
        motion = read_motion(datasets.trial_path(row.name), rate_hz=row.rate_hz).slice(0, 0.3)
        for name in ('a.csv', 'a.npz', 'a.amc'):
            write_motion(motion, tmp_path / name)
            options = {'rate_hz': row.rate_hz} if name == 'a.amc' else {}
            again = read_motion(tmp_path / name, **options)
            assert again.joint_names == motion.joint_names and again.units == motion.units, row.name
            np.testing.assert_allclose(again.positions, motion.positions, atol=1e-9)
            np.testing.assert_allclose(again.times, motion.times, atol=1e-9)


def test_the_benchmark_rows_survive_a_table(mocap, tmp_path):
    for split in ('train', 'test'):
        for action in ('walking', 'running', 'jumping'):
            for name, rows in datasets.cmu8(split, action):
                motion = Motion([f'c{k}' for k in range(117)], rows[:60], np.arange(len(rows[:60])) / 120, name=name)
                write_motion(motion, tmp_path / 'a.csv')
                np.testing.assert_array_equal(read_motion(tmp_path / 'a.csv').positions, rows[:60])


def test_the_skeleton_beside_or_in_a_file_is_found(tmp_path, mocap):
    assert skeleton_of(datasets.trial_path('35_01')).name == '35'
    assert skeleton_of(put(tmp_path, BVH, 'a.bvh')).channel_names[0] == 'Hips.tx'
    assert skeleton_of(tmp_path / 'b.amc') is None
    (tmp_path / 'other.asf').write_bytes((mocap / 'cmu/35/35.asf').read_bytes())
    assert skeleton_of(tmp_path / 'b.amc').name == 'other'
    assert skeleton_of(tmp_path / 'c.csv') is None


def test_options_that_mean_nothing_are_refused(tmp_path):
    with pytest.raises(MotionError, match='topic'):
        read_motion(put(tmp_path, BVH, 'a.bvh'), topic='/x')
