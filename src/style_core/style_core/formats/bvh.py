"""Biovision files (``.bvh``): skeleton and motion in one; degrees, Euler orders as each joint's channels say."""
import re

import numpy as np

from style_core.angles import continuous_triples
from style_core.errors import MotionError
from style_core.formats.files import constant_step_s, number, read_text, replacing
from style_core.motion import Motion, usual_units
from style_core.skeleton import Body, Channel, Skeleton

__all__ = ['read', 'write', 'read_skeleton', 'DEFAULT_LENGTH_M']

READ_OPTIONS = ('length_m',)
WRITE_OPTIONS = ('skeleton', 'length_m')

#: BVH files name no unit; most use centimetres
DEFAULT_LENGTH_M = 0.01

_CHANNELS = {letter.upper() + word: kind + letter for letter in 'xyz' for word, kind in
             (('position', 't'), ('rotation', 'r'))}


def read(path, length_m=None):
    """Read the motion of a BVH file.

    Parameters
    ----------
    path : path-like
    length_m : float, optional
        One length unit in metres; 0.01 where left out.

    Returns
    -------
    Motion
        Channels ``Hips.tx`` (m), ``Hips.rz`` (rad), ... in file order, angles as the file has them.

    Raises
    ------
    MotionError
        Naming the line where the file breaks off or does not fit.
    """
    skeleton, lines, at = _hierarchy(path, length_m)
    count, step, start = _motion_head(path, lines, at)
    names = skeleton.channel_names
    rows = [(line_number, line.split()) for line_number, line in enumerate(lines[start:], start + 1) if line.strip()]
    for line_number, words in rows:
        if len(words) != len(names):
            raise MotionError(f'{path}: line {line_number}: a frame needs {len(names)} values, found {len(words)}'
                              f'{"; the file breaks off here" if line_number == rows[-1][0] else ""}')
    if len(rows) != count:
        raise MotionError(f'{path}: {count} frames are announced, {len(rows)} are there')
    try:
        values = np.array([list(map(number, words)) for _, words in rows])
    except ValueError as error:
        raise MotionError(f'{path}: a value of the motion is not a number: {error}') from None
    if not np.isfinite(values).all():
        raise MotionError(f'{path}: line {rows[int(np.argmin(np.isfinite(values).all(axis=1)))][0]}: '
                          f'a value is not finite')
    units = usual_units(names)
    scale = np.array([skeleton.length_m if unit == 'm' else np.pi / 180 for unit in units])
    return Motion(names, values * scale, step * np.arange(count), units, name=path.stem)


def read_skeleton(path, length_m=None):
    """Read the skeleton of a BVH file; End Sites become bodies named ``<joint>_end``."""
    return _hierarchy(path, length_m)[0]


def write(motion, path, skeleton=None, length_m=None):
    """Write a BVH file.

    Where the skeleton's joint frames are not the plain axes of a BVH file (those of ASF are turned), the rotations
    are solved anew for channels Z, Y, X of each joint that moves; the pose is the same.

    Parameters
    ----------
    motion : Motion
        Channels of the skeleton; without gaps and at a constant rate. A joint without any channel stays at rest.
    path : path-like
    skeleton : Skeleton
    length_m : float, optional
        Length unit of the file, 0.01 (cm) where left out.

    Raises
    ------
    MotionError
        If there is no skeleton, or the motion is not of this skeleton, has missing values or no constant rate.
    """
    if skeleton is None:
        raise MotionError(f'{path}: a BVH file holds its skeleton: give one (an .asf or .bvh file)')
    if skeleton.up != 'y':
        raise MotionError(f'{path}: BVH files have the y axis up, but skeleton {skeleton.name!r} has z')
    if np.isnan(motion.positions).any():
        frame, channel = np.argwhere(np.isnan(motion.positions))[0]
        raise MotionError(f'{path}: a BVH file cannot hold missing values ({motion.joint_names[channel]} in frame '
                          f'{frame}); cut the motion or leave the joint out')
    if motion.n_frames < 2:
        raise MotionError(f'{path}: a BVH file needs two frames or more, as it holds one time step')
    step = constant_step_s(motion, path)
    skeleton.check_channels(motion.joint_names)
    if not all(_plain(body) for body in skeleton.bodies):
        motion, skeleton = _solved_anew(motion, skeleton)
    length_m = DEFAULT_LENGTH_M if length_m is None else float(length_m)
    names = []
    lines = ['HIERARCHY']
    children = {index: [] for index in range(-1, len(skeleton.bodies))}
    for index, body in enumerate(skeleton.bodies):
        children[body.parent].append(index)
    if len(children[-1]) != 1:
        raise MotionError(f'{path}: a BVH file has one root, skeleton {skeleton.name!r} {len(children[-1])}')
    have = set(motion.joint_names)

    def put(index, depth):
        body, pad = skeleton.bodies[index], '  ' * depth
        end = not children[index] and not body.channels and index > 0
        lines.append(pad + ('End Site' if end else f'{"JOINT" if depth else "ROOT"} {body.name}'))
        lines.append(f'{pad}{{')
        lines.append(f'{pad}  OFFSET ' + ' '.join(f'{value:.9g}' for value in body.offset / length_m))
        if not end:
            own = [channel for channel in body.channels if channel.name in have]
            names.extend(channel.name for channel in own)
            words = ['XYZ'[int(np.argmax(channel.axis))] + {'t': 'position', 'r': 'rotation'}[channel.kind]
                     for channel in own]
            lines.append(f'{pad}  ' + ' '.join(['CHANNELS', str(len(own)), *words]))
            if not children[index]:
                lines.extend([f'{pad}  End Site', f'{pad}  {{', f'{pad}    OFFSET 0 0 0', f'{pad}  }}'])
        for child in children[index]:
            put(child, depth + 1)
        lines.append(f'{pad}}}')

    put(children[-1][0], 0)
    motion = motion.joints(names)
    values = motion.positions / np.array([length_m if unit == 'm' else np.pi / 180 for unit in motion.units])
    lines += ['MOTION', f'Frames: {motion.n_frames}', f'Frame Time: {step:.12g}']
    with replacing(path) as stream:
        stream.write('\n'.join(lines) + '\n')
        row_text = ' '.join(['%.12g'] * len(names)) + '\n'
        for row in values:
            stream.write(row_text % tuple(row))


