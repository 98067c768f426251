"""Every reader on damaged and invented input: a motion of the right shape or a MotionError, nothing else, soon."""
import io
import os
import tempfile
import warnings
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_formats import BVH
from test_skeleton import ASF, URDF
from test_ways_in import ros1_bag

from style_core.errors import MotionError
from style_core.formats import FORMATS, read_motion
from style_core.recordings import read_recordings
from style_core.skeleton import read_skeleton

AMC = '#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n' + ''.join(
    f'{k}\nroot 1 2 3 10 20 30\nlfemur -10 5 2.5\nltibia 4{k}\n' for k in range(1, 4))
CSV = 'time,hip,"knee [deg]",root.tx\n0,0.1,20,1\n0.1,0.2,,2\n0.2,0.3,22,nan\n'
MOT = ('Coordinates\nversion=1\nnRows=3\nnColumns=4\ninDegrees=yes\n\nUnits are S.I. units\n\nendheader\n'
       'time\thip_flexion_r\tknee_angle_r\tpelvis_tx\n 0.00\t10\t-90\t0.5\n 0.01\t20\t-80\t0.6\n')
MVNX = ('<?xml version="1.0"?>\n<mvnx version="4">\n<subject label="S" frameRate="60">\n<segments>'
        '<segment label="Pelvis"/></segments>\n<joints><joint label="jHip"/></joints>\n<frames>\n' + ''.join(
            f'<frame time="{16 * k}" index="{k}" ms="{1700000000000 + k}" type="normal">\n<orientation>1 0 0 0 '
            f'</orientation>\n<position>0 {k} 1 </position>\n<jointAngle>1 2 {k} </jointAngle>\n</frame>\n'
            for k in range(3)) + '</frames>\n</subject>\n</mvnx>\n')
STRIDES = ('subject,task,task_id,step,phase_ipsi,hip_flexion_angle_ipsi_rad,hip_flexion_angular_velocity_ipsi_rad_s\n'
           + ''.join(f'S{k // 8},walk,slow,{k // 4}, {25 * (k % 4)} ,0.{k},1\n' for k in range(16)))
SEEDS = {'.amc': AMC, '.bvh': BVH, '.csv': CSV, '.asf': ASF, '.urdf': URDF, '.mot': MOT, '.mvnx': MVNX}

#: words that parsers trip over
ODD = ['', ' ', '\n', '\r', '\0', 'nan', 'inf', '-inf', '1e999', '-1', '0', '99999999999999999999', '1_0', '٣', '²',
       '"', '{', '}', '(', ')', ':', '#', ',', ';', '<', '>', '&a;', 'begin', 'end', 'root', 'MOTION', 'JOINT x',
       'End Site', 'CHANNELS 99999999', 'Frames: 1000000000', '\ufeff', '\u2028', '\x1c', '1.0e', '0x10', '--1']


@st.composite
def damaged(draw, seed):
    """A seed with words exchanged, lines dropped, doubled or swapped, and its end cut off."""
    text = seed
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(('cut', 'word', 'insert', 'drop', 'double', 'swap')))
        if kind == 'cut':
            text = text[:draw(st.integers(0, len(text)))]
        elif kind == 'insert':
            place = draw(st.integers(0, len(text)))
            text = text[:place] + draw(st.one_of(st.sampled_from(ODD), st.text(max_size=4))) + text[place:]
        elif kind == 'word':
            words = text.split(' ')
            words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(ODD))
            text = ' '.join(words)
        else:
            lines = text.split('\n')
            a, b = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
            if kind == 'drop':
                del lines[a]
            elif kind == 'double':
                lines.insert(b, lines[a])
            else:
                lines[a], lines[b] = lines[b], lines[a]
            text = '\n'.join(lines)
    return text


