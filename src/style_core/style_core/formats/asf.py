"""Acclaim skeleton files (``.asf``)."""
import re

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.skeleton import Body, Channel, Skeleton, euler_matrix

__all__ = ['read_skeleton']

_INCH_M = 0.0254
_DOFS = ('tx', 'ty', 'tz', 'rx', 'ry', 'rz')
#: a bone may also change its length
_BONE_DOFS = (*_DOFS, 'l')


def read_skeleton(path):
    """Read an ASF file; see `style_core.skeleton.read_skeleton`.

    A bone's frame is turned by its ``axis`` angles, its degrees of freedom turn it within that frame, the first axis
    of the order first, and its body sits at the far end of the bone. Lengths are inches divided by the file's
    ``length``.
    """
    sections = _sections(path, read_text(path))
    for needed in ('root', 'bonedata', 'hierarchy'):
        if needed not in sections:
            raise MotionError(f'{path} has no :{needed} section; is this an ASF file?')
    units = {words[0].lower(): words[1] for _, words in sections.get('units', []) if len(words) > 1}
    scale = _numbers(path, 0, [units.get('length', '1')], 1)[0]
    if scale <= 0:
        raise MotionError(f'{path}: the length unit must be positive, not {scale:g}')
    length_m = _INCH_M / scale
    angle = 1.0 if units.get('angle', 'deg').lower().startswith('rad') else np.pi / 180
    bones = dict([_root(path, sections['root'], angle, length_m)])
    for bone in _bones(path, sections['bonedata'], angle, length_m):
        if bone[0] in bones:
            raise MotionError(f'{path}: bone {bone[0]} is given twice')
        bones[bone[0]] = bone[1]
    children = {}
    for line, words in sections['hierarchy']:
        if words[0].lower() in ('begin', 'end'):
            continue
        for name in words:
            if name not in bones:
                raise MotionError(f'{path}: line {line}: bone {name!r} of the hierarchy is not in :bonedata')
        children.setdefault(words[0], []).extend(words[1:])
    bodies, index, todo = [], {}, [('root', -1)]
    while todo:
        name, parent = todo.pop()
        if name in index:
            raise MotionError(f'{path}: bone {name} has two parents')
        index[name] = len(bodies)
        bodies.append(Body(name, parent, **{key: bones[name][key] for key in
                                            ('offset', 'before', 'channels', 'after', 'tip')}))
        todo.extend((child, index[name]) for child in reversed(children.get(name, [])))
    loose = set(bones) - set(index)
    if loose:
        raise MotionError(f'{path}: {", ".join(sorted(loose)[:5])} hang from no bone of the hierarchy')
    names = tuple(f'{name}.{dof}' for name in bones for dof in bones[name]['dofs'])
    if not names:
        raise MotionError(f'{path}: no bone has a degree of freedom')
    return Skeleton(path.stem, tuple(bodies), names, length_m, 'y', {name: bones[name]['order'] for name in bones})


def _sections(path, text):
    """Section name -> list of (line number, words)."""
    sections, current = {}, None
    for line_number, line in enumerate(text.splitlines(), 1):
        line = line.split('#', 1)[0].strip()
        if line.startswith(':'):
            name, *rest = line[1:].split() or ['']
            if name.lower() in sections and name.lower() != 'name':
                raise MotionError(f'{path}: line {line_number}: section :{name} comes twice')
            current = sections.setdefault(name.lower(), [])
            if rest:
                current.append((line_number, rest))
        elif line and current is not None:
            current.append((line_number, line.split()))
    return sections


def _root(path, lines, angle, length_m):
    order, axis, position, orientation = _DOFS, 'XYZ', np.zeros(3), np.zeros(3)
    for line, words in lines:
        key, values = words[0].lower(), words[1:]
        if key == 'order':
            order = tuple(value.lower() for value in values)
        elif key == 'axis':
            axis = _order(path, line, values[-1:])
        elif key == 'position':
            position = np.array(_numbers(path, line, values, 3)) * length_m
        elif key == 'orientation':
            orientation = np.array(_numbers(path, line, values, 3)) * angle
    if len(set(order)) != len(order) or set(order) - set(_DOFS):
        raise MotionError(f'{path}: root order {" ".join(order)} is not made of TX TY TZ RX RY RZ')
    frame = euler_matrix(orientation, axis)
    return 'root', {'offset': position, 'before': frame, 'after': frame.T, 'tip': np.zeros(3), 'dofs': order,
                    'order': axis, 'channels': _channels('root', order, axis, {}, np.zeros(3))}


