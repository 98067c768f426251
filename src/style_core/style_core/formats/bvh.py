"""Biovision files (``.bvh``): skeleton and motion in one; degrees, Euler orders as each joint's channels say."""
import re
import warnings
from dataclasses import replace

import numpy as np

from style_core.angles import continuous_triples
from style_core.errors import MotionError
from style_core.formats.files import constant_step_s, number, read_text, replacing
from style_core.motion import Motion, usual_units
from style_core.skeleton import Body, Channel, Skeleton

__all__ = ['read', 'write', 'read_skeleton', 'DEFAULT_LENGTH_M']

READ_OPTIONS = ('length_m', 'rate_hz')
WRITE_OPTIONS = ('skeleton', 'length_m')
SKELETON = 'inside'
CHANNELS = 'Hips.rx [rad], Hips.tx [m]'
HAS_UNITS = True

#: BVH files name no unit; most use centimetres
DEFAULT_LENGTH_M = 0.01

_CHANNELS = {letter.upper() + word: kind + letter for letter in 'xyz' for word, kind in
             (('position', 't'), ('rotation', 'r'))}


def read(path, length_m=None, rate_hz=None):
    """Read the motion of a BVH file.

    Parameters
    ----------
    path : path-like
    length_m : float, optional
        One length unit in metres; 0.01 where left out.
    rate_hz : float, optional
        Counts where the file's frame time is none (a second or longer).

    Returns
    -------
    Motion
        Channels ``Hips.tx`` (m), ``Hips.rz`` (rad), ... in file order, angles as the file has them.

    Raises
    ------
    MotionError
        Naming the line where the file breaks off or does not fit.

    Warns
    -----
    UserWarning
        Where the file departs from the format and its meaning is clear all the same.
    """
    skeleton, lines, at, odd = _hierarchy(path, length_m)
    count, step, start = _motion_head(path, lines, at, odd, rate_hz)
    names = skeleton.channel_names
    rows = [(line_number, line.split()) for line_number, line in enumerate(lines[start:], start + 1) if line.strip()]
    for line_number, words in rows:
        if len(words) != len(names):
            raise MotionError(f'{path}: line {line_number}: a frame needs {len(names)} values, found {len(words)}'
                              f'{"; the file breaks off here" if line_number == rows[-1][0] else ""}')
    if len(rows) > count:
        odd.append(f'{count} frames are announced, {len(rows)} are there and read')
    elif len(rows) < count:
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
    if odd:
        more = f' (and {len(odd) - 3} more)' if len(odd) > 3 else ''
        warnings.warn(f'{path}: {"; ".join(odd[:3])}{more}', stacklevel=3)
    return Motion(names, values * scale, step * np.arange(len(rows)), units, name=path.stem, orders=skeleton.orders)


def read_skeleton(path, length_m=None):
    """Read the skeleton of a BVH file; End Sites become bodies named ``<joint>_end``.

    A position channel replaces its component of the joint's OFFSET, and rotations follow each other as the file names
    them.
    """
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
    names, shifts = [], {}
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
            shifts.update({channel.name: body.offset @ np.array(channel.axis) - channel.rest
                           for channel in own if channel.kind == 't'})
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
    # a position channel of the file holds the whole offset
    values = motion.positions + np.array([shifts.get(name, 0.0) for name in names])
    values = values / np.array([length_m if unit == 'm' else np.pi / 180 for unit in motion.units])
    lines += ['MOTION', f'Frames: {motion.n_frames}', f'Frame Time: {step:.12g}']
    with replacing(path) as stream:
        stream.write('\n'.join(lines) + '\n')
        row_text = ' '.join(['%.12g'] * len(names)) + '\n'
        for row in values:
            stream.write(row_text % tuple(row))


