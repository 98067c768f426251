"""Combinations of joints, limits that are never passed, and the map computed from orientations."""
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from style_core.cli import main as motion_style
from style_core.errors import ModelError
from style_core.motion import Motion
from style_core.skeleton import read_skeleton
from style_core.synthesis.orientation_fit import best_angles, directions_of, error_deg, fit_map, read_plan
from style_core.synthesis.retargeting import Robot, RobotJoint, plain_robot, read_robot, write_robot

ROBOTS = Path(__file__).resolve().parents[3] / 'config' / 'robots'
OP3 = {f'{side}_{joint}' for side in 'lr' for joint in (
    'sho_pitch', 'sho_roll', 'el', 'hip_yaw', 'hip_roll', 'hip_pitch', 'knee', 'ank_pitch', 'ank_roll')} \
    | {'head_pan', 'head_tilt'}


@given(st.lists(st.floats(-20, 20), min_size=2, max_size=2), st.floats(-3, 3), st.floats(0.01, 2),
       st.lists(st.floats(-10, 10), min_size=2, max_size=2), st.lists(st.floats(-50, 50), min_size=2, max_size=2))
def test_limits_hold_and_velocities_are_the_derivative(gains, lower, wide, pose, speed):
    robot = Robot('r', {'a': RobotJoint({'x': gains[0], 'y': gains[1]}, 0.1, (lower, lower + wide))}).bind(('x', 'y'))
    pose, speed = np.array(pose), np.array(speed)

    def at(time):
        return robot.limit(*robot.combine(pose + time * speed, speed))
    position, velocity = at(0.0)
    assert lower <= position[0] <= lower + wide
    step = 1e-7 / (1 + np.abs(robot.gain @ speed).max())
    slope = (at(step)[0] - at(-step)[0]) / (2 * step)
    np.testing.assert_allclose(velocity, slope, atol=1e-3 * (1 + np.abs(robot.gain @ speed).max()))


def test_inside_its_limits_a_combination_is_exact():
    robot = Robot('r', {'a': RobotJoint({'x': 2.0, 'z': -1.0}, 0.25, (-9.0, 9.0)), 'b': RobotJoint({}, 0.5)})
    bound = robot.bind(('x', 'y', 'z'))
    position, velocity = bound.limit(*bound.combine(np.array([[1.0, 7.0, 0.5]]), np.array([[0.1, 7.0, 0.2]])))
    np.testing.assert_allclose(position, [[1.75, 0.5]])
    np.testing.assert_allclose(velocity, [[0.0, 0.0]], atol=1e-15)


def test_binding_says_what_is_missing():
    with pytest.raises(ModelError, match='knee'):
        Robot('r', {'a': RobotJoint({'knee': 1.0})}).bind(('hip',))
    with pytest.raises(ModelError, match='no joints'):
        Robot('r', {}).bind(('hip',))
    assert plain_robot().bind(('hip', 'knee')).joint_names == ('hip', 'knee')


@pytest.mark.parametrize('text', [
    '[]', 'joints: 3', 'extra: 1', 'joints: {a: {from: [x]}}', 'joints: {a: {sign: 2, from: x}}', 'joints: {a: 7}',
    'joints: {a: {scale: -1, from: x}}', 'joints: {a: {from: {x: .nan}}}', 'joints: {a: {limits: [1, 0]}}',
    'joints: {a: {limits: 1}}', 'joints: {a: {velocity: 0}}', 'joints: {a: {velocity: fast}}',
    'defaults: {speed: 1}', 'defaults: {acceleration: -1}\njoints: {a: {from: x}}',
    'joints: {a: {offset: much}}', 'unlisted: perhaps', 'a: [', '{a: &a [*a]}'])
def test_bad_robot_files_are_refused(tmp_path, text):
    (tmp_path / 'robot.yaml').write_text(text)
    with pytest.raises(ModelError):
        read_robot(tmp_path / 'robot.yaml')


def test_robot_files_round_trip(tmp_path):
    robot = Robot('r', {'a': RobotJoint({'x': 2.0, 'y': -0.5}, 0.25, (-1.0, 1.0), 3.0, 40.0),
                        'b': RobotJoint({}, 0.5, velocity=4.0), 'c': RobotJoint({}, velocity=4.0)}, 'r.urdf')
    write_robot(robot, tmp_path / 'r.yaml', 'two\nlines')
    again = read_robot(tmp_path / 'r.yaml')
    assert (again.name, again.joints, again.urdf) == ('r', dict(robot.joints), 'r.urdf')
    (tmp_path / 's.yaml').write_text('joints: {a: {from: x, sign: -1, scale: 2.0, offset: 1}}')
    assert read_robot(tmp_path / 's.yaml').joints['a'] == RobotJoint({'x': -2.0}, 1.0)


