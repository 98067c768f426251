"""Robot descriptions (``.urdf``): the kinematic tree only."""
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.skeleton import Body, Channel, Skeleton, euler_matrix

__all__ = ['read_skeleton']

_MOVING = {'revolute': 'r', 'continuous': 'r', 'prismatic': 't'}
_FREE = ('floating', 'planar')


def read_skeleton(path):
    """Read a URDF file; see `style_core.skeleton.read_skeleton`.

    Channels have the joints' names; a mimic joint follows the channel of the joint it mimics, also over other mimic
    joints. Bodies are links and sit at the joint that carries them. What floats or slides freely (``floating``,
    ``planar``) is no joint with a position: it stays at its origin, and a UserWarning says so.
    """
    try:
        # bytes as text: an encoding named in the file has been taken care of
        robot = ElementTree.fromstring(read_text(path).split('?>', 1)[-1].strip())
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise MotionError(f'{path} is not well-formed XML: {error}') from None
    if robot.tag != 'robot':
        raise MotionError(f'{path} describes a <{robot.tag[:40]}>, not a <robot>')
    links = [_attribute(path, link, 'name') for link in robot.findall('link')]
    joints = {_attribute(path, joint, 'name'): joint for joint in robot.findall('joint')}
    if len(set(links)) != len(links) or len(joints) != len(robot.findall('joint')):
        raise MotionError(f'{path}: names of links and joints must be unique')
    children, carried = {}, set()
    for name, joint in joints.items():
        parent, child = (_attribute(path, _child(path, joint, tag), 'link') for tag in ('parent', 'child'))
        for link in (parent, child):
            if link not in links:
                raise MotionError(f'{path}: joint {name} names the link {link!r}, which is not there')
        if child in carried:
            raise MotionError(f'{path}: link {child} has two parents')
        carried.add(child)
        children.setdefault(parent, []).append((name, child))
    roots = [link for link in links if link not in carried]
    if len(roots) != 1:
        raise MotionError(f'{path}: a robot needs one root link, found {len(roots)}: {", ".join(roots[:5])}')
    bodies, todo = [], [(None, roots[0], -1)]
    while todo:
        joint, link, parent = todo.pop()
        todo.extend((name, child, len(bodies)) for name, child in reversed(children.get(link, [])))
        bodies.append(Body(link, parent) if joint is None else _body(path, joints, joint, link, parent))
    if len(bodies) != len(links):
        raise MotionError(f'{path}: {len(links) - len(bodies)} links form a loop')
    own = {channel.name for body in bodies for channel in body.channels}
    names = tuple(name for name in joints if name in own)
    if not names:
        raise MotionError(f'{path}: no joint moves')
    return Skeleton(robot.get('name', path.stem), tuple(bodies), names, up='z')


def _body(path, joints, name, link, parent):
    joint = joints[name]
    kind = _attribute(path, joint, 'type')
    origin = joint.find('origin')
    offset = _vector(path, name, origin, 'xyz', (0, 0, 0))
    before = euler_matrix(_vector(path, name, origin, 'rpy', (0, 0, 0)), 'XYZ')
    if kind in _FREE:
        warnings.warn(f'{path}: joint {name} is {kind}: link {link} is taken as fixed at its origin', stacklevel=4)
    if kind == 'fixed' or kind in _FREE:
        return Body(link, parent, offset, before)
    if kind not in _MOVING:
        raise MotionError(f'{path}: joint {name} is of type {kind!r}; only revolute, continuous, prismatic, fixed, '
                          f'floating and planar joints are known')
    axis = _vector(path, name, joint.find('axis'), 'xyz', (1, 0, 0))
    norm = np.linalg.norm(axis)
    if norm == 0:
        raise MotionError(f'{path}: joint {name} has an axis of zero length')
    limit = joint.find('limit')
    low, high = -np.inf, np.inf
    if limit is not None and kind != 'continuous':
        low, high = (_number(path, name, limit.get(key, '0')) for key in ('lower', 'upper'))
    source, scale, bias = _followed(path, joints, name)
    if source != name:
        low, high = -np.inf, np.inf  # the joint that is mimicked has the limits
    channel = Channel(source, _MOVING[kind], tuple(axis / norm), low, high, scale, bias)
    return Body(link, parent, offset, before, (channel,))


def _followed(path, joints, name):
    """The joint that moves a joint, and scale and offset of ``value = scale * its value + offset``."""
    source, scale, bias, passed = name, 1.0, 0.0, [name]
    while joints[source].find('mimic') is not None:
        mimic = joints[source].find('mimic')
        bias += scale * _number(path, source, mimic.get('offset', '0'))
        scale *= _number(path, source, mimic.get('multiplier', '1'))
        source = _attribute(path, mimic, 'joint')
        if source in passed:
            raise MotionError(f'{path}: joint {name} mimics itself: {" -> ".join([*passed, source])}')
        if source not in joints or joints[source].get('type') not in _MOVING:
            raise MotionError(f'{path}: joint {passed[-1]} mimics {source!r}, which is no joint that moves by itself')
        passed.append(source)
    return source, scale, bias


def _child(path, element, tag):
    child = element.find(tag)
    if child is None:
        raise MotionError(f'{path}: joint {element.get("name")} has no <{tag}>')
    return child


def _attribute(path, element, key):
    value = element.get(key)
    if not value:
        raise MotionError(f'{path}: a <{element.tag}> has no {key}')
    return value


def _vector(path, name, element, key, default):
    if element is None or element.get(key) is None:
        return np.array(default, dtype=float)
    words = element.get(key).split()
    if len(words) != 3:
        raise MotionError(f'{path}: joint {name}: {key}="{element.get(key)[:40]}" should be three numbers')
    return np.array([_number(path, name, word) for word in words])


def _number(path, name, word):
    try:
        value = number(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise MotionError(f'{path}: joint {name}: {word[:40]!r} is not a finite number')
    return value
