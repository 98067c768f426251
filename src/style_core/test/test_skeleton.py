"""Skeletons from files, forward kinematics against independent computations, mirroring by geometry."""
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from style_core import datasets
from style_core.errors import MotionError
from style_core.mirroring import partner_name
from style_core.motion import Motion
from style_core.skeleton import Body, Channel, Skeleton, euler_matrix, read_skeleton

ASF = """# made by hand
:version 1.10
:name two bones
:units
  mass 1.0
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name lthigh
    direction 0.6 -0.8 0
    length 10
    axis 10 20 30 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-inf 70.0)
  end
  begin
    name lshank
    direction 0 -1 0
    length 5
    axis 0 0 20 XYZ
    dof rx
    limits (-10.0 170.0)
  end
:hierarchy
  begin
    root lthigh
    lthigh lshank
  end
"""

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="tool"/><link name="finger"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0.2 0.5" rpy="0.1 0.2 0.3"/><axis xyz="0 2 0"/><limit lower="-1" upper="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/></joint>
  <joint name="mount" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0.1 0 0"/></joint>
  <joint name="grip" type="continuous"><parent link="tool"/><child link="finger"/><origin xyz="0 0.1 0"/>
    <axis xyz="0 0 1"/><mimic joint="shoulder" multiplier="-0.5" offset="0.1"/></joint>
