"""What the view draws, without any viewer: parts where forward kinematics has them, bodies on the floor."""
from pathlib import Path

import numpy as np
import pytest

from style_core.motion import Motion
from style_core.skeleton import read_skeleton
from style_core.view import contacts_of, figure_of, walked
from style_core.view.figure import quaternions
from style_core.view.robot import robot_figure
from style_core.view.shapes import UNIT

CONFIG = Path(__file__).parents[3] / 'config'
pytestmark = pytest.mark.skipif(not CONFIG.is_dir(), reason='needs the config folder of the repository')


@pytest.fixture(scope='module')
def person():
    return read_skeleton(CONFIG / 'skeletons' / 'person.asf')


def legs(frames=120, rate=60.0):
    """Legs that swing against each other, without a root."""
    times = np.arange(frames) / rate
    swing = 0.4 * np.sin(2 * np.pi * 0.9 * times)
    bend = 0.4 + 0.4 * np.sin(2 * np.pi * 0.9 * times - 1.5)
    return Motion(('lfemur.rx', 'rfemur.rx', 'ltibia.rx', 'rtibia.rx'), np.stack([swing, -swing, bend, 0.8 - bend], 1),
                  times, name='legs')


def turned(wxyz, vector):
    """A vector turned by a quaternion, by the definition q v q*."""
    w, axis = wxyz[0], np.asarray(wxyz[1:], dtype=float)
    return vector + 2 * w * np.cross(axis, vector) + 2 * np.cross(axis, np.cross(axis, vector))


def test_a_bone_reaches_from_its_parent_to_its_body(person):
    motion = legs()
    figure = figure_of(motion, person)
    ends = person.forward(motion)[..., [2, 0, 1]]       # y up to z up
    names, bones = person.body_names, np.arange(len(figure.shapes))
    joined = np.array([[body.parent, number] for number, body in enumerate(person.bodies) if body.parent >= 0])
    spans = {tuple(np.round(np.sort(span.ravel()), 4)) for span in ends[37][joined]}
    for bone in bones:
        half = turned(figure.wxyzs[37, bone], np.array([0, 0, figure.scales[37, bone, 2] / 2]))
        drawn = np.array([figure.positions[37, bone] - half, figure.positions[37, bone] + half])
        assert tuple(np.round(np.sort(drawn.ravel()), 4)) in spans or min(
            np.abs(np.sort(drawn.ravel()) - np.array(span)).max() for span in spans) < 2e-4
    assert len(bones) >= 25 and figure.shapes.count('head') == 1 and len(names) == figure.points.shape[1]


def test_a_missing_angle_leaves_only_what_hangs_on_it_open(person):
    motion = legs()
    positions = motion.positions.copy()
    positions[5, 2] = np.nan
    figure = figure_of(motion.replace(positions=positions), person)
    unknown = {figure.body_names[body] for body in np.flatnonzero(np.isnan(figure.points[5]).any(axis=1))}
    assert unknown == {'ltibia', 'lfoot', 'ltoes'}
    assert np.isfinite(figure.points[6]).all()


def test_a_body_without_a_root_stands_and_does_not_slide(person):
    figure = walked(figure_of(legs(), person))
    feet = [index for index, name in enumerate(figure.body_names) if 'foot' in name or 'toes' in name]
    points = figure.points[:, feet]
    assert np.abs(points[..., 2].min(axis=1)).max() < 1e-9
    # at every step one of the sole's points keeps its place on the floor
    slip = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=2).min(axis=1)
    assert slip.max() < 1e-9
    assert np.ptp(figure.points[:, 0, :2], axis=0).max() > 0.2      # and it gets on


def test_contacts_change_feet_in_a_walk(person):
    left, right = contacts_of(walked(figure_of(legs(240), person)))
    assert (left.foot, right.foot) == ('left', 'right')
    assert 0.2 < left.on_ground.mean() < 0.95 and 0.2 < right.on_ground.mean() < 0.95
    assert (left.on_ground != right.on_ground).mean() > 0.2


def test_frames_are_found_by_time(person):
    figure = figure_of(legs(), person)
    assert [figure.frame_at(second) for second in (-1.0, 0.0, 1.0, 1.0099, 99.0)] == [0, 0, 60, 60, 119]


