"""Recordings as people bring them: each file that once went wrong, and the one way in which all are read."""
import ast
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core import datasets
from style_core.body import body_joints, common_joints
from style_core.cli import main
from style_core.cli.people import people_of
from style_core.errors import MotionError, UsageError
from style_core.formats import read_motion, skeleton_of, write_motion
from style_core.formats.bag import JOINT_STATE
from style_core.motion import Motion, concatenate
from style_core.recordings import read_recording
from style_core.skeleton import read_skeleton

INPUTS = Path(__file__).parent / 'inputs'
WILD = Path(__file__).resolve().parents[4] / 'shared' / 'wild'
SOURCE = Path(__file__).resolve().parents[1] / 'style_core'


def wild(name):
    path = WILD / name
    if not path.is_file():
        pytest.skip('no recordings of others here')
    return path


def quietly(path, **options):
    """A recording that is read without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return read_recording(path, **options)


def warned(path, words, **options):
    """A recording that is read with a warning."""
    with pytest.warns(UserWarning, match=words):
        return read_recording(path, **options)


# ---------------------------------------------------------------------------------------------- one way in

def test_only_one_function_makes_angles_continuous():
    callers = set()
    for path in SOURCE.parents[1].rglob('*.py'):
        if 'test' in path.parts or 'build' in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == 'style_core.angles' \
                    and any(name.name == 'continuous' for name in node.names):
                callers.add(path.name)
    assert callers == {'recordings.py'}


def test_orders_travel_with_the_recording(tmp_path):
    motion = quietly(INPUTS / 'r50_zxy_continuous.bvh')
    assert motion.orders == {'Hips': 'YXZ', 'Leg': 'YXZ'}      # Zrotation Xrotation Yrotation: y turns first
    assert motion.select('Leg.*').orders == {'Leg': 'YXZ'} and motion.resample(60.0).orders == motion.orders
    assert concatenate([motion, motion]).orders == motion.orders
    for name in ('a.npz', 'a.csv'):
        write_motion(motion, tmp_path / name)
        assert read_motion(tmp_path / name).orders == motion.orders
    with pytest.warns(UserWarning, match='no place for the orders'):
        write_motion(motion, tmp_path / 'bag')
    again = read_motion(tmp_path / 'bag', skeleton_of(INPUTS / 'r50_zxy_continuous.bvh'))
    assert again.orders == motion.orders
    with pytest.raises(MotionError, match='order'):
        motion.replace(orders={'Leg': 'XXZ'})
    with pytest.raises(MotionError, match='orders'):
        concatenate([motion, motion.replace(orders={})])


def test_rotations_of_any_order_run_on_without_changing():
    """20 to 63 degrees off when the order is forgotten."""
    path = INPUTS / 'r50_zxy_continuous.bvh'
    filed, motion = read_motion(path), quietly(path)
    leg = ['Leg.rz', 'Leg.rx', 'Leg.ry']
    turns = [Rotation.from_euler('ZXY', one.joints(leg).positions) for one in (filed, motion)]
    assert (turns[0].inv() * turns[1]).magnitude().max() < 1e-12
    assert np.abs(np.diff(motion.positions, axis=0)).max() < 0.2


@pytest.mark.parametrize('alpha, which', [(0, 0), (1, 1)])
def test_a_blend_with_nothing_of_the_other_is_the_recording(tmp_path, alpha, which):
    path = INPUTS / 'r50_zxy_continuous.bvh'
    first = read_recording(path)
    second = first.replace(positions=0.7 * first.positions)
    write_motion(second, tmp_path / 'b.npz')
    files = [str(tmp_path / name) for name in ('b.npz', 'o.npz')]
    assert main(['blend', str(path), files[0], '--alpha', str(alpha), '-o', files[1]]) == 0
    result = read_motion(tmp_path / 'o.npz')
    expected = (first, second)[which]
    assert result.joint_names == first.joint_names and result.orders == first.orders
    angles = [name for name in first.joint_names if not name.startswith('Hips.t')]
    np.testing.assert_allclose(result.joints(angles).positions, expected.joints(angles).positions, atol=1e-8)
    if which == 0:
        np.testing.assert_allclose(result.positions, expected.positions, atol=1e-8)


# ---------------------------------------------------------------------------------------------- BVH

@pytest.mark.parametrize('name, hips, leg', [('r01_six_channels', 0.9, 0.5), ('r02_root_offset', 0.9, 0.5),
                                             ('r08_zero_offset', 0.9, 0.5)])
def test_a_position_takes_the_place_of_offset(name, hips, leg):
    path = INPUTS / f'{name}.bvh'
    motion, skeleton = quietly(path), skeleton_of(path)
    places = dict(zip(skeleton.body_names, skeleton.forward(motion)[0]))
    np.testing.assert_allclose(places['Hips'], [0, hips, 0], atol=1e-12)
    np.testing.assert_allclose(places['Leg'], [0, leg, 0], atol=1e-12)
    alone = skeleton.forward(motion.select('!*.t*'))[0]      # without positions a joint stays where OFFSET has it
    np.testing.assert_allclose(np.linalg.norm(alone[1] - alone[0]), 0.0 if name.startswith('r08') else 0.4, atol=1e-12)


@pytest.mark.parametrize('name, words, frames', [
    ('r03_frames_plus_one', '9 frames are announced, 10', 10), ('r04_spaces', 'spaces', 10),
    ('r30_two_end_sites', '2 end sites', 10), ('r33_no_colon', 'no colon', 10), ('r40_lower_motion', 'MOTION', 10),
    ('r43_end_site_named', "'Toe'", 10)])
def test_a_file_that_departs_from_the_format_is_read_with_a_warning(name, words, frames):
    path = INPUTS / f'{name}.bvh'
    motion, plain = warned(path, words), quietly(INPUTS / 'r08_zero_offset.bvh')
    assert motion.n_frames == frames and motion.rate_hz == pytest.approx(30, rel=1e-5)
    legs = [name for name in motion.joint_names if name.endswith('.rx')][-1]
    np.testing.assert_allclose(motion.joints([legs]).positions, plain.joints(['Leg.rx']).positions, atol=1e-12)


def test_end_sites_have_names_of_their_own():
    two, named = (read_skeleton(INPUTS / f'{name}.bvh') for name in ('r30_two_end_sites', 'r43_end_site_named'))
    assert two.body_names == ('Hips', 'Leg', 'Leg_end', 'Leg_end2') and named.body_names[-1] == 'Toe'
    np.testing.assert_allclose(two.rest()[0][2:] - two.rest()[0][1], [[0.01, 0, 0], [0, -0.42, 0]], atol=1e-12)


@pytest.mark.parametrize('written, rate, words', [('120', 120, 'Hz'), ('33.3', 30.03, 'ms'), ('8.3333', 120, 'ms'),
                                                  ('7', 1 / 7, 'hardly')])
def test_a_frame_time_that_cannot_be_is_a_rate_or_milliseconds(tmp_path, written, rate, words):
    path = tmp_path / 'a.bvh'
    path.write_text((INPUTS / 'r46_frametime_fps.bvh').read_text().replace('Frame Time: 120', f'Frame Time: {written}'))
    assert warned(path, words).rate_hz == pytest.approx(rate, rel=1e-3)
    assert warned(path, 'asked for', rate_hz=50.0).rate_hz == pytest.approx(50)


# ---------------------------------------------------------------------------------------------- tables

def test_decimal_commas_between_semicolons():
    german, plain = warned(INPUTS / 'c01_german_excel.csv', 'decimal commas'), warned(INPUTS / 'c02_ms.csv', 'milli')
    np.testing.assert_allclose(german.positions, plain.positions, atol=1e-12)
    np.testing.assert_allclose(german.times, plain.times, atol=1e-12)


@pytest.mark.parametrize('name', ['c06b_degrees_paren', 'c06c_deg_underscore'])
def test_degrees_in_their_common_spellings(name, tmp_path):
    motion = quietly(INPUTS / f'{name}.csv')
    assert motion.joint_names == ('hip', 'knee') and np.abs(motion.positions).max() == pytest.approx(0.499, abs=1e-3)
    plain = tmp_path / 'plain.csv'
    plain.write_text((INPUTS / f'{name}.csv').read_text().replace(' (deg)', '').replace('_deg', ''))
    np.testing.assert_allclose(quietly(plain, unit='deg').positions, motion.positions, atol=1e-12)
    with pytest.warns(UserWarning, match=r'hip, knee passes a whole turn .*--unit deg'):
        read_recording(plain)


def test_a_unit_in_a_name_survives_writing(tmp_path):
    motion = Motion(('hip_deg', 'slide'), np.ones((3, 2)), [0, 0.1, 0.2], ('rad', 'm'))
    write_motion(motion, tmp_path / 'a.csv')
    again = read_motion(tmp_path / 'a.csv')
    assert again.joint_names == motion.joint_names and again.units == motion.units
    np.testing.assert_array_equal(again.positions, motion.positions)


def test_equal_stamps_of_rounded_times_become_an_even_rate():
    motion = warned(INPUTS / 'c04_dup_time.csv', r'25 of 50 stamps .* constant rate')
    assert motion.n_frames == 50 and motion.rate_hz == pytest.approx(200, rel=0.02)


def test_a_stamp_that_comes_twice_counts_once(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('time,hip\n0.000,1\n0.100,2\n0.100,3\n0.350,4\n')
    motion = warned(path, 'last row counts')
    assert motion.positions.ravel().tolist() == [1, 3, 4] and motion.times.tolist() == [0, 0.1, 0.35]


@pytest.mark.parametrize('header, stamps, rate, epoch_ns', [
    ('time_ms', ['0', '10', '20'], 100, 0), ('time [ns]', ['0', '10000000', '20000000'], 100, 0),
    ('Timestamp', ['1732990000000000000', '1732990000010000000', '1732990000020000000'], 100, 1732990000 * 10**9),
    ('time', ['1732990000.25', '1732990000.26', '1732990000.27'], 100, 1732990000250000000),
    ('time (us)', ['0', '5000', '10000'], 200, 0)])
@pytest.mark.filterwarnings('ignore:.*are taken as')
def test_times_in_other_units_and_since_1970(tmp_path, header, stamps, rate, epoch_ns):
    path = tmp_path / 'a.csv'
    path.write_text('\n'.join([f'{header},hip', *(f'{stamp},0.1' for stamp in stamps)]) + '\n')
    motion = read_recording(path)
    assert motion.rate_hz == pytest.approx(rate) and motion.times[0] == 0 and motion.epoch_ns == epoch_ns


@pytest.mark.parametrize('encoding', ['utf-16', 'utf-16-le', 'utf-16-be', 'utf-8-sig'])
def test_text_of_windows_programs(tmp_path, encoding):
    path = tmp_path / 'a.csv'
    path.write_bytes('time,hip\r\n0,0.5\r\n0.1,0.25\r\n'.encode(encoding))
    assert quietly(path).positions.ravel().tolist() == [0.5, 0.25]


def test_speeds_that_cannot_be_are_doubted(tmp_path):
    path = tmp_path / 'a.csv'
    times = np.arange(100) / 100
    write_motion(Motion(('hip', 'knee'), np.sin(2 * np.pi * times[:, None] * [1, 1.5]), times * 1e-3), path)
    with pytest.warns(UserWarning, match='faster than 100 rad/s'):
        read_recording(path)


# ---------------------------------------------------------------------------------------------- AMC, ASF, URDF, bags

def test_the_rate_of_an_amc_header_counts(tmp_path):
    motion = quietly(INPUTS / 'rate60.amc')
    assert motion.rate_hz == 60 and quietly(INPUTS / 'rate60.amc', rate_hz=30.0).rate_hz == 30
    with pytest.warns(UserWarning, match='other programs .* 120 Hz'):
        write_motion(motion, tmp_path / 'b.amc', skeleton_of(INPUTS / 'rate60.amc'))
    assert ':SAMPLES-PER-SECOND 60' in (tmp_path / 'b.amc').read_text()


def test_a_bone_that_changes_its_length(tmp_path):
    (tmp_path / 'a.asf').write_text((INPUTS / 'rate60.asf').read_text().replace('dof rx ry rz', 'dof rx ry rz l')
                                    .replace('limits (-90 90)', 'limits (-90 90)\n         (0 2)'))
    (tmp_path / 'a.amc').write_text(':FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 0 0 0 0 0\nleg 90 0 0 0.5\n')
    motion, skeleton = read_motion(tmp_path / 'a.amc'), skeleton_of(tmp_path / 'a.amc')
    assert motion.joint_names[-1] == 'leg.l' and motion.units[-1] == 'm'
    np.testing.assert_allclose(skeleton.forward(motion)[0, 1], [0, 0, -1.5 * 0.0254], atol=1e-12)


def test_a_floating_base_and_chains_of_mimic_joints(tmp_path):
    with pytest.warns(UserWarning, match='floating'):
        assert read_skeleton(INPUTS / 'floating.urdf').channel_names == ('hip',)
    joint = ('<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>'
             '<limit lower="-1" upper="1" effort="1" velocity="1"/>{3}</joint>')
    mimic = '<mimic joint="{0}" multiplier="{1}" offset="{2}"/>'
    text = '<robot name="r">' + ''.join(f'<link name="l{k}"/>' for k in range(4)) \
        + joint.format('a', 'l0', 'l1', '') + joint.format('b', 'l1', 'l2', mimic.format('a', 2, 0.1)) \
        + joint.format('c', 'l2', 'l3', mimic.format('b', -0.5, 0.2)) + '</robot>'
    path = tmp_path / 'r.urdf'
    path.write_text(text)
    skeleton = read_skeleton(path)
    _, turns = skeleton.poses(Motion(('a',), [[0.3]], [0.0]))
    b = 2 * 0.3 + 0.1
    expected = Rotation.from_euler('z', 0.3 + b + (-0.5 * b + 0.2)).as_matrix()
    np.testing.assert_allclose(turns[0, 3], expected, atol=1e-12)
    path.write_text(text.replace('joint name="a" type="revolute"><parent link="l0"/><child link="l1"/>',
                                 'joint name="a" type="revolute"><parent link="l0"/><child link="l1"/>'
                                 '<mimic joint="c"/>'))
    with pytest.raises(MotionError, match='mimics itself'):
        read_skeleton(path)


def bag_of(path, messages):
    """Write joint states: (stamp in ns, names, positions)."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, time = (store.types[name] for name in
                           (JOINT_STATE, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    with Writer(path, version=8) as bag:
        topic = bag.add_connection('/joint_states', JOINT_STATE, typestore=store)
        for k, (stamp, names, positions) in enumerate(messages):
            message = state(header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=''),
                            name=list(names), position=np.array(positions, dtype=float), velocity=np.empty(0),
                            effort=np.empty(0))
            bag.write(topic, stamp + k, store.serialize_cdr(message, JOINT_STATE))


