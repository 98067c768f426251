"""A robot from its URDF file: boxes, cylinders, spheres and meshes as the file describes them, boxes else."""
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.skeleton import euler_matrix, read_skeleton
from style_core.view.figure import Figure, bone_parts, quaternions, turned_up

__all__ = ['Mesh', 'robot_figure']

_PLAIN = (150, 158, 168)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh file that a link wears.

    Attributes
    ----------
    path : Path
    body : int
        The link, as in ``Figure.body_names``.
    position, rotation : ndarray, shape (3,) and (3, 3)
        Of the mesh in the link.
    scale : ndarray, shape (3,)
    """

    path: Path
    body: int
    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray


def robot_figure(motion, path):
    """A robot's parts over a motion of its joints.

    Parameters
    ----------
    motion : Motion
        Channels named as the robot's joints; absent ones stay at rest.
    path : path-like
        URDF file.

    Returns
    -------
    figure : Figure
        Links without any visual that can be drawn are bones between their joints.
    meshes : tuple of Mesh
        Those whose file is there.
    missing : tuple of str
        Names of mesh files that are not there: their links wear nothing.
    """
    path = Path(path)
    skeleton = read_skeleton(path)
    points, rotations = turned_up(skeleton, *skeleton.poses(motion))
    shapes, places, turns, sizes, colours, meshes, missing = [], [], [], [], [], [], []
    index = {name: body for body, name in enumerate(skeleton.body_names)}
    robot = ElementTree.fromstring(read_text(path).split('?>', 1)[-1].strip())
    shared = {item.get('name'): item for item in robot.findall('material') if item.find('color') is not None}
    for link in robot.findall('link'):
        body = index[link.get('name')]
        for visual in link.findall('visual'):
            position, rotation = _origin(path, visual.find('origin'))
            shape, value = _geometry(path, link.get('name'), visual)
            if shape == 'mesh':
                file = _found(path, value.get('filename', ''))
                if file is None:
                    missing.append(value.get('filename', ''))
                else:
                    meshes.append(Mesh(file, body, position, rotation, _numbers(path, value.get('scale', '1 1 1'), 3)))
                continue
            shapes.append(shape)
            places.append(points[:, body] + rotations[:, body] @ position)
            turns.append(quaternions(rotations[:, body] @ rotation))
            sizes.append(value)
            colours.append(_colour(path, visual, shared))
    if shapes or meshes:
        count, parts = len(motion.times), len(shapes)
        drawn = (tuple(shapes), _stacked(places, count, 3), _stacked(turns, count, 4),
                 np.broadcast_to(np.reshape(np.array(sizes, dtype=np.float32), (1, parts, 3)), (count, parts, 3)),
                 np.reshape(np.array(colours, dtype=np.uint8), (parts, 3)))
    else:
        drawn = bone_parts(skeleton, points, _PLAIN)
    figure = Figure(motion.name, motion.times, *drawn, skeleton.body_names, points, rotations)
    return figure, tuple(meshes), tuple(missing)


def _stacked(columns, count, width):
    return np.stack(columns, axis=1).astype(np.float32) if columns else np.zeros((count, 0, width), np.float32)


def _geometry(path, link, visual):
    """Shape and size, or ``'mesh'`` and its element."""
    geometry = visual.find('geometry')
    for element in () if geometry is None else geometry:
        if element.tag == 'box':
            return 'box', _numbers(path, element.get('size', ''), 3)
        if element.tag == 'cylinder':
            radius, length = (_numbers(path, element.get(key, ''), 1)[0] for key in ('radius', 'length'))
            return 'cylinder', np.array([2 * radius, 2 * radius, length])
        if element.tag == 'sphere':
            return 'sphere', np.repeat(2 * _numbers(path, element.get('radius', ''), 1), 3)
        if element.tag == 'mesh':
            return 'mesh', element
    raise MotionError(f'{path}: a visual of link {link} has no box, cylinder, sphere or mesh')


def _found(path, name):
    """The mesh file: as it is named, beside the robot's file, or in the package folder above it."""
    words = name.split('://', 1)[-1]
    package, _, inside = words.partition('/')
    places = [path.parent / words]
    if name.startswith('package://'):
        places = [folder / inside for folder in path.resolve().parents if folder.name == package]
        places += [folder / words for folder in path.resolve().parents]
    return next((place for place in places if place.is_file()), None) if words else None


def _origin(path, element):
    if element is None:
        return np.zeros(3), np.eye(3)
    return (_numbers(path, element.get('xyz', '0 0 0'), 3),
            euler_matrix(_numbers(path, element.get('rpy', '0 0 0'), 3), 'XYZ'))


def _colour(path, visual, shared):
    material = visual.find('material')
    if material is None:
        return _PLAIN
    colour = material.find('color')
    if colour is None and material.get('name') in shared:
        colour = shared[material.get('name')].find('color')
    if colour is None:
        return _PLAIN
    return np.clip(_numbers(path, colour.get('rgba', ''), 4)[:3] * 255, 0, 255).round()


def _numbers(path, text, count):
    try:
        values = np.array([number(word) for word in text.split()], dtype=float)
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise MotionError(f'{path}: {text[:40]!r} should be {count} finite number{"s" * (count > 1)}')
    return values