@pytest.mark.parametrize('shape', UNIT)
def test_unit_meshes_are_closed_and_face_outwards(shape):
    vertices, faces = UNIT[shape]()
    assert np.allclose(np.ptp(vertices, axis=0), 1, atol=0.06)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert {tuple(edge) for edge in edges} == {tuple(edge) for edge in edges[:, ::-1]}
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert (np.einsum('ij,ij->i', np.cross(b - a, c - a), a + b + c) > 0).all()


URDF = """<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><geometry><box size="1 2 3"/></geometry>
<material name="red"/></visual></link>
<link name="arm"><visual><geometry><cylinder radius="0.1" length="0.5"/></geometry></visual>
<visual><geometry><mesh filename="package://r/meshes/arm.stl"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 1 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2"/></joint></robot>"""


def test_a_robot_is_drawn_as_its_file_says(tmp_path):
    (tmp_path / 'r.urdf').write_text(URDF)
    motion = Motion(('j',), [[0.0], [np.pi / 2]], [0.0, 1.0])
    figure, meshes, missing = robot_figure(motion, tmp_path / 'r.urdf')
    assert figure.shapes == ('box', 'cylinder') and missing == ('package://r/meshes/arm.stl',) and not meshes
    np.testing.assert_allclose(figure.scales[0], [[1, 2, 3], [0.2, 0.2, 0.5]], rtol=1e-6)
    np.testing.assert_allclose(figure.positions[1], [[0, 0, 1], [0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(turned(figure.wxyzs[1, 1], np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-6)
    assert figure.colours[0].tolist() == [255, 0, 0]


def test_a_mesh_is_found_in_its_package(tmp_path):
    (tmp_path / 'r' / 'meshes').mkdir(parents=True)
    (tmp_path / 'r' / 'meshes' / 'arm.stl').write_bytes(b'')
    (tmp_path / 'r' / 'r.urdf').write_text(URDF)
    _, (mesh,), missing = robot_figure(Motion(('j',), [[0.0]], [0.0]), tmp_path / 'r' / 'r.urdf')
    assert mesh.path.name == 'arm.stl' and not missing


def test_quaternions_turn_as_their_matrices():
    from style_core.angles import rotation_about
    matrices = np.array([rotation_about((0.6, 0, 0.8), np.array([angle]))[0] for angle in np.linspace(-3, 3, 7)])
    for wxyz, matrix in zip(quaternions(matrices), matrices):
        np.testing.assert_allclose(turned(wxyz, np.array([1.0, 2, 3])), matrix @ [1, 2, 3], atol=1e-12)


def test_robots_of_this_suite_agree_with_yourdfpy():
    yourdfpy = pytest.importorskip('yourdfpy')
    for name in ('humanoid20', 'exosuit6'):
        path = CONFIG / 'robots' / f'{name}.urdf'
        robot = yourdfpy.URDF.load(str(path), build_scene_graph=True, load_meshes=False)
        joints = tuple(robot.actuated_joint_names)
        values = np.linspace(-0.6, 0.5, len(joints))
        robot.update_cfg(values)
        figure, _, _ = robot_figure(Motion(joints, [values], [0.0]), path)
        expected = [(robot.get_transform(link) @ (np.eye(4) if visual.origin is None else visual.origin))[:3, 3]
                    for link, item in robot.link_map.items() for visual in item.visuals]
        np.testing.assert_allclose(figure.positions[0], expected, atol=1e-5)


def test_the_lowest_level_is_that_of_the_corners(tmp_path):
    from style_core.view.recording import lowest_level
    (tmp_path / 'r.urdf').write_text(URDF)
    figure, _, _ = robot_figure(Motion(('j',), [[0.0], [1.0]], [0.0, 1.0]), tmp_path / 'r.urdf')
    corners = UNIT['box']()[0]
    expected = [min((figure.positions[frame, part] + turned(figure.wxyzs[frame, part], corner * scale))[2]
                    for part, scale in enumerate(figure.scales[frame]) for corner in corners) for frame in (0, 1)]
    np.testing.assert_allclose(lowest_level(figure), expected, atol=1e-5)