def test_a_second_publisher_of_zeros_is_left_out(tmp_path):
    truth = np.sin(np.arange(60)[:, None] / 10 * [1, 2]) * 0.5
    start = 1_700_000_000 * 10**9
    bag_of(tmp_path / 'bag', [message for k, row in enumerate(truth) for message in (
        (start + k * 10**7, ('hip', 'knee'), row), (start + k * 10**7, ('knee', 'hip'), (0, 0)))])
    motion = warned(tmp_path / 'bag', '60 messages of zeros only|59 messages of zeros only')
    np.testing.assert_allclose(motion.joints(['hip', 'knee']).positions, truth, atol=1e-12)


def test_two_publishers_that_differ_are_named(tmp_path):
    start = 1_700_000_000 * 10**9
    bag_of(tmp_path / 'bag', [message for k in range(20) for message in (
        (start + k * 10**7, ('hip',), [0.3]), (start + k * 10**7, ('hip',), [0.4]))])
    assert (warned(tmp_path / 'bag', '20 stamps come again').positions == 0.4).all()


# ---------------------------------------------------------------------------------------------- which joints, who

@pytest.mark.parametrize('name, kept, out', [
    ('bandai2_walk_normal', 60, {'positions', 'root'}),
    ('ad_rokoko_dance', 63, {'positions', 'root', 'fingers and toes'}),
    ('pymo_motionbuilder_8walk', 54, {'positions', 'root', 'fingers and toes', 'end sites'}),
    ('bvhpython_mocapbank', 54, {'positions', 'root'}),
    ('ad_cmu_jumpingjacks', 78, {'positions', 'root', 'fingers and toes'})])
