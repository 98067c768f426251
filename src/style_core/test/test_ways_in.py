"""Formats of other programs: each against an independent reader, a published specification or a real file."""
import warnings
from pathlib import Path

import numpy as np
import pytest

from style_core.cli import main
from style_core.errors import MotionError
from style_core.formats import FORMATS, carried, read_motion, skeleton_of, write_motion, written_suffixes
from style_core.recordings import read_recording
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
        'ModelStates\ninDegrees=no\nendheader\ntime /jointset/hip_r/hip_flexion_r/value /jointset/hip_r/hip_flexion_r/'
        'speed /forceset/soleus_r/activation /jointset/ground_pelvis/pelvis_tx/value\n0 0.1 7 8 0.5\n0.1 0.2 7 8 0.6\n'))
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
