"""Formats of other programs: each against an independent reader, a published specification or a real file."""
import csv
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core.angles import matrices_of
from style_core.cli import main, recordings
from style_core.errors import MotionError
from style_core.formats import FORMATS, carried, read_motion, skeleton_of, write_motion, written_suffixes
from style_core.recordings import read_recording, read_recordings
from style_core.skeleton import read_skeleton

WILD = Path(__file__).resolve().parents[4] / 'shared' / 'wild'
MOT = ('Coordinates\nversion=1\nnRows=3\nnColumns=4\ninDegrees=yes\n\nUnits are S.I. units\n\nendheader\n'
       'time\thip_flexion_r\tknee_angle_r\tpelvis_tx\n 0.00\t10\t-90\t0.5\n 0.01\t20\t-80\t0.6\n 0.02\t30\t-70\t0.7\n')


def quietly(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return read_recording(path, **options)


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


# ---------------------------------------------------------------------------------------------- what formats say

@pytest.mark.parametrize('suffix', FORMATS)
def test_a_format_says_what_it_carries(suffix, tmp_path):
    said = carried(tmp_path / f'a{suffix}')
    assert said['skeleton'] in ('inside', 'beside', None) and said['channels'] and isinstance(said['has_units'], bool)
    assert said['written'] == (suffix in written_suffixes()) or not suffix
    assert skeleton_of(tmp_path / f'a{suffix}') is None


@pytest.mark.parametrize('suffix, way', [('.c3d', 'inverse kinematics'), ('.trc', r'OpenSim .*\.mot'),
                                         ('.fbx', r'Blender .*\.bvh'), ('.xml', r'MJCF.*\.urdf'),
                                         ('.xacro', 'xacro robot.urdf.xacro'), ('.pkl', r'\.npz')])
def test_formats_that_are_not_read_say_how_to_get_there(tmp_path, suffix, way, capsys):
    path = written(tmp_path, f'a{suffix}', 'x')
    for read in (read_recording, read_skeleton):
        with pytest.raises(MotionError, match=way):
            read(path)
    assert main(['info', str(path)]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_format_that_is_only_read_is_not_written(tmp_path, gait):
    with pytest.raises(MotionError, match='read only'):
        write_motion(gait, tmp_path / 'a.mot')
    write_motion(gait, tmp_path / 'a.npz')
    assert main(['convert', str(tmp_path / 'a.npz'), str(tmp_path / 'a.mot')]) == 2


# ---------------------------------------------------------------------------------------------- OpenSim

@pytest.mark.parametrize('name', ['subject01_walk1_ik', 'subject01_walk_IK'])
def test_real_files_of_opensim_are_read_as_numpy_reads_them(name):
    path = WILD / 'opensim' / f'{name}.mot'
    if not path.is_file():
        pytest.skip('no recordings of others here')
    head = path.read_text().splitlines().index('endheader')
    theirs = np.genfromtxt(path, skip_header=head + 1, names=True)
    motion = quietly(path)
    assert motion.joint_names == theirs.dtype.names[1:] and motion.rate_hz == pytest.approx(60, rel=1e-6)
    np.testing.assert_array_equal(motion.times, theirs['time'])
    for column, joint in enumerate(motion.joint_names):
        length = joint in ('pelvis_tx', 'pelvis_ty', 'pelvis_tz')
        assert motion.units[column] == ('m' if length else 'rad')
        np.testing.assert_allclose(motion.positions[:, column], theirs[joint] if length else np.radians(theirs[joint]),
                                   atol=1e-12)


@pytest.mark.parametrize('said, factor', [('inDegrees=yes', np.pi / 180), ('inDegrees=no', 1.0),
                                          ('inDegrees = no', 1.0), ('indegrees=YES', np.pi / 180)])
def test_opensim_says_its_unit(tmp_path, said, factor):
    motion = read_motion(written(tmp_path, 'a.mot', MOT.replace('inDegrees=yes', said)))
    np.testing.assert_allclose(motion.positions[0], [10 * factor, -90 * factor, 0.5])


def test_opensim_without_a_unit_asks_for_one(tmp_path):
    path = written(tmp_path, 'a.mot', MOT.replace('inDegrees=yes\n', ''))
    with pytest.raises(MotionError, match='--unit'):
        read_motion(path)
    assert read_motion(path, unit='deg').positions[0, 1] == pytest.approx(-np.pi / 2)
    assert main(['convert', str(path), str(tmp_path / 'a.csv'), '--unit', 'rad']) == 0


def test_of_a_states_file_the_coordinates_count(tmp_path):
    path = written(tmp_path, 'a.sto', (
        'ModelStates\ninDegrees=no\nendheader\ntime /jointset/hip_r/hip_flexion_r/value '
        '/jointset/hip_r/hip_flexion_r/speed /forceset/soleus_r/activation /jointset/ground_pelvis/pelvis_tx/value\n'
        '0 0.1 7 8 0.5\n0.1 0.2 7 8 0.6\n'))
    with pytest.warns(UserWarning, match='2 columns'):
        motion = read_motion(path)
    assert motion.joint_names == ('hip_flexion_r', 'pelvis_tx') and motion.units == ('rad', 'm')
    np.testing.assert_array_equal(motion.positions, [[0.1, 0.5], [0.2, 0.6]])


@pytest.mark.parametrize('change, words', [
    (('endheader', 'end'), 'endheader'), (('Coordinates', 'Accelerations'), 'Accelerations'),
    (('hip_flexion_r', 'ground_force_vx'), 'forces'), (('inDegrees', 'DataType=Quaternion\ninDegrees'), 'Quaternion'),
    (('-80', 'x'), "line 12: 'x'"), (('20\t', ''), 'line 12 has 3'), (('time', 'frame'), 'line 10'),
    (('0.02', '0.00'), 'line 13: time')])
def test_damaged_and_other_opensim_files_say_where(tmp_path, change, words):
    with pytest.raises(MotionError, match=words):
        read_motion(written(tmp_path, 'a.mot', MOT.replace(*change)))


# ---------------------------------------------------------------------------------------------- ROS 1

def ros1_bag(path, names, positions, stamps, topic='/joint_states'):
    """Recorded by the library that also reads it: the format itself is judged by its own writer."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    state, header, time = (store.types[name] for name in
                           ('sensor_msgs/msg/JointState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    with Writer(path) as bag:
        connection = bag.add_connection(topic, 'sensor_msgs/msg/JointState', typestore=store)
        for number, (stamp, row) in enumerate(zip(stamps.tolist(), positions)):
            at = time(sec=stamp // 10**9, nanosec=stamp % 10**9)
            message = state(header=header(seq=number, stamp=at, frame_id=''), name=list(names), position=row,
                            velocity=np.empty(0), effort=np.empty(0))
            bag.write(connection, stamp, store.serialize_ros1(message, 'sensor_msgs/msg/JointState'))
    return path


def test_bags_of_ros_1(tmp_path, gait):
    stamps = 1_500_000_000 * 10**9 + np.round(gait.times * 1e9).astype(int)
    path = ros1_bag(tmp_path / 'walk.bag', gait.joint_names, gait.positions, stamps)
    motion = quietly(path)
    assert motion.joint_names == gait.joint_names and motion.epoch_ns == 1_500_000_000 * 10**9
    np.testing.assert_array_equal(motion.positions, gait.positions)
    np.testing.assert_allclose(motion.times, gait.times, atol=1e-9)
    assert main(['convert', str(path), str(tmp_path / 'b'), '--storage', 'sqlite3', '--start', '1', '--stop', '2']) == 0
    assert read_motion(tmp_path / 'b').n_frames == 100
    with pytest.raises(MotionError, match='/other'):
        read_motion(path, topic='/other')
    with pytest.raises(MotionError, match='read only'):
        write_motion(gait, tmp_path / 'c.bag')


# ---------------------------------------------------------------------------------------------- AMASS

def amass(path, joints, rate=100.0, key='mocap_framerate', **changes):
    rng = np.random.default_rng(joints)
    poses = np.cumsum(0.05 * rng.standard_normal((40, 3 * joints)), axis=0)
    fields = {'poses': poses, 'trans': rng.standard_normal((40, 3)), 'betas': np.zeros(16), 'gender': np.array('male'),
              'dmpls': np.zeros((40, 8)), key: np.array(rate), **changes}
    np.savez(path, **{name: value for name, value in fields.items() if value is not None})
    return fields


@pytest.mark.parametrize('joints, key', [(22, 'mocap_framerate'), (24, 'mocap_framerate'), (52, 'mocap_framerate'),
                                         (55, 'mocap_frame_rate')])
def test_poses_of_amass_are_the_rotations_of_scipy(tmp_path, joints, key):
    fields = amass(tmp_path / 'a_poses.npz', joints, key=key)
    motion = quietly(tmp_path / 'a_poses.npz')
    assert motion.rate_hz == 100 and motion.n_joints == 3 + 3 * joints and motion.units[:4] == ('m', 'm', 'm', 'rad')
    np.testing.assert_array_equal(motion.positions[:, :3], fields['trans'])
    for place, (joint, triple) in enumerate(motion.triples.items()):
        ours = Rotation.from_euler('xyz', motion.positions[:, triple])
        theirs = Rotation.from_rotvec(fields['poses'][:, 3 * place:3 * place + 3])
        assert (ours * theirs.inv()).magnitude().max() < 1e-7, joint
    names = list(motion.triples)
    assert names[0] == 'pelvis' and names[4] == 'left_knee' and names[21] == 'right_wrist'
    assert names[22:] == {22: [], 24: ['left_hand', 'right_hand']}.get(joints, names[22:])
    if joints == 55:
        assert names[22:26] == ['jaw', 'left_eye', 'right_eye', 'left_index1'] and names[-1] == 'right_thumb3'


@pytest.mark.parametrize('changes, words', [
    ({'mocap_framerate': None}, '--recorded-rate'), ({'mocap_framerate': np.array(0)}, 'positive'),
    ({'trans': np.zeros((3, 3))}, 'trans'), ({'poses': np.zeros((40, 70))}, 'shape'),
    ({'poses': np.full((40, 72), np.nan)}, 'finite')])
def test_archives_of_amass_that_do_not_fit_say_why(tmp_path, changes, words):
    amass(tmp_path / 'a.npz', 24, **changes)
    with pytest.raises(MotionError, match=words):
        read_motion(tmp_path / 'a.npz')
    if 'mocap_framerate' in changes and changes['mocap_framerate'] is None:
        assert read_motion(tmp_path / 'a.npz', rate_hz=50.0).rate_hz == 50
        assert main(['convert', str(tmp_path / 'a.npz'), str(tmp_path / 'a.csv'), '--recorded-rate', '50']) == 0


def test_a_rate_that_an_archive_has_counts(tmp_path, gait):
    amass(tmp_path / 'a.npz', 24)
    write_motion(gait, tmp_path / 'b.npz')
    for name in 'ab':
        with pytest.warns(UserWarning, match='not used'):
            assert read_motion(tmp_path / f'{name}.npz', rate_hz=50.0).rate_hz == 100


# ---------------------------------------------------------------------------------------------- Xsens

def mvnx(path, frames=5, rate='120', changes=()):
    """A file of the structure that MVN's user manual prints, with its calibration poses; returns what is in it."""
    rng = np.random.default_rng(3)
    turns = Rotation.from_rotvec(np.cumsum(0.1 * rng.standard_normal((frames, 3)), axis=0))
    x, y, z, w = turns.as_quat().T
    pelvis, places = np.column_stack([w, x, y, z]), rng.standard_normal((frames, 6))
    angles = np.cumsum(rng.uniform(-5, 5, (frames, 6)), axis=0)

    def words(values):
        return ' '.join(f'{value:.9f}' for value in values)

    rows = ''.join(f'<frame time="{round(k * 1000 / 120)}" index="{k}" tc="12:00:00:00" ms="{1700000000000 + 8 * k}" '
                   f'type="normal"><orientation>{words(pelvis[k])} 1 0 0 0</orientation>'
                   f'<position>{words(places[k])}</position><jointAngle>{words(angles[k])}</jointAngle>'
                   f'<jointAngleXZY>0 0 0 0 0 0</jointAngleXZY></frame>\n' for k in range(frames))
    text = ('<?xml version="1.0" encoding="UTF-8"?>\n<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">\n'
            f'<mvn version="2021"/><comment/><subject label="S1" frameRate="{rate}" segmentCount="2">\n'
            '<segments><segment label="Pelvis" id="1"/><segment label="RightUpperLeg" id="2"/></segments>\n'
            '<joints><joint label="jRightHip"/><joint label="jRightKnee"/></joints>\n'
            '<frames segmentCount="2" sensorCount="0" jointCount="2">\n'
            '<frame time="0" index="" tc="" ms="" type="identity"><orientation>1 0 0 0 1 0 0 0</orientation>'
            '<position>0 0 0 0 0 0</position></frame>\n'
            f'<frame time="0" index="" type="tpose"><orientation>1 0 0 0 1 0 0 0</orientation></frame>\n{rows}'
            '</frames></subject></mvnx>\n')
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    return turns, places, angles


def test_joint_angles_of_xsens(tmp_path):
    turns, places, angles = mvnx(tmp_path / 'a.mvnx')
    motion = quietly(tmp_path / 'a.mvnx')
    assert motion.joint_names[:6] == tuple(f'Pelvis.{kind}{axis}' for kind in 'tr' for axis in 'xyz')
    assert motion.joint_names[6:9] == ('jRightHip.rx', 'jRightHip.ry', 'jRightHip.rz')
    assert motion.rate_hz == pytest.approx(120) and motion.epoch_ns == 1_700_000_000 * 10**9
    np.testing.assert_allclose(motion.positions[:, :3], places[:, :3], atol=1e-9)
    np.testing.assert_allclose(motion.positions[:, 6:], np.radians(angles), atol=1e-9)
    ours = Rotation.from_euler('xyz', motion.joints([f'Pelvis.r{axis}' for axis in 'xyz']).positions)
    assert (ours * turns.inv()).magnitude().max() < 1e-7
    # flexion about z, then abduction about the turned x, then rotation about the turned y
    hip = Rotation.from_euler('ZXY', angles[:, [2, 0, 1]], degrees=True).as_matrix()
    np.testing.assert_allclose(matrices_of(motion.positions[:, 6:9], motion.order_of('jRightHip')), hip, atol=1e-9)


def test_another_parser_of_xsens_files_finds_the_same(tmp_path):
    parser = pytest.importorskip('mvnx_parser')
    mvnx(tmp_path / 'a.mvnx')
    theirs = parser.Mvnx_p(str(tmp_path / 'a.mvnx'))
    motion = read_motion(tmp_path / 'a.mvnx')
    np.testing.assert_allclose(motion.positions[:, 6:], np.radians(np.array(theirs.jointAngle, float).reshape(5, 6)),
                               atol=1e-12)
    np.testing.assert_allclose(motion.positions[:, :3], np.array(theirs.position, float)[:, 0], atol=1e-12)


@pytest.mark.parametrize('changes, words', [
    ((('jointAngle>', 'jointAngleErgo>'),), 'no joint angles'), ((('label="jRightHip"', ''),), 'labels'),
    ((('<mvnx ', '<mvn '), ('</mvnx>', '</mvn>')), 'not an <mvnx>'), ((('</subject>', ''),), 'well-formed'),
    ((('type="normal"', 'type="other"'),), 'no frame'), ((('index="3"', 'index="1"'),), 'increase'),
    ((('index="3"', 'index="x"'),), 'finite'), ((('<position>', '<position>1 '),), 'position has 7')])
def test_damaged_files_of_xsens_say_why(tmp_path, changes, words):
    mvnx(tmp_path / 'a.mvnx', changes=changes)
    with pytest.raises(MotionError, match=words):
        read_motion(tmp_path / 'a.mvnx')


def test_xsens_without_a_rate_has_the_times_of_its_frames(tmp_path):
    mvnx(tmp_path / 'a.mvnx', rate='')
    with pytest.warns(UserWarning, match='whole milliseconds'):
        assert read_motion(tmp_path / 'a.mvnx').times.tolist() == [0, 0.008, 0.017, 0.025, 0.033]


# ---------------------------------------------------------------------------------------------- tables of robots

ROBOT = ('<robot name="r"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>'
         '<joint name="hip" type="revolute"><parent link="base"/><child link="a"/></joint>'
         '<joint name="foot" type="fixed"><parent link="a"/><child link="c"/></joint>'
         '<joint name="lift" type="prismatic"><parent link="a"/><child link="b"/></joint></robot>')


@pytest.mark.parametrize('timed', [False, True])
@pytest.mark.parametrize('rooted', [False, True])
@pytest.mark.parametrize('delimiter', [',', ' '])
def test_a_table_without_header_holds_the_joints_of_a_robot(tmp_path, timed, rooted, delimiter):
    robot = written(tmp_path, 'robot.urdf', ROBOT)
    rng = np.random.default_rng(4)
    turns = Rotation.from_rotvec(np.cumsum(0.2 * rng.standard_normal((20, 3)), axis=0))
    places, joints = rng.standard_normal((20, 3)), np.cumsum(rng.uniform(-0.1, 0.1, (20, 2)), axis=0)
    times = np.arange(20) / 30
    parts = [times[:, None]] * timed + [places, turns.as_quat()] * rooted + [joints]
    path = tmp_path / 'walk.csv'
    np.savetxt(path, np.hstack(parts), delimiter=delimiter)
    motion = quietly(path, joints_of=robot, rate_hz=None if timed else 30.0)
    assert motion.joint_names[-2:] == ('hip', 'lift') and motion.units[-2:] == ('rad', 'm')
    assert motion.rate_hz == pytest.approx(30)
    np.testing.assert_allclose(motion.positions[:, -2:], joints, atol=1e-12)
    if rooted:
        np.testing.assert_allclose(motion.positions[:, :3], places, atol=1e-12)
        ours = Rotation.from_euler('xyz', motion.positions[:, 3:6])
        assert (ours * turns.inv()).magnitude().max() < 1e-7
    rate = [] if timed else ['--recorded-rate', '30']
    assert main(['convert', str(path), str(tmp_path / 'o.npz'), '--joints-of', str(robot), *rate]) == 0
    assert main(['info', str(path), '--joints-of', str(robot), *rate]) == 0


def test_a_table_of_a_real_robot(tmp_path):
    robot = WILD / 'urdf' / 'g1_29dof.urdf'
    if not robot.is_file():
        pytest.skip('no robots of others here')
    path = tmp_path / 'g1.csv'
    np.savetxt(path, np.hstack([np.zeros((4, 6)), np.ones((4, 1)), np.full((4, 29), 0.1)]), delimiter=',')
    motion = quietly(path, joints_of=robot, rate_hz=30.0)
    assert motion.n_joints == 35 and motion.joint_names[6] == 'left_hip_pitch_joint'
    assert set(motion.joint_names[6:]) <= set(read_skeleton(robot).channel_names)


@pytest.mark.parametrize('text, options, words', [
    ('0,1\n0,1\n', {}, '--recorded-rate'), ('0,1\n0\n', {'rate_hz': 30}, 'line 2 has 1'),
    ('0,1,2,3\n', {'rate_hz': 30}, '2 joints'), ('a,b\n0,1\n', {'rate_hz': 30}, 'line 1'),
    ('0,0,0,1,1,1,1,0,0\n', {'rate_hz': 30}, 'length 2'), ('0,0,1\n', {'rate_hz': 30}, 'has a column of times'),
    ('0,inf\n', {'rate_hz': 30}, 'infinite')])
def test_tables_that_do_not_fit_a_robot_say_why(tmp_path, text, options, words):
    with pytest.raises(MotionError, match=words):
        read_motion(written(tmp_path, 'a.csv', text), joints_of=written(tmp_path, 'r.urdf', ROBOT), **options)


# ---------------------------------------------------------------------------------------------- LocoHub

LEGS = [f'{joint}_angle_{side}' for joint in ('hip_flexion', 'knee_flexion') for side in ('ipsi', 'contra')]


def strides(path, durations, speeds=True, subjects=('DS23_AB01', 'DS23_AB02'), tasks=('level_walking', 'stair_ascent')):
    """A table as LocoHub's reference has it: 150 rows a stride; each stride lasts as long as its velocities say."""
    turn, rows = 2 * np.pi * np.linspace(0, 1, 150), []
    for who, subject in enumerate(subjects):
        for task in tasks:
            for step, duration in enumerate(durations):
                for angle in turn:
                    row = {'subject': subject, 'subject_metadata': 'age:25,sex:M', 'task': task,
                           'task_id': f'{task}_slow', 'task_info': 'speed_m_s:1.2,incline_deg:0', 'step': step,
                           'phase_ipsi': 100 * angle / (2 * np.pi), 'hip_flexion_moment_ipsi_Nm_kg': 0.1}
                    for place, name in enumerate(LEGS):
                        row[f'{name}_rad'] = 0.1 * who + 0.4 * np.sin(angle + place) + 0.01 * step
                        if speeds:
                            row[name.replace('angle', 'angular_velocity') + '_rad_s'] = (
                                0.4 * np.cos(angle + place) * 2 * np.pi / duration)
                    rows.append(row)
    if path.suffix == '.parquet':
        pyarrow = pytest.importorskip('pyarrow')
        from pyarrow import parquet
        parquet.write_table(pyarrow.Table.from_pylist(rows), path)
    else:
        with open(path, 'w', newline='') as stream:
            table = csv.DictWriter(stream, rows[0])
            table.writeheader()
            table.writerows(rows)
    return rows


@pytest.mark.parametrize('suffix', ['.csv', '.parquet'])
def test_strides_of_locohub_become_recordings_of_their_own_duration(tmp_path, suffix):
    rows = strides(tmp_path / f'a{suffix}', [1.1, 0.9])
    motions = read_recordings(tmp_path / f'a{suffix}')
    assert [motion.name for motion in motions] == [f'{who}/{task}_slow' for who in ('DS23_AB01', 'DS23_AB02')
                                                   for task in ('level_walking', 'stair_ascent')]
    for number, motion in enumerate(motions):
        assert motion.joint_names == tuple(LEGS)
        theirs = rows[300 * number:300 * number + 300]
        np.testing.assert_array_equal(motion.positions, [[row[f'{name}_rad'] for name in LEGS] for row in theirs])
        first, second = motion.times[:150], motion.times[150:]
        assert np.ptp(first) == pytest.approx(1.1, rel=1e-3) and np.ptp(second) == pytest.approx(0.9, rel=1e-3)
        assert second[0] - first[-1] == pytest.approx(1.0)
        assert np.isnan(motion.at([first[-1] + 0.5]).positions).all()       # nothing is invented between strides
    with pytest.raises(MotionError, match=r'4 recordings .*motion-style split'):
        read_motion(tmp_path / f'a{suffix}')


def test_a_table_of_locohub_is_split_by_person_and_task(tmp_path, capsys):
    strides(tmp_path / 'a.csv', [1.0, 1.2, 1.1])
    command = ['split', str(tmp_path / 'a.csv'), '-o', str(tmp_path / 'out')]
    assert main(command) == 0 and '4 recordings of 2 people' in capsys.readouterr().out
    files = sorted(path.relative_to(tmp_path / 'out').as_posix() for path in tmp_path.glob('out/*/*.npz'))
    assert files == [f'DS23_AB0{who}/{task}_slow.npz' for who in (1, 2) for task in ('level_walking', 'stair_ascent')]
    assert quietly(tmp_path / 'out' / files[0]).n_frames == 450
    assert main(command) == 2 and main([*command, '--force', '--stride', '2']) == 0
    assert np.ptp(quietly(tmp_path / 'out' / files[0]).times) == pytest.approx(3 * 2 + 2)


def test_how_long_a_stride_is_is_not_guessed_silently(tmp_path):
    strides(tmp_path / 'a.csv', [1.1], speeds=False, subjects=('AB01',), tasks=('run',))
    with pytest.warns(UserWarning, match='how long 1 strides last'):
        motion = read_motion(tmp_path / 'a.csv')
    assert motion.duration_s == pytest.approx(1.0) and motion.name == 'AB01/run_slow'
    assert read_recordings(tmp_path / 'a.csv', 0.7)[0].duration_s == pytest.approx(0.7)


def test_a_table_of_locohub_by_time(tmp_path):
    path = written(tmp_path, 'a.csv', 'subject,task,step,time_s,knee_flexion_angle_ipsi_rad,hip_flexion_angle_rad\n'
                   'S1,cutting,0,0.0,1,\nS1,cutting,0,0.1,2,\nS1,cutting,1,0.2,,\nS1,cutting,1,0.0,4,\n')
    motion = read_motion(path)
    assert motion.joint_names == ('knee_flexion_angle_ipsi',)
    np.testing.assert_allclose(motion.times, [0, 0.1, 0.2, 1.2])
    np.testing.assert_array_equal(motion.positions.ravel(), [1, 2, np.nan, 4])


@pytest.mark.parametrize('text, words', [
    ('subject,task,step,phase_ipsi\nS,t,0,0\n', 'no column of angles'),
    ('subject,task,step,phase_ipsi,a_angle_rad\n', 'no rows'),
    ('subject,task,step,phase_ipsi,a_angle_rad\nS,t,0,0\n', 'line 2 has 4'),
    ('subject,task,step,phase_ipsi,a_angle_rad\nS,t,0,,1\n', 'missing'),
    ('subject,task,step,phase_ipsi,a_angle_rad\nS,t,0,0,x\n', 'a_angle_rad')])
def test_damaged_tables_of_locohub_say_why(tmp_path, text, words):
    with pytest.raises(MotionError, match=words):
        read_motion(written(tmp_path, 'a.csv', text))


def test_parquet_without_its_library_says_so(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(MotionError, match='need pyarrow'):
        read_motion(written(tmp_path, 'a.parquet', 'PAR1'))


def test_among_several_recordings_a_rate_is_for_those_without_one(tmp_path, gait):
    write_motion(gait, tmp_path / 'a.npz')
    amass(tmp_path / 'b.npz', 24, mocap_framerate=None)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        rates = [recordings.read_recording(tmp_path / f'{name}.npz', 50.0).rate_hz for name in 'ab']
    assert rates == [100, 50]