@pytest.mark.filterwarnings('ignore')
def test_the_body_is_found_in_skeletons_of_others(name, kept, out):
    path = wild(f'bvh/{name}.bvh')
    motion = read_recording(path)
    found = body_joints(motion, skeleton_of(path))
    assert len(found.names) == kept and set(found.left_out) == out
    assert found.names == body_joints(motion).names      # by names alone the same


def test_the_body_of_acclaim_recordings_is_what_it_was(trial):
    motion = trial('35_01')
    assert body_joints(motion, datasets.skeleton('35')).names == motion.select(*datasets.BODY).joint_names
    with_root = body_joints(motion, datasets.skeleton('35'), root=True)
    assert set(with_root.names) - set(body_joints(motion).names) == {f'root.{k}{a}' for k in 'tr' for a in 'xyz'}


def test_encoders_of_a_robot_all_count(gait):
    assert body_joints(gait).names == gait.joint_names
    arm = Motion(('spring_joint', 'string', 'waist_middle_joint', 'hip'), np.zeros((2, 4)), [0, 1])
    assert body_joints(arm).names == arm.joint_names


def test_different_skeletons_are_said():
    one = Motion([f'{joint}.rx' for joint in 'abcdef'], np.zeros((2, 6)), [0, 1], name='one')
    other = Motion([f'{joint}.rx' for joint in 'abuvwx'], np.zeros((2, 6)), [0, 1], name='other')
    with pytest.raises(MotionError, match=r"different skeletons .*'one'.*share 2 of 6"):
        common_joints([one, one, other])
    assert common_joints([one, other], ['a.*']).names == ('a.rx',)
    less = one.select('!f.rx')
    assert common_joints([one, less]).left_out == {'not in every recording': ('f.rx',)}