def _hierarchy(path, length_m):
    """Skeleton, all lines, and the index of the line MOTION."""
    length_m = DEFAULT_LENGTH_M if length_m is None else float(length_m)
    if not (np.isfinite(length_m) and length_m > 0):
        raise MotionError(f'{path}: the length unit must be a positive number of metres, got {length_m}')
    lines = read_text(path).splitlines()
    start = next((index for index, line in enumerate(lines) if line.strip()), 0)
    if lines[start].strip().upper() != 'HIERARCHY':
        raise MotionError(f'{path}: line {start + 1} should be HIERARCHY; is this a BVH file?')
    bodies, open_bodies, names, offset_of, pending = [], [], [], set(), None
    orders = {}
    for at in range(start + 1, len(lines)):
        words = lines[at].replace('{', ' { ').replace('}', ' } ').split()
        where = f'{path}: line {at + 1}'
        if words[:1] == ['MOTION']:
            break
        position = 0
        while position < len(words):
            word = words[position].upper()
            rest = words[position + 1:]
            if word in ('ROOT', 'JOINT', 'END'):
                if pending is not None or bool(open_bodies) == (word == 'ROOT') or (bodies and word == 'ROOT'):
                    raise MotionError(f'{where}: {words[position]} cannot stand here')
                name = rest[0] if rest else ''
                if word == 'END':
                    name = f'{bodies[open_bodies[-1]]["name"]}_end'
                if not name or name in '{}' or any(body['name'] == name for body in bodies):
                    raise MotionError(f'{where}: a joint needs a name of its own, found {name[:40]!r}')
                pending = {'name': name, 'parent': open_bodies[-1] if open_bodies else -1, 'channels': (),
                           'offset': np.zeros(3)}
                position += 2
            elif word == '{':
                if pending is None:
                    raise MotionError(f'{where}: a brace without a joint')
                open_bodies.append(len(bodies))
                bodies.append(pending)
                pending = None
                position += 1
            elif word == '}':
                if not open_bodies or pending is not None:
                    raise MotionError(f'{where}: a closing brace too many')
                if open_bodies[-1] not in offset_of:
                    raise MotionError(f'{where}: {bodies[open_bodies[-1]]["name"]} has no OFFSET')
                open_bodies.pop()
                position += 1
            elif word == 'OFFSET' and open_bodies and pending is None:
                bodies[open_bodies[-1]]['offset'] = _vector(where, rest[:3]) * length_m
                offset_of.add(open_bodies[-1])
                position += 4
            elif word == 'CHANNELS' and open_bodies and pending is None:
                body = bodies[open_bodies[-1]]
                count = int(rest[0]) if rest and re.match(r'[0-9]{1,4}$', rest[0]) else -1
                own = rest[1:1 + count] if count >= 0 else []
                known = {channel.lower(): dof for channel, dof in _CHANNELS.items()}
                if len(own) != count or any(channel.lower() not in known for channel in own) or \
                        len({channel.lower() for channel in own}) != count or body['channels']:
                    raise MotionError(f'{where}: CHANNELS needs a count and that many different names like Zrotation')
                dofs = [known[channel.lower()] for channel in own]
                body['channels'] = tuple(
                    Channel(f'{body["name"]}.{dof}', dof[0], tuple(float(letter == dof[1]) for letter in 'xyz'))
                    for dof in dofs)
                turns = ''.join(dof[1] for dof in dofs if dof[0] == 'r').upper()
                if len(turns) == 3:
                    orders[body['name']] = turns[::-1]  # written from the last turn to the first
                names.extend(channel.name for channel in body['channels'])
                position += 2 + count
            else:
                raise MotionError(f'{where}: {words[position][:40]!r} cannot stand here')
    else:
        raise MotionError(f'{path}: the file breaks off before MOTION')
    if open_bodies or pending is not None or not bodies:
        raise MotionError(f'{path}: line {at + 1}: MOTION begins before the hierarchy is closed')
    if not names:
        raise MotionError(f'{path}: no joint has a channel')
    made = tuple(Body(body['name'], body['parent'], body['offset'], channels=body['channels']) for body in bodies)
    return Skeleton(path.stem, made, tuple(names), length_m, 'y', orders), lines, at