</robot>
"""


def write(tmp_path, text, name):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_forward_kinematics_of_an_asf_agree_with_matrices_by_hand(tmp_path):
    skeleton = read_skeleton(write(tmp_path, ASF, 'two.asf'))
    assert skeleton.channel_names[6:] == ('lthigh.rx', 'lthigh.ry', 'lthigh.rz', 'lshank.rx')
    unit = 0.0254 / 0.45
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4, 10))
    motion = Motion(skeleton.channel_names, values, np.arange(4.0))
    places = skeleton.forward(motion)
    for row, place in zip(values, places):
        root = Rotation.from_euler('xyz', row[3:6])  # lower case: about fixed axes, x first
        frame = Rotation.from_euler('xyz', [10, 20, 30], degrees=True)
        thigh = root * frame * Rotation.from_euler('xyz', row[6:9]) * frame.inv()
        frame = Rotation.from_euler('z', 20, degrees=True)
        shank = thigh * frame * Rotation.from_euler('x', row[9]) * frame.inv()
        knee = row[:3] + thigh.apply([6 * unit, -8 * unit, 0])
        np.testing.assert_allclose(place, [row[:3], knee, knee + shank.apply([0, -5 * unit, 0])], atol=1e-12)


def test_limits_of_an_asf(tmp_path):
    skeleton = read_skeleton(write(tmp_path, ASF, 'two.asf'))
    low, high = skeleton.limits(['lthigh.rz', 'lshank.rx', 'root.tx'])
    np.testing.assert_allclose(low, [-np.inf, np.radians(-10), -np.inf])
    np.testing.assert_allclose(high, [np.radians(70), np.radians(170), np.inf])
    crlf = read_skeleton(write(tmp_path, ASF.replace('\n', '\r\n'), 'crlf.asf'))
    np.testing.assert_array_equal(crlf.rest()[0], skeleton.rest()[0])


def test_forward_kinematics_of_a_urdf_with_mimic_and_slide(tmp_path):
    skeleton = read_skeleton(write(tmp_path, URDF, 'arm.urdf'))
    assert skeleton.channel_names == ('shoulder', 'slide') and skeleton.up == 'z'
    motion = Motion(('slide', 'shoulder'), [[0.25, 0.7]], [0.0], units=('m', 'rad'))
    place = dict(zip(skeleton.body_names, skeleton.forward(motion)[0]))
    shoulder = Rotation.from_euler('xyz', [0.1, 0.2, 0.3]) * Rotation.from_euler('y', 0.7)
    tool = np.array([0, 0.2, 0.5]) + shoulder.apply([0.1, 0, 0.55])
    np.testing.assert_allclose(place['tool'], tool, atol=1e-12)
    np.testing.assert_allclose(place['finger'], tool + shoulder.apply([0, 0.1, 0]), atol=1e-12)
    _, rotations = skeleton.poses(motion)
    expected = shoulder * Rotation.from_euler('z', -0.5 * 0.7 + 0.1)
    np.testing.assert_allclose(rotations[0, -1], expected.as_matrix(), atol=1e-12)
    assert skeleton.limits(['shoulder'])[1] == 2


@pytest.mark.parametrize('change, words', [
    (('lthigh lshank', 'lthigh tail'), 'tail'),
    (('dof rx ry rz', 'dof rx ry'), 'limits'),
    (('dof rx ry rz', 'dof rx rx rz'), 'degrees of freedom'),
    (('length 10', 'length ten'), 'line 18'),
    (('name lshank', 'name lthigh'), 'twice'),
    (('root lthigh', 'root'), 'hang'),
    (('  end\n:hierarchy', ':hierarchy'), 'breaks off'),
    ((':hierarchy', ':other'), 'hierarchy'),
    (('lthigh lshank', 'lthigh lshank\n lshank root'), 'two parents'),
    (('length 0.45', 'length 0'), 'positive'),
])
def test_a_damaged_asf_is_refused_with_the_reason(tmp_path, change, words):
    with pytest.raises(MotionError, match=words):
        read_skeleton(write(tmp_path, ASF.replace(*change), 'bad.asf'))


@pytest.mark.parametrize('change, words', [
    (('</robot>', ''), 'XML'),
    (('<robot name="arm">', '<robot name="arm"><link name="base"/>'), 'unique'),
    (('type="fixed"', 'type="ball"'), 'ball'),
    (('<child link="lower"/>', '<child link="upper"/>'), 'two parents'),
    (('<child link="lower"/>', '<child link="nowhere"/>'), 'nowhere'),
    (('xyz="0 2 0"', 'xyz="0 0 0"'), 'zero length'),
    (('xyz="0 2 0"', 'xyz="0 x 0"'), 'finite number'),
    (('mimic joint="shoulder"', 'mimic joint="mount"'), 'mimics'),
    (('<parent link="base"/>', '<parent link="finger"/>'), 'loop'),
])
def test_a_damaged_urdf_is_refused_with_the_reason(tmp_path, change, words):
    with pytest.raises(MotionError, match=words):
        read_skeleton(write(tmp_path, URDF.replace(*change), 'bad.urdf'))


def test_unknown_channels_and_file_kinds_are_refused(tmp_path):
    skeleton = read_skeleton(write(tmp_path, URDF, 'arm.urdf'))
    with pytest.raises(MotionError, match='elbow'):
        skeleton.forward(Motion(('elbow',), [[0.0]], [0.0]))
    with pytest.raises(MotionError, match='skeletons are read from'):
        read_skeleton(tmp_path / 'x.sdf')


def test_real_walks_stand_on_the_floor_and_bones_keep_their_length(trial):
    skeleton = datasets.skeleton('35')
    motion = trial('35_01')
    places = skeleton.forward(motion)
    lowest = places[:, :, 1].min(axis=1)
    assert lowest.min() > -0.01 and lowest.max() < 0.06
    head = places[:, skeleton.body_names.index('head'), 1]
    assert head.min() > 1.4 and head.max() < 1.9
    for index, body in enumerate(skeleton.bodies):
        if body.parent >= 0:
            length = np.linalg.norm(places[:, index] - places[:, body.parent], axis=1)
            np.testing.assert_allclose(length, np.linalg.norm(body.tip), atol=1e-9)


def test_a_missing_knee_leaves_only_the_shank_open(trial):
    skeleton = datasets.skeleton('35')
    motion = trial('35_01')
    values = motion.positions.copy()
    values[5, motion.joint_names.index('ltibia.rx')] = np.nan
    missing = np.isnan(skeleton.forward(motion.replace(positions=values))).any(axis=2)
    open_bodies = {skeleton.body_names[b] for b in np.flatnonzero(missing[5])}
    assert open_bodies == {'ltibia', 'lfoot', 'ltoes'} and not np.delete(missing, 5, axis=0).any()


def symmetric(skeleton):
    """The skeleton with each pair of bones made exact mirror images; the middle in the plane."""
    names = skeleton.body_names
    bodies = []
    for body in skeleton.bodies:
        partner = skeleton.bodies[names.index(partner_name(body.name, names))]
        bodies.append(replace(body, tip=(body.tip + partner.tip * [-1, 1, 1]) / 2))
    return replace(skeleton, bodies=tuple(bodies))


@pytest.mark.parametrize('name', ['07_01', '09_01', '05_03', '131_09'])
def test_mirrored_walking_is_the_reflection_of_walking(trial, name):
    skeleton = symmetric(datasets.skeleton(name))
    motion = trial(name)
    partners = [skeleton.body_names.index(partner_name(body, skeleton.body_names)) for body in skeleton.body_names]
    reflected = skeleton.forward(motion)[:, partners] * [-1, 1, 1]
    for mirrored in (motion.mirror(), motion.mirror(datasets.skeleton(name))):
        np.testing.assert_allclose(skeleton.forward(mirrored), reflected, atol=1e-9)


def pair(axis_left, axis_right):
    def body(name, side, axis):
        return Body(name, 0, offset=np.array([0, 0.1 * side, 0.0]), channels=(Channel(name + '_joint', 'r', axis),))
    bodies = (Body('trunk', -1, channels=(Channel('yaw', 'r', (0.0, 0.0, 1.0)),)),
              body('left_leg', 1, axis_left), body('right_leg', -1, axis_right))
    return Skeleton('pair', bodies, ('yaw', 'left_leg_joint', 'right_leg_joint'), up='z')


@pytest.mark.parametrize('left, right, sign', [
    ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 1), ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), -1),
    ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), -1), ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 1)])
def test_a_robot_mirrors_by_the_axes_of_its_joints(left, right, sign):
    skeleton = pair(left, right)
    motion = Motion(skeleton.channel_names, [[0.1, 0.2, 0.3]], [0.0])
    np.testing.assert_allclose(motion.mirror(skeleton).positions, [[-0.1, sign * 0.3, sign * 0.2]])


def test_axes_that_are_no_mirror_images_are_refused():
    skeleton = pair((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    with pytest.raises(MotionError, match='mirror images'):
        Motion(skeleton.channel_names, [[0.1, 0.2, 0.3]], [0.0]).mirror(skeleton)


def test_euler_matrices_turn_about_fixed_axes():
    np.testing.assert_allclose(euler_matrix([0.3, -0.5, 0.7], 'ZXY'),
                               Rotation.from_euler('zxy', [0.3, -0.5, 0.7]).as_matrix(), atol=1e-12)