def test_who_is_who(tmp_path, capsys):
    files = [tmp_path / person / f'walk{k}.csv' for person in ('anna', 'bert') for k in (1, 2)]
    assert set(people_of(files).values()) == {'walk1', 'walk2'}
    assert set(people_of(files, 'folder').values()) == {'anna', 'bert'}
    assert capsys.readouterr().out.splitlines()[-1] == '2 people: anna (walk1, walk2), bert (walk1, walk2)'
    assert list(people_of([Path('sub01_walk.csv'), Path('sub02_run.csv')], 'sub{person}_*').values()) == ['01', '02']
    (tmp_path / 'people.csv').write_text('file,subject\nwalk1.csv,A\nwalk2.csv,B\n')
    assert set(people_of(files[:2], f'{tmp_path}/people.csv:subject').values()) == {'A', 'B'}
    with pytest.warns(UserWarning, match='one person'):
        people_of([Path('walk_1.csv'), Path('walk_2.csv')])
    with pytest.warns(UserWarning, match='person of its own'):
        people_of([Path('walk1.csv'), Path('walk2.csv')])
    for how, words in (('magic', 'takes'), ('x{person}', 'does not match'), (f'{tmp_path}/people.csv:subject', 'name')):
        with pytest.raises(UsageError, match=words):
            people_of([Path('other.csv')], how)