# --- shipped robots ---------------------------------------------------------------------------------------------

@pytest.mark.parametrize('path', sorted(ROBOTS.glob('*.urdf')), ids=lambda path: path.stem)
def test_descriptions_are_strictly_well_formed(path):
    """What check_urdf checks: unique names, one root, every joint with parent, child, axis and limits, no loops."""
    root = ElementTree.parse(path).getroot()
    assert root.tag == 'robot' and root.get('name')
    assert {child.tag for child in root} == {'link', 'joint'}
    links = [link.get('name') for link in root.findall('link')]
    joints = root.findall('joint')
    assert len(set(links)) == len(links)
    assert len({joint.get('name') for joint in joints}) == len(joints) == len(links) - 1
    children = [joint.find('child').get('link') for joint in joints]
    assert len(set(children)) == len(children) and set(children) < set(links)
    assert all(joint.find('parent').get('link') in links for joint in joints)
    for joint in joints:
        assert joint.get('type') in ('revolute', 'fixed')
        assert len(joint.find('origin').get('xyz').split()) == 3
        if joint.get('type') == 'revolute':
            assert abs(np.linalg.norm([float(x) for x in joint.find('axis').get('xyz').split()]) - 1) < 1e-3
            limit = joint.find('limit')
            assert float(limit.get('lower')) < float(limit.get('upper'))
            assert float(limit.get('effort')) > 0 and float(limit.get('velocity')) > 0
    for box in root.iter('box'):
        assert all(float(x) > 0 for x in box.get('size').split())
    skeleton = read_skeleton(path)      # walks the tree: refuses loops and several roots
    assert len(skeleton.bodies) == len(links)


@pytest.mark.parametrize('path', sorted(ROBOTS.glob('*.urdf')), ids=lambda path: path.stem)
def test_a_parser_of_others_accepts_the_descriptions(path):
    """The one that ROS tools use; it insists on effort and velocity of limits."""
    urdf = pytest.importorskip('urdf_parser_py.urdf', reason='urdf_parser_py is not installed')
    robot = urdf.URDF.from_xml_file(str(path))
    skeleton = read_skeleton(path)
    assert robot.get_root() == skeleton.body_names[0]
    moving = {joint.name: joint for joint in robot.joints if joint.type != 'fixed'}
    assert set(moving) == set(skeleton.channel_names)
    low, high = skeleton.limits(tuple(moving))
    np.testing.assert_allclose([joint.limit.lower for joint in moving.values()], low)
    np.testing.assert_allclose([joint.limit.upper for joint in moving.values()], high)
    assert not any(hasattr(visual.geometry, 'filename') for link in robot.links for visual in link.visuals), 'a mesh'


@pytest.mark.parametrize('name', ['humanoid20', 'exosuit6'])
def test_map_chain_and_description_agree_on_what_motors_can_do(name):
    robot = read_robot(ROBOTS / f'{name}.yaml')
    chain = yaml.safe_load((ROBOTS.parent / 'servo' / f'{name}.yaml').read_text())
    said = {joint.get('name'): float(joint.find('limit').get('velocity'))
            for joint in ElementTree.parse(ROBOTS / f'{name}.urdf').getroot().iter('joint')
            if joint.find('limit') is not None}
    for joint, own in robot.joints.items():
        servo = {**chain['defaults'], **chain['joints'][joint]}
        assert own.velocity == said[joint] == servo['velocity']
        assert own.acceleration == servo['acceleration']


def test_the_humanoid_has_the_joints_and_limits_of_the_op3():
    skeleton, robot = read_skeleton(ROBOTS / 'humanoid20.urdf'), read_robot(ROBOTS / 'humanoid20.yaml')
    assert set(skeleton.channel_names) == set(robot.joints) == OP3
    for low, high in zip(*skeleton.limits(skeleton.channel_names)):
        assert (low, high) == pytest.approx((-0.6 * math.pi, 0.6 * math.pi), abs=1e-4)


@pytest.mark.parametrize('name', ['humanoid20', 'exosuit6'])
def test_maps_and_descriptions_name_the_same_joints_and_limits(name):
    skeleton, robot = read_skeleton(ROBOTS / f'{name}.urdf'), read_robot(ROBOTS / f'{name}.yaml')
    assert set(skeleton.channel_names) == set(robot.joints)
    low, high = skeleton.limits(skeleton.channel_names)
    for joint, a, b in zip(skeleton.channel_names, low, high):
        assert robot.joints[joint].limits == pytest.approx((a, b), abs=1e-4)


