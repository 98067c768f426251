"""Xsens MVN files (``.mvnx``): joint angles, and where the pelvis is."""
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np

from style_core.angles import rotation_from_quaternion, triples_from
from style_core.errors import MotionError
from style_core.formats.files import number, read_text
from style_core.motion import Motion

__all__ = ['read']

READ_OPTIONS = ()
SKELETON = None
CHANNELS = 'Pelvis.tx [m], Pelvis.rx [rad], jLeftHip.rx (abduction), .ry (rotation), .rz (flexion) [rad]'
HAS_UNITS = True

#: MVN gives joint angles as R = Rz(flexion) Rx(abduction) Ry(rotation), the recommendation of the ISB
_ORDER = 'YXZ'
#: of the signs of quaternions nothing depends, their length must be one
_UNIT_TOLERANCE = 0.01
#: ms since 1970 from here on (1973), not since the start of the recording
_EPOCH_MS = 1e11


def read(path):
    """Read the joint angles of an MVNX file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Motion
        Frames of type ``normal``. Channels ``Pelvis.t*`` (m) and ``Pelvis.r*`` where the file has positions and
        orientations, in MVN's world with z up; then three angles of each joint of ``jointAngle``, with MVN's signs.

    Raises
    ------
    MotionError
        If it is no such file, holds no joint angles, or a frame does not fit.

    Warns
    -----
    UserWarning
        If the file has no frame rate, so that the frames' own times (whole ms) count.
    """
    try:
        # bytes as text: an encoding named in the file has been taken care of
        root = ElementTree.fromstring(read_text(path).split('?>', 1)[-1].strip())
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise MotionError(f'{path} is not well-formed XML: {error}') from None
    if _tag(root) != 'mvnx':
        raise MotionError(f'{path} describes a <{_tag(root)[:40]}>, not an <mvnx>')
    subject = _child(path, root, 'subject')
    joints = [joint.get('label', '') for joint in _child(path, subject, 'joints')]
    frames = [frame for frame in _child(path, subject, 'frames')
              if _tag(frame) == 'frame' and frame.get('type', 'normal') == 'normal']
    if not frames:
        raise MotionError(f'{path} holds no frame of type normal')
    if not joints or not all(joints):
        raise MotionError(f'{path}: its joints have no labels')
    parts = [{_tag(part): part.text for part in frame} for frame in frames]
    if 'jointAngle' not in parts[0]:
        raise MotionError(f'{path} holds no joint angles: export it from MVN with "Joint angles"')
    angles = np.radians(_array(path, parts, 'jointAngle', 3 * len(joints)))
    names = [f'{joint}.r{axis}' for joint in joints for axis in 'xyz']
    root_names, units, root_values = _pelvis(path, subject, parts)
    times, epoch_ns = _times(path, subject, frames)
    return Motion(root_names + names, np.hstack([*root_values, angles]), times, units + ('rad',) * len(names),
                  path.stem, epoch_ns, dict.fromkeys(joints, _ORDER))


def _pelvis(path, subject, parts):
    """Names, units and values of where the pelvis is."""
    segments = next((element for element in subject if _tag(element) == 'segments'), ())
    labels = [segment.get('label') for segment in segments]
    names, units, values = [], (), []
    if 'Pelvis' not in labels:
        return names, units, values
    place = labels.index('Pelvis')
    if 'position' in parts[0]:
        values.append(_array(path, parts, 'position', 3 * len(labels))[:, 3 * place:3 * place + 3])
        names, units = names + [f'Pelvis.t{axis}' for axis in 'xyz'], units + ('m',) * 3
    if 'orientation' in parts[0]:
        quaternions = _array(path, parts, 'orientation', 4 * len(labels))[:, 4 * place:4 * place + 4]
        length = np.linalg.norm(quaternions, axis=1)
        if not (np.abs(length - 1) < _UNIT_TOLERANCE).all():
            raise MotionError(f'{path}: orientations of the pelvis are no unit quaternions')
        values.append(triples_from(rotation_from_quaternion((quaternions / length[:, None])[:, [1, 2, 3, 0]])))
        names, units = names + [f'Pelvis.r{axis}' for axis in 'xyz'], units + ('rad',) * 3
    return names, units, values


def _times(path, subject, frames):
    """Times in s from the first frame on, and the stamp of the first in ns since 1970 or 0."""
    rate_hz = _attribute(path, subject, 'frameRate')
    if rate_hz is not None and rate_hz > 0:
        stamps = [_attribute(path, frame, 'index') for frame in frames]
        step = 1 / rate_hz
    else:
        warnings.warn(f'{path} has no frame rate: the times of its frames, whole milliseconds, count', stacklevel=4)
        stamps = [_attribute(path, frame, 'time') for frame in frames]
        step = 1e-3
    if None in stamps:
        raise MotionError(f'{path}: normal frame {stamps.index(None)} has neither index nor time')
    since_1970 = _attribute(path, frames[0], 'ms')
    epoch_ns = int(since_1970) * 10**6 if since_1970 is not None and _EPOCH_MS <= since_1970 < 1e13 else 0
    return (np.array(stamps) - stamps[0]) * step, epoch_ns


def _array(path, parts, key, width):
    values = np.empty((len(parts), width))
    for row, part in enumerate(parts):
        words = (part.get(key) or '').split()
        if len(words) != width:
            raise MotionError(f'{path}: normal frame {row}: {key} has {len(words)} numbers, expected {width}')
        try:
            values[row] = [number(word) for word in words]
        except ValueError as error:
            raise MotionError(f'{path}: normal frame {row}: {key}: {error}') from None
    return values


def _attribute(path, element, key):
    """A finite number, or None where it is absent or empty."""
    word = element.get(key)
    if not word:
        return None
    try:
        value = number(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise MotionError(f'{path}: {key}="{word[:40]}" of a <{_tag(element)}> is not a finite number')
    return value


def _child(path, element, tag):
    child = next((child for child in element if _tag(child) == tag), None)
    if child is None:
        raise MotionError(f'{path}: <{_tag(element)}> has no <{tag}>')
    return child


def _tag(element):
    return element.tag.rpartition('}')[2]
