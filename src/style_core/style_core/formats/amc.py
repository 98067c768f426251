"""Acclaim motion files (``.amc``): degrees and the skeleton's length unit, frames numbered from 1, no rate."""
import re
import warnings

import numpy as np

from style_core.errors import MotionError
from style_core.formats import skeleton_of
from style_core.formats.files import constant_step_s, read_text, replacing
from style_core.motion import Motion

__all__ = ['read', 'write', 'CMU_DOFS', 'CMU_LENGTH_M', 'DEFAULT_RATE_HZ']

READ_OPTIONS = ('skeleton', 'rate_hz')
WRITE_OPTIONS = ('skeleton',)
SKELETON = 'beside'
CHANNELS = 'lfemur.rx [rad], root.tx [m]'
HAS_UNITS = True

#: every recording of the CMU database runs at this rate; the files do not say so
DEFAULT_RATE_HZ = 120.0

#: one length unit of the CMU skeletons in metres: inches times their scale of 0.45
CMU_LENGTH_M = 2.54 / 100 / 0.45

_FRAME = re.compile(r'[0-9]{1,15}$')
_NUMBER = re.compile(r'[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$')

#: degrees of freedom that the CMU skeletons share, used where no skeleton file is at hand
CMU_DOFS = {
    'root': ('tx', 'ty', 'tz', 'rx', 'ry', 'rz'),
    **dict.fromkeys(('lowerback', 'upperback', 'thorax', 'lowerneck', 'upperneck', 'head'), ('rx', 'ry', 'rz')),
    **{side + joint: dofs for side in 'lr' for joint, dofs in {
        'femur': ('rx', 'ry', 'rz'), 'tibia': ('rx',), 'foot': ('rx', 'rz'), 'toes': ('rx',),
        'clavicle': ('ry', 'rz'), 'humerus': ('rx', 'ry', 'rz'), 'radius': ('rx',), 'wrist': ('ry',),
        'hand': ('rx', 'rz'), 'fingers': ('rx',), 'thumb': ('rx', 'rz')}.items()},
}


def read(path, skeleton=None, rate_hz=None):
    """Read an AMC file.

    Parameters
    ----------
    path : path-like
    skeleton : Skeleton, optional
        Says which degrees of freedom a joint has and how long a length unit is; the ``.asf`` file beside it where
        left out, and without one the common layout of the CMU skeletons.
    rate_hz : float, optional
        Where left out, what the file's header ``:SAMPLES-PER-SECOND`` or its comment ``# rate_hz`` says, as `write`
        puts them, else 120.

    Returns
    -------
    Motion
        Channels ``root.tx`` (m), ``lfemur.rx`` (rad), ... in file order, angles as the file has them. A joint that a
        frame leaves out is NaN there.

    Raises
    ------
    MotionError
        Naming the line where the file breaks off or does not fit.
    """
    if skeleton is None:
        skeleton = skeleton_of(path)
    dofs, length_m = (CMU_DOFS, CMU_LENGTH_M) if skeleton is None else (skeleton.dofs, skeleton.length_m)
    lines = read_text(path).splitlines()
    first, degrees, written_hz = _header(path, lines)
    rate_hz = next(float(rate) for rate in (rate_hz, written_hz, DEFAULT_RATE_HZ) if rate is not None)
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise MotionError(f'{path}: the rate must be a positive number of Hz, got {rate_hz}')
    try:
        joints, values = _read_regular(lines[first:], dofs)
    except ValueError:
        joints, values = _read_line_by_line(path, lines, first, dofs)
    names = [f'{joint}.{dof}' for joint in joints for dof in dofs[joint]]
    units = ['rad' if name.rpartition('.')[2][0] == 'r' else 'm' for name in names]
    angle = np.pi / 180 if degrees else 1.0
    scale = np.array([length_m if unit == 'm' else angle for unit in units])
    return Motion(names, values * scale, np.arange(len(values)) / rate_hz, units, name=path.stem,
                  orders={} if skeleton is None else skeleton.orders)


def write(motion, path, skeleton=None):
    """Write an AMC file, its rate in a comment; see `read` for ``skeleton``.

    Raises
    ------
    MotionError
        If a channel is not a degree of freedom of the skeleton, a joint is incomplete, a value is missing, or the
        rate is not constant.
    """
    dofs, length_m = (CMU_DOFS, CMU_LENGTH_M) if skeleton is None else (skeleton.dofs, skeleton.length_m)
    have = set(motion.joint_names)
    joints = list(dict.fromkeys(name.rpartition('.')[0] for name in motion.joint_names))
    for joint in joints:
        wanted = {f'{joint}.{dof}' for dof in dofs.get(joint, ())}
        of_joint = {name for name in have if name.rpartition('.')[0] == joint}
        if not wanted:
            known = 'the skeleton' if skeleton is not None else 'the CMU skeletons; give the skeleton file'
            raise MotionError(f'{path}: {sorted(of_joint)[0]!r} is no degree of freedom of {known}')
        if wanted != of_joint:
            raise MotionError(f'{path}: an AMC file needs exactly the channels {sorted(wanted)} of joint {joint!r}, '
                              f'the motion has {sorted(of_joint)}')
    names = [f'{joint}.{dof}' for joint in joints for dof in dofs[joint]]
    motion = motion.joints(names)
    if np.isnan(motion.positions).any():
        frame, channel = np.argwhere(np.isnan(motion.positions))[0]
        raise MotionError(f'{path}: an AMC file cannot hold missing values ({names[channel]} in frame {frame}); '
                          f'cut the motion or leave the joint out')
    values = motion.positions / np.array([length_m if unit == 'm' else np.pi / 180 for unit in motion.units])
    rate = ''
    if motion.n_frames > 1:
        rate_hz = float(f'{1 / constant_step_s(motion, path):.9g}')
        rate = f'# rate_hz {rate_hz!r}\n:SAMPLES-PER-SECOND {rate_hz:.9g}\n'
        if abs(rate_hz - DEFAULT_RATE_HZ) > 0.01 * DEFAULT_RATE_HZ:
            warnings.warn(f'{path} is at {rate_hz:g} Hz and says so in its header, but other programs take any AMC '
                          f'file for {DEFAULT_RATE_HZ:g} Hz', stacklevel=3)
    frame_text = '\n'.join(['%d'] + [joint + ' %.12g' * len(dofs[joint]) for joint in joints]) + '\n'
    with replacing(path) as stream:
        stream.write(f'#!OML:ASF\n{rate}:FULLY-SPECIFIED\n:DEGREES\n')
        for number, row in enumerate(values, 1):
            stream.write(frame_text % (number, *row))