@pytest.mark.parametrize('name', ['humanoid20', 'exosuit6'])
def test_the_bridge_knows_the_same_joints(name):
    chain = yaml.safe_load((ROBOTS.parent / 'servo' / f'{name}.yaml').read_text())
    assert set(chain['joints']) == set(read_robot(ROBOTS / f'{name}.yaml').joints)


# --- orientation matching ---------------------------------------------------------------------------------------

def test_a_robot_is_matched_to_itself_exactly(tmp_path):
    """The exosuit as the person: every joint must come out as itself."""
    plan_text = (ROBOTS / 'exosuit6_plan.yaml').read_text()
    names = {'lfemur': 'left_thigh', 'rfemur': 'right_thigh', 'ltibia': 'left_shank', 'rtibia': 'right_shank',
             'lfoot': 'left_foot', 'rfoot': 'right_foot'}
    plan = yaml.safe_load(plan_text)
    plan['urdf'] = str(ROBOTS / 'exosuit6.urdf')
    for match in plan['match']:
        # a URDF body sits at its joint, so its own bone is not the one to its parent: match by its up axis
        match.update(body=names[match['body']], to='up' if match['along'] == [0, 0, -1] else match['to'],
                     base='pelvis', along=[0, 0, 1] if match['along'] == [0, 0, -1] else match['along'])
    joints = ('left_hip', 'left_knee', 'left_ankle', 'right_hip', 'right_knee', 'right_ankle')
    plan['inputs'] = {joint: list(joints) for joint in joints}
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump(plan))
    plan = read_plan(tmp_path / 'plan.yaml')
    skeleton = read_skeleton(ROBOTS / 'exosuit6.urdf')
    low, high = skeleton.limits(joints)
    rng = np.random.default_rng(0)
    angles = low + (high - low) * rng.uniform(0.1, 0.9, (60, 6))
    motion = Motion(joints, angles, np.arange(60) / 20)
    targets = directions_of(plan, motion, skeleton)
    found = best_angles(plan, targets)
    order = [plan.robot.channel_names.index(joint) for joint in joints]
    np.testing.assert_allclose(found[:, order], angles, atol=1e-3)
    assert error_deg(plan, found, targets).max() < 0.1
    robot = fit_map(plan, [motion], [targets])
    for joint in joints:
        gains = robot.joints[joint].terms
        assert gains[joint] == pytest.approx(1.0, abs=0.05)
        assert max(abs(gain) for name, gain in gains.items() if name != joint) < 0.05


@pytest.mark.parametrize('name, legs, arms', [('humanoid20', 4.0, 9.0), ('exosuit6', 9.0, 0.0)])
def test_shipped_maps_match_people_they_were_not_fitted_to(trial, name, legs, arms):
    """Legs (and upper arms) point where the person's do; the figures stand in docs/retargeting.md."""
    from style_core.datasets import BODY, trial_path
    from style_core.formats import skeleton_of
    plan, robot = read_plan(ROBOTS / f'{name}_plan.yaml'), read_robot(ROBOTS / f'{name}.yaml')
    motion = trial('16_35', 20.0).select(*BODY)
    targets = directions_of(plan, motion, skeleton_of(trial_path('16_35')))
    bound = robot.bind(motion.joint_names)
    angles, _ = bound.limit(*bound.combine(motion.positions, motion.positions))
    order = [bound.joint_names.index(joint) for joint in plan.robot.channel_names]
    errors = error_deg(plan, angles[:, order], targets).mean(axis=0)
    for match, error in zip(plan.matches, errors):
        if match.to == 'bone' and match.body.endswith(('femur', 'tibia')):
            assert error < legs, match
        if match.body.endswith('humerus'):
            assert error < arms, match


def test_the_command_fits_and_reports(tmp_path, trial, capsys):
    from style_core.datasets import trial_path
    path = str(trial_path('08_02'))
    out = tmp_path / 'robot.yaml'
    assert motion_style(['retarget', str(ROBOTS / 'exosuit6_plan.yaml'), path, '--rate', '10', '--test', path, '-o',
                         str(out)]) == 0
    assert 'linear map' in capsys.readouterr().out
    assert set(read_robot(out).joints) == set(read_robot(ROBOTS / 'exosuit6.yaml').joints)


@pytest.mark.parametrize('change', ['name', 'urdf', 'match', 'inputs'])
def test_incomplete_plans_are_refused(tmp_path, change):
    plan = yaml.safe_load((ROBOTS / 'exosuit6_plan.yaml').read_text())
    plan['urdf'] = str(ROBOTS / 'exosuit6.urdf')
    del plan[change]
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump(plan))
    with pytest.raises(ModelError):
        read_plan(tmp_path / 'plan.yaml')