def _motion_head(path, lines, at):
    """Number of frames and time step from the two lines after MOTION, and the index of the line after them."""
    head = [(index, line.split(':')) for index, line in enumerate(lines[at + 1:at + 20], at + 1) if line.strip()][:2]
    words = [(parts[0].strip().lower(), parts[1].strip()) for _, parts in head if len(parts) == 2]
    try:
        (frames, count), (frame_time, step) = words
        count, step = int(number(count)), number(step)
    except ValueError:
        frames, frame_time, count, step = '', '', 0, 0.0
    if frames != 'frames' or frame_time != 'frame time' or count < 1 or not (np.isfinite(step) and step > 0):
        raise MotionError(f'{path}: line {at + 2}: after MOTION must stand "Frames: N" and "Frame Time: S", both '
                          f'positive')
    return count, step, head[1][0] + 1


def _vector(where, words):
    try:
        vector = np.array([number(word) for word in words])
    except ValueError:
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MotionError(f'{where}: OFFSET needs three finite numbers')
    return vector


def _plain(body):
    """Whether a body is as a BVH file has it: at its joint, frame unturned, axes x, y and z, names like ``Hip.rx``."""
    return (not body.tip.any() and np.array_equal(body.before, np.eye(3)) and np.array_equal(body.after, np.eye(3))
            and all(sorted(channel.axis) == [0, 0, 1] and channel.scale == 1 and channel.offset == 0
                    and channel.name == f'{body.name}.{channel.kind}{"xyz"[int(np.argmax(channel.axis))]}'
                    for channel in body.channels))


def _solved_anew(motion, skeleton):
    """The same poses on a skeleton whose joints turn about plain axes, z first."""
    _, rotations = skeleton.poses(motion)
    have = set(motion.joint_names)
    bodies, columns, units = [], {}, []
    parents = set(skeleton.parents.tolist())
    for index, body in enumerate(skeleton.bodies):
        tip = skeleton.bodies[body.parent].tip if body.parent >= 0 else 0
        channels = []
        shifts = [channel for channel in body.channels if channel.kind == 't' and channel.name in have]
        if shifts and (body.parent >= 0 or not np.array_equal(body.before, np.eye(3))
                       or any(sorted(channel.axis) != [0, 0, 1] for channel in shifts)):
            raise MotionError(f'a BVH file cannot hold the sliding joint {body.name}')
        for channel in shifts:
            columns[channel.name] = motion.positions[:, motion.joint_names.index(channel.name)]
            channels.append(channel)
            units.append('m')
        local = rotations[:, index]
        if body.parent >= 0:
            local = np.swapaxes(rotations[:, body.parent], 1, 2) @ local
        if any(channel.kind == 'r' and channel.name in have for channel in body.channels):
            triples = continuous_triples(_zyx(local), 1)
            for letter in 'zyx':
                name = f'{body.name}.r{letter}'
                columns[name] = triples[:, 'xyz'.index(letter)]
                channels.append(Channel(name, 'r', tuple(float(other == letter) for other in 'xyz')))
                units.append('rad')
        bodies.append(Body(body.name, body.parent, body.offset + tip, channels=tuple(channels)))
        if index not in parents:
            bodies.append(Body(f'{body.name}_end', index, body.tip.copy()))
    # end sites have been put in between: count parents anew
    place = {body.name: index for index, body in enumerate(bodies)}
    old = skeleton.body_names
    bodies = [Body(body.name, body.parent if body.parent < 0 else place[old[body.parent]], body.offset,
                   channels=body.channels) for body in bodies]
    plain = Skeleton(skeleton.name, tuple(bodies), tuple(columns), skeleton.length_m, 'y',
                     {body.name: 'XYZ' for body in bodies})
    return motion.replace(joint_names=tuple(columns), positions=np.column_stack(list(columns.values())),
                          units=tuple(units)), plain


def _zyx(matrices):
    """Angles (a, b, c) of R = Rz(c) Ry(b) Rx(a); a is zero where only the sum or difference with c is determined."""
    b = -np.arcsin(np.clip(matrices[:, 2, 0], -1, 1))
    locked = np.abs(matrices[:, 2, 0]) > 1 - 1e-12
    a = np.where(locked, 0.0, np.arctan2(matrices[:, 2, 1], matrices[:, 2, 2]))
    c = np.where(locked, np.arctan2(-matrices[:, 0, 1], matrices[:, 1, 1]),
                 np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]))
    return np.stack([a, b, c], axis=1)