def _hierarchy(path, length_m):
    """Skeleton, all lines, the index of the line MOTION, and what departs from the format."""
    length_m = DEFAULT_LENGTH_M if length_m is None else float(length_m)
    if not (np.isfinite(length_m) and length_m > 0):
        raise MotionError(f'{path}: the length unit must be a positive number of metres, got {length_m}')
    lines = read_text(path).splitlines()
    start = next((index for index, line in enumerate(lines) if line.strip()), 0)
    if lines[start].strip().upper() != 'HIERARCHY':
        raise MotionError(f'{path}: line {start + 1} should be HIERARCHY; is this a BVH file?')
    tree = _Tree(length_m)
    for at in range(start + 1, len(lines)):
        words = lines[at].replace('{', ' { ').replace('}', ' } ').split()
        if words and words[0].upper() == 'MOTION':
            if words[0] != 'MOTION':
                tree.odd.append(f'{words[0]} stands for MOTION')
            break
        while words:
            words = words[tree.take(f'{path}: line {at + 1}', words):]
    else:
        raise MotionError(f'{path}: the file breaks off before MOTION')
    if not tree.closed:
        raise MotionError(f'{path}: line {at + 1}: MOTION begins before the hierarchy is closed')
    if not tree.names:
        raise MotionError(f'{path}: no joint has a channel')
    return Skeleton(path.stem, tree.made(), tuple(tree.names), length_m, 'y', tree.orders), lines, at, tree.odd


class _Tree:
    """The bodies of a hierarchy, as its words come in."""

    def __init__(self, length_m):
        self.bodies, self.names, self.orders, self.odd = [], [], {}, []
        self._open, self._pending, self._offset_of, self._length_m = [], None, set(), length_m

    @property
    def closed(self):
        return bool(self.bodies) and not self._open and self._pending is None

    def made(self):
        """The bodies; a position channel is at rest where the offset has it."""
        return tuple(Body(body['name'], body['parent'], body['offset'], channels=tuple(
            replace(channel, rest=float(body['offset'] @ np.array(channel.axis))) if channel.kind == 't' else channel
            for channel in body['channels'])) for body in self.bodies)

    def take(self, where, words):
        """Take the first words of a line, and say how many."""
        word = words[0].upper()
        if word in ('ROOT', 'JOINT', 'END'):
            return self._begin(where, word, words)
        if word == '{':
            if self._pending is None:
                raise MotionError(f'{where}: a brace without a joint')
            self._open.append(len(self.bodies))
            self.bodies.append(self._pending)
            self._pending = None
            return 1
        if word == '}':
            if not self._open or self._pending is not None:
                raise MotionError(f'{where}: a closing brace too many')
            if self._open[-1] not in self._offset_of:
                raise MotionError(f'{where}: {self.bodies[self._open[-1]]["name"]} has no OFFSET')
            self._open.pop()
            return 1
        if word in ('OFFSET', 'CHANNELS') and self._open and self._pending is None:
            if word == 'CHANNELS':
                return self._channels(where, words[1:])
            self.bodies[self._open[-1]]['offset'] = _vector(where, words[1:4]) * self._length_m
            self._offset_of.add(self._open[-1])
            return 4
        raise MotionError(f'{where}: {words[0][:40]!r} cannot stand here')

    def _begin(self, where, word, words):
        if self._pending is not None or bool(self._open) == (word == 'ROOT') or (self.bodies and word == 'ROOT'):
            raise MotionError(f'{where}: {words[0]} cannot stand here')
        count = next((k for k, other in enumerate(words[1:]) if other in '{}'), len(words) - 1)
        name = ' '.join(words[1:1 + count])
        taken = {body['name'] for body in self.bodies}
        if word == 'END':
            name = self._end_name(words[1:1 + count], taken)
        elif ' ' in name:
            self.odd.append(f'the name {name!r} has spaces')
        if not name or name in taken:
            raise MotionError(f'{where}: a joint needs a name of its own, found {name[:40]!r}')
        self._pending = {'name': name, 'parent': self._open[-1] if self._open else -1, 'channels': (),
                         'offset': np.zeros(3)}
        return 1 + count

    def _end_name(self, words, taken):
        """Its own name where the file gives a free one, else the joint's with ``_end``, numbered from the second on."""
        parent = self.bodies[self._open[-1]]['name']
        given = ' '.join(words[1:] if words and words[0].lower() == 'site' else words)
        if given:
            self.odd.append(f'the end site of {parent} has the name {given!r}')
            if given not in taken:
                return given
        name, number = f'{parent}_end', 1
        while name in taken:
            number += 1
            name = f'{parent}_end{number}'
        if number > 1:
            self.odd.append(f'{parent} has {number} end sites')
        return name

    def _channels(self, where, rest):
        body = self.bodies[self._open[-1]]
        count = int(rest[0]) if rest and re.match(r'[0-9]{1,4}$', rest[0]) else -1
        own = [word.lower() for word in rest[1:1 + count]] if count >= 0 else []
        known = {channel.lower(): dof for channel, dof in _CHANNELS.items()}
        if len(own) != count or set(own) - set(known) or len(set(own)) != count or body['channels']:
            raise MotionError(f'{where}: CHANNELS needs a count and that many different names like Zrotation')
        dofs = [known[channel] for channel in own]
        self.names.extend(f'{body["name"]}.{dof}' for dof in dofs)
        # the position takes the place of OFFSET, so it counts in the parent's frame wherever it stands
        body['channels'] = tuple(
            Channel(f'{body["name"]}.{dof}', dof[0], tuple(float(letter == dof[1]) for letter in 'xyz'))
            for dof in sorted(dofs, key=lambda dof: dof[0] == 'r'))
        turns = ''.join(dof[1] for dof in dofs if dof[0] == 'r').upper()
        if len(turns) == 3:
            self.orders[body['name']] = turns[::-1]  # written from the last turn to the first
        return 2 + count