def test_evaluate_goes_on_after_a_broken_recording(tmp_path, trial, capsys):
    model = SOURCE.parents[2] / 'config' / 'models' / 'locomotion.npz'
    write_motion(trial('07_02').slice(0, 1.5), tmp_path / 'good.npz')
    (tmp_path / 'bad.csv').write_text('time,hip\n0,x\n')
    files = [str(tmp_path / name) for name in ('bad.csv', 'good.npz')]
    assert main(['evaluate', str(model), *files]) == 0
    shown = capsys.readouterr()
    assert '1 of 2 recordings could not be used' in shown.out and "'x' is not a number" in shown.err
    assert main(['evaluate', str(model), *files, '--json']) == 0
    assert list(json.loads(capsys.readouterr().out)['failed']) == files[:1]
    assert main(['evaluate', str(model), files[0]]) == 1


# ---------------------------------------------------------------------------------------------- files of others

@pytest.mark.parametrize('name, rate, height', [
    ('bandai2_walk_normal', 30, 1.6), ('ad_rokoko_dance', 100, 1.7), ('bvhpython_mocapbank', 30, 1.7)])
def test_people_of_others_stand_on_the_floor_at_their_height(name, rate, height):
    """2.8 m tall, or a metre above the floor, where positions add to OFFSET."""
    path = wild(f'bvh/{name}.bvh')
    motion, skeleton = quietly(path), skeleton_of(path)
    places = skeleton.forward(motion)
    assert motion.rate_hz == pytest.approx(rate, rel=1e-3)
    assert np.ptp(places[..., 1], axis=1).max() == pytest.approx(height, abs=0.25)
    assert abs(np.percentile(places[..., 1].min(axis=1), 10)) < 0.15


@pytest.mark.parametrize('name', ['op3', 'nao_v50', 'g1_29dof'])
@pytest.mark.filterwarnings('ignore')
def test_robots_of_others_are_read(name):
    skeleton = read_skeleton(wild(f'urdf/{name}.urdf'))
    assert len(skeleton.channel_names) >= 20 and np.isfinite(skeleton.rest()[0]).all()