def _bones(path, lines, angle, length_m):
    bone, limit_key = None, None
    for line, words in lines:
        key, values = words[0].lower(), words[1:]
        if key == 'begin':
            bone, limit_key = {'direction': np.zeros(3), 'length': 0.0, 'axis': np.zeros(3), 'order': 'XYZ',
                               'dofs': (), 'limits': []}, False
            continue
        if bone is None:
            raise MotionError(f'{path}: line {line}: {words[0]!r} stands outside begin ... end')
        if key == 'end':
            yield _bone(path, line, bone, length_m)
            bone = None
            continue
        limit_key = key == 'limits' or (limit_key and key.startswith('('))
        if limit_key:
            text = ' '.join(words[1:] if key == 'limits' else words)
            for low, high in re.findall(r'\(\s*([^\s()]+)[\s,]+([^\s()]+)\s*\)', text):
                bone['limits'].append([_limit(path, line, low), _limit(path, line, high)])
        elif key == 'name' and values:
            bone['name'] = values[0]
        elif key == 'direction':
            bone['direction'] = np.array(_numbers(path, line, values, 3))
        elif key == 'length':
            bone['length'] = _numbers(path, line, values, 1)[0]
        elif key == 'axis':
            bone['axis'] = np.array(_numbers(path, line, values[:3], 3)) * angle
            bone['order'] = _order(path, line, values[3:4] or ['XYZ'])
        elif key == 'dof':
            bone['dofs'] = tuple(value.lower() for value in values)
            if len(set(bone['dofs'])) != len(values) or set(bone['dofs']) - set(_BONE_DOFS):
                raise MotionError(f'{path}: line {line}: degrees of freedom must be of {" ".join(_BONE_DOFS)}, '
                                  f'found {" ".join(values)}')
    if bone is not None:
        raise MotionError(f'{path}: the file breaks off within a bone (no end)')


def _bone(path, line, bone, length_m):
    if 'name' not in bone:
        raise MotionError(f'{path}: line {line}: the bone that ends here has no name')
    if bone['limits'] and len(bone['limits']) != len(bone['dofs']):
        raise MotionError(f'{path}: line {line}: bone {bone["name"]} has {len(bone["dofs"])} degrees of freedom and '
                          f'{len(bone["limits"])} limits')
    norm = np.linalg.norm(bone['direction'])
    direction = bone['direction'] / norm if norm > 0 else bone['direction']
    frame = euler_matrix(bone['axis'], bone['order'])
    scale = {'r': np.pi / 180, 't': length_m, 'l': length_m}
    limits = {dof: np.array(limit) * scale[dof[0]] for dof, limit in zip(bone['dofs'], bone['limits'])}
    return bone['name'], {
        'offset': np.zeros(3), 'before': frame, 'after': frame.T, 'tip': direction * bone['length'] * length_m,
        'dofs': bone['dofs'], 'order': bone['order'],
        'channels': _channels(bone['name'], bone['dofs'], bone['order'], limits, frame.T @ direction)}


def _channels(name, dofs, order, limits, along):
    """Channels as a product from left to right: translations, the last axis of the order first, then the length."""
    turns = ['r' + letter.lower() for letter in reversed(order)]
    channels = []
    for dof in [dof for dof in dofs if dof[0] == 't'] + [dof for dof in turns if dof in dofs]:
        low, high = limits.get(dof, (-np.inf, np.inf))
        axis = tuple(float(letter == dof[1]) for letter in 'xyz')
        channels.append(Channel(f'{name}.{dof}', dof[0], axis, float(low), float(high)))
    if 'l' in dofs:
        low, high = limits.get('l', (-np.inf, np.inf))
        channels.append(Channel(f'{name}.l', 't', tuple(map(float, along)), float(low), float(high)))
    return tuple(channels)


def _order(path, line, words):
    order = words[0].upper() if words else ''
    if sorted(order) != ['X', 'Y', 'Z']:
        raise MotionError(f'{path}: line {line}: the axis order {order!r} is not made of X, Y and Z')
    return order


def _numbers(path, line, words, count):
    try:
        numbers = [number(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise MotionError(f'{path}: line {line}: {count} finite numbers should stand here, '
                          f'found {" ".join(words)[:60]!r}')
    return numbers


def _limit(path, line, word):
    if word.lower().lstrip('+-') in ('inf', 'infinity'):
        return -np.inf if word.startswith('-') else np.inf
    return _numbers(path, line, [word], 1)[0]