_FRAMES = re.compile(r'frames\s*:?\s*(\S+)$', re.IGNORECASE)
_FRAME_TIME = re.compile(r'frame\s*time\s*:?\s*(\S+)$', re.IGNORECASE)


def _motion_head(path, lines, at, odd, rate_hz):
    """Number of frames and time step from the two lines after MOTION, and the index of the line after them."""
    head = [(index, line.strip()) for index, line in enumerate(lines[at + 1:at + 20], at + 1) if line.strip()][:2]
    found = [pattern.match(line) for pattern, (_, line) in zip((_FRAMES, _FRAME_TIME), head)]
    try:
        count, step = (number(one.group(1)) for one in found)
        count = int(count)
    except (ValueError, AttributeError, OverflowError):
        count, step = 0, 0.0
    if count < 1 or not (np.isfinite(step) and step > 0):
        raise MotionError(f'{path}: line {at + 2}: after MOTION must stand "Frames: N" and "Frame Time: S", both '
                          f'positive')
    odd.extend(f'{line!r} has no colon' for _, line in head if ':' not in line)
    if step >= _LEAST_ODD_STEP_S:
        step = _mended_step(step, odd, rate_hz)
    return count, step, head[1][0] + 1


#: no recording of motion has a frame a second; such a "Frame Time" is a rate in Hz or a time in ms
_LEAST_ODD_STEP_S = 1.0
_USUAL_RATES = (24, 25, 29.97, 30, 48, 50, 59.94, 60, 72, 75, 90, 100, 120, 125, 144, 150, 180, 200, 240, 250, 300, 400,
                480, 500, 600, 1000)


def _mended_step(step, odd, rate_hz):
    if rate_hz is not None:
        odd.append(f'the frame time {step:g} s cannot be: {rate_hz:g} Hz were asked for instead')
        return 1.0 / rate_hz
    for unit, rate in (('Hz', step), ('ms', 1e3 / step)):
        if any(abs(rate - usual) < 0.005 * usual for usual in _USUAL_RATES):
            odd.append(f'the frame time {step:g} is taken as {step:g} {unit}, as no recording has a frame in '
                       f'{step:g} s (--recorded-rate says otherwise)')
            return 1.0 / rate
    odd.append(f'the frame time of {step:g} s can hardly be right (--recorded-rate gives the rate)')
    return step


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
                          units=tuple(units), orders=plain.orders), plain


def _zyx(matrices):
    """Angles (a, b, c) of R = Rz(c) Ry(b) Rx(a); a is zero where only the sum or difference with c is determined."""
    b = -np.arcsin(np.clip(matrices[:, 2, 0], -1, 1))
    locked = np.abs(matrices[:, 2, 0]) > 1 - 1e-12
    a = np.where(locked, 0.0, np.arctan2(matrices[:, 2, 1], matrices[:, 2, 2]))
    c = np.where(locked, np.arctan2(-matrices[:, 0, 1], matrices[:, 1, 1]),
                 np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]))
    return np.stack([a, b, c], axis=1)