def _header(path, lines):
    """Index of the first frame's line, whether angles are in degrees, and the rate of a comment (or None)."""
    degrees, rate_hz = True, None
    for index, line in enumerate(lines):
        word = line.strip()
        if word.upper() in (':DEGREES', ':RADIANS'):
            degrees = word.upper() == ':DEGREES'
        elif word.startswith('# rate_hz ') and _NUMBER.match(word[10:]):
            rate_hz = float(word[10:])
        elif word.upper().startswith(':SAMPLES-PER-SECOND'):
            given = word.split()[1:]
            if len(given) != 1 or not _NUMBER.match(given[0]) or not float(given[0]) > 0:
                raise MotionError(f'{path}: line {index + 1}: {word[:40]!r} should name a positive rate')
            rate_hz = float(given[0]) if rate_hz is None else rate_hz
        elif word and word[0] not in '#:':
            if not _FRAME.match(word):
                raise MotionError(f'{path}: line {index + 1} should be a frame number, found {word[:40]!r}; '
                                  f'is this an AMC file?')
            return index, degrees, rate_hz
    raise MotionError(f'{path} holds no frames (is this an AMC file?)')


def _read_regular(lines, dofs):
    """Values of a file whose every frame has the same joints in the same order; ValueError for any other."""
    joints = []
    for line in lines[1:]:
        joint = line.split(' ', 1)[0]
        if _FRAME.match(joint.strip()):
            break
        joints.append(joint)
    tokens = ' '.join(lines).split()
    width = 1 + sum(1 + len(dofs.get(joint, ())) for joint in joints)
    if not joints or len(tokens) % width or len(set(joints)) != len(joints) or any(j not in dofs for j in joints):
        raise ValueError('not regular')
    first = int(tokens[0])
    count = len(tokens) // width
    if tokens[::width] != [str(number) for number in range(first, first + count)]:
        raise ValueError('not regular')
    columns, at = [], 1
    for joint in joints:
        if tokens[at::width].count(joint) != count:
            raise ValueError('not regular')
        for offset in range(1, 1 + len(dofs[joint])):
            column = tokens[at + offset::width]
            if '_' in ''.join(column):  # float() takes 1_0 for ten
                raise ValueError('not regular')
            columns.append(np.array(list(map(float, column))))
        at += 1 + len(dofs[joint])
    values = np.column_stack(columns)
    if not np.isfinite(values).all() or len(lines) < count * (1 + len(joints)):
        raise ValueError('not regular')
    return joints, values


def _read_line_by_line(path, lines, first, dofs):
    """Values of any file; MotionError names the line that does not fit."""
    frames, joints = [], {}
    number = None
    for index in range(first, len(lines)):
        words = lines[index].split()
        if not words:
            continue
        where = f'{path}: line {index + 1}'
        if len(words) == 1 and _FRAME.match(words[0]):
            if number is not None and int(words[0]) != number + 1:
                problem = 'comes again' if int(words[0]) <= number else f'follows {number}: frames are missing'
                raise MotionError(f'{where}: frame number {words[0]} {problem}')
            number = int(words[0])
            frames.append({})
            continue
        joint, *numbers = words
        if joint not in dofs:
            raise MotionError(f'{where}: joint {joint[:40]!r} is not in the skeleton')
        if joint in frames[-1]:
            raise MotionError(f'{where}: joint {joint} comes twice in frame {number}')
        if len(numbers) != len(dofs[joint]):
            more = any(line.strip() for line in lines[index + 1:])
            raise MotionError(f'{where}: joint {joint} needs {len(dofs[joint])} values ({" ".join(dofs[joint])}), '
                              f'found {len(numbers)}{"" if more else "; the file breaks off here"}')
        for text in numbers:
            if not _NUMBER.match(text) or not np.isfinite(float(text)):
                raise MotionError(f'{where}: {text[:40]!r} is not a finite number')
        frames[-1][joint] = [float(text) for text in numbers]
        joints.setdefault(joint)
    order = list(joints)
    if not order:
        raise MotionError(f'{path}: line {first + 1}: a frame number and no joint after it')
    if len(frames) > 1:
        usual = set(frames[0]) & set(frames[-2])
        if not usual <= set(frames[-1]):
            raise MotionError(f'{path}: line {len(lines)}: the file breaks off within frame {number}, joint '
                              f'{next(j for j in order if j in usual and j not in frames[-1])} is still to come')
    missing = {joint: [np.nan] * len(dofs[joint]) for joint in order}
    return order, np.array([[value for joint in order for value in frame.get(joint, missing[joint])]
                            for frame in frames])