@contextmanager
def written(data, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f'fuzz{suffix}'
        path.write_bytes(data)
        yield path


def check(data, suffix):
    """Read as a motion, a skeleton or both."""
    with written(data, suffix) as path, warnings.catch_warnings():
        warnings.simplefilter('ignore')
        if suffix in FORMATS:
            try:
                motion = read_motion(path)
            except MotionError as error:
                assert str(error)
            else:
                assert motion.positions.shape == (motion.n_frames, motion.n_joints) == (
                    len(motion.times), len(motion.joint_names))
                assert not np.isinf(motion.positions).any() and (np.diff(motion.times) > 0).all()
        if suffix in ('.asf', '.bvh', '.urdf'):
            try:
                skeleton = read_skeleton(path)
            except MotionError as error:
                assert str(error)
            else:
                positions, rotations = skeleton.rest()
                assert positions.shape == (len(skeleton.bodies), 3) and np.isfinite(positions).all()
                np.testing.assert_allclose(rotations @ np.swapaxes(rotations, 1, 2),
                                           np.broadcast_to(np.eye(3), rotations.shape), atol=1e-6)
                assert all(body.parent < index for index, body in enumerate(skeleton.bodies))


@pytest.mark.parametrize('suffix', SEEDS)
def test_damaged_text(suffix):
    @settings(max_examples=250)
    @given(damaged(SEEDS[suffix]))
    def fuzz(text):
        check(text.encode('utf-8', errors='surrogatepass'), suffix)
    fuzz()


@settings(max_examples=150)
@given(damaged(STRIDES))
def test_damaged_tables_of_strides(text):
    with written(text.encode('utf-8', errors='surrogatepass'), '.csv') as path, warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            motions = read_recordings(path)
        except MotionError as error:
            assert str(error)
        else:
            assert motions and all(np.isfinite(motion.times).all() for motion in motions)


@settings(max_examples=100)
@given(damaged('0.0,1,2,3,0,0,0,1,0.1,0.2\n0.1,1,2,3,0,0,1,0,0.1,0.2\n'))
def test_damaged_tables_of_a_robot(text):
    with written(text.encode('utf-8', errors='surrogatepass'), '.csv') as path, \
            written(URDF.encode(), '.urdf') as robot, warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            motion = read_motion(path, joints_of=robot)
        except MotionError as error:
            assert str(error)
        else:
            assert motion.n_joints in (len(read_skeleton(robot).channel_names) + extra for extra in (0, 6))


@pytest.fixture(scope='module')
def bag_of_ros_1(tmp_path_factory):
    path = tmp_path_factory.mktemp('ros1') / 'a.bag'
    return ros1_bag(path, ('a', 'b'), np.zeros((3, 2)), 10**9 * np.arange(1, 4)).read_bytes()


@settings(max_examples=100)
@given(st.data())
def test_damaged_bags_of_ros_1(bag_of_ros_1, data):
    whole = bytearray(bag_of_ros_1)
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    check(bytes(whole[:data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole), '.bag')


@settings(max_examples=60)
@given(st.integers(0, 170), st.lists(st.integers(0, 4), max_size=3), st.sampled_from(['f8', 'i4', 'U3', 'c16']),
       st.floats(width=16))
def test_invented_archives_of_poses(numbers, shape, kind, rate):
    stream = io.BytesIO()
    np.savez(stream, poses=np.zeros((2, numbers), dtype=kind), trans=np.zeros(shape), mocap_framerate=rate)
    check(stream.getvalue(), '.npz')


@pytest.mark.parametrize('suffix', [*SEEDS, '.npz', '.mcap', '.db3', '.bag', '.parquet'])
def test_invented_bytes(suffix):
    @settings(max_examples=60)
    @given(st.binary(max_size=200))
    @example(b'')
    @example(b'\xff\xfe\x00')
    def fuzz(data):
        check(data, suffix)
    fuzz()


@settings(max_examples=150)
@given(st.data())
def test_damaged_archives(data):
    stream = io.BytesIO()
    np.savez_compressed(stream, joint_names=np.array(['a', 'b']), positions=np.zeros((3, 2)), times=np.arange(3.0),
                        units=np.array(['rad', 'm']), name=np.array('x'), epoch_ns=np.array(5))
    whole = bytearray(stream.getvalue())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    check(bytes(whole[:data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole), '.npz')


@pytest.mark.parametrize('header', [
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 2), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (2,), }", "{'descr': 'zz', 'shape': (2,)}",
    '(' * 3000, '{}', '\0'])
def test_archives_with_forged_arrays(header):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, 'w') as archive:
        for key in ('joint_names', 'positions', 'times'):
            text = header.encode() + b'\n'
            archive.writestr(f'{key}.npy', b'\x93NUMPY\x01\x00' + len(text).to_bytes(2, 'little') + text)
    check(stream.getvalue(), '.npz')


@pytest.mark.parametrize('suffix, text', [
    ('.bvh', 'HIERARCHY\n' + 'ROOT a {\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n' + ''.join(
        f'JOINT j{k} {{\nOFFSET 1 0 0\n' for k in range(3000)) + '}' * 3001 +
     '\nMOTION\nFrames: 1\nFrame Time: 1\n0\n'),
    ('.urdf', '<a>' * 20000), ('.urdf', '<robot name="r">' + '<link name="a"/>' * 3 + '</robot>'),
    ('.urdf', '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">' + ''.join(
        f'<!ENTITY {chr(98 + k)} "{("&" + chr(97 + k) + ";") * 10}">' for k in range(12)) +
     ']><robot name="&m;"><link name="&m;"/></robot>'),
    ('.urdf', f'<!DOCTYPE r [<!ENTITY a SYSTEM "file://{os.devnull}">]><robot name="r"><link name="&a;"/></robot>'),
    ('.csv', 'time,' + ','.join(f'j{k}' for k in range(5000)) + '\n0' + ',1' * 5000),
    ('.csv', 'time,' + '"' * 100001 + '\n0,1\n'), ('.csv', 'time,a\n' + '0,' + '9' * 100000 + '\n'),
    ('.amc', '1\nltibia 1\n²\nltibia 1\n'), ('.amc', '²\nltibia 1\n'),
    ('.bvh', BVH.replace('CHANNELS 3', 'CHANNELS ³')),
    ('.csv', 'time,a\n0,1_0\n'), ('.amc', '1\nltibia ' + '9' * 100000 + '\n'), ('.amc', '9' * 5000 + '\nltibia 1\n'),
    ('.amc', '1\n' + 'ltibia 1\n' * 20000), ('.asf', ':root\n' * 2 + ':bonedata\n:hierarchy\n'),
    ('.asf', ':units\nlength 1e-300\n:root\n:bonedata\nbegin\nname a\ndirection 1e300 1 1\nlength 1e300\ndof rx\nend\n'
             ':hierarchy\nroot a\n')])
def test_monstrous_files(suffix, text):
    check(text.encode(), suffix)
