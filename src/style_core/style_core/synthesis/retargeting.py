"""From a model's joints to a robot's: combinations of joints, within limits that nothing ever passes."""
from dataclasses import dataclass
from pathlib import Path
from typing import Mapping, Optional, Tuple

import numpy as np

from style_core.errors import ModelError
from style_core.formats.files import replacing
from style_core.joint_file import read_joint_file

__all__ = ['RobotJoint', 'Robot', 'BoundRobot', 'read_robot', 'write_robot', 'plain_robot']

#: closer to a limit than this (rad, or a quarter of a small range) a joint is slowed down so that it never gets there
MARGIN = 0.05


@dataclass(frozen=True)
class RobotJoint:
    """``robot = sum of gain * model joint + offset``, kept within the limits.

    Attributes
    ----------
    terms : mapping of str to float
        Model joint -> gain; empty for a joint that stands still at ``offset``.
    offset : float
        Rad.
    limits : tuple of float, optional
        Lower and upper, rad.
    velocity, acceleration : float
        Limits of the motor, rad/s and rad/s^2; infinite where there are none.
    """

    terms: Mapping[str, float]
    offset: float = 0.0
    limits: Optional[Tuple[float, float]] = None
    velocity: float = np.inf
    acceleration: float = np.inf


@dataclass(frozen=True, eq=False)
class BoundRobot:
    """A robot fitted to the joints of one model.

    Attributes
    ----------
    joint_names : tuple of str, length R
    gain : ndarray, shape (R, D)
    offset, lower, upper, velocity, acceleration : ndarray, shape (R,)
        Limits are infinite where there are none.
    """

    joint_names: Tuple[str, ...]
    gain: np.ndarray
    offset: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def combine(self, positions, velocities):
        """Robot positions and velocities, shape (..., R) each, of the model's, shape (..., D); not limited yet."""
        return positions @ self.gain.T + self.offset, velocities @ self.gain.T

    def limit(self, positions, velocities):
        """Bend positions smoothly near limits, so that they only approach them.

        Returns
        -------
        positions, velocities : ndarray
            The velocities are the exact derivative of the bent positions.
        """
        margin = np.minimum(MARGIN, 0.25 * (self.upper - self.lower))
        above = np.maximum(positions - (self.upper - margin), 0.0)
        below = np.maximum(self.lower + margin - positions, 0.0)
        slow = np.exp(-(above + below) / margin)
        bent = np.where(above > 0, self.upper - margin * slow,
                        np.where(below > 0, self.lower + margin * slow, positions))
        return bent, velocities * slow


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot's joints and how a model moves them.

    Attributes
    ----------
    name : str
    joints : mapping of str to RobotJoint
    urdf : str
        File beside the robot's own; may be empty.
    keep_unlisted : bool
        Whether model joints that no joint uses are on the robot under their own names.
    """

    name: str
    joints: Mapping[str, RobotJoint]
    urdf: str = ''
    keep_unlisted: bool = False

    def bind(self, model_joints):
        """Fit to a model's joint names.

        Raises
        ------
        ModelError
            If a joint is wanted that the model lacks, or nothing is left.
        """
        model_joints = tuple(model_joints)
        column = {name: k for k, name in enumerate(model_joints)}
        joints = dict(self.joints)
        if self.keep_unlisted:
            used = {name for joint in joints.values() for name in joint.terms}
            joints.update({name: RobotJoint({name: 1.0}) for name in model_joints
                           if name not in used and name not in joints})
        lacking = sorted({name for joint in joints.values() for name in joint.terms if name not in column})
        if lacking:
            raise ModelError(f'robot {self.name} is moved by {", ".join(lacking[:5])}'
                             f'{" ..." if len(lacking) > 5 else ""}, which the model does not have')
        if not joints:
            raise ModelError(f'robot {self.name} has no joints')
        gain = np.zeros((len(joints), len(model_joints)))
        for row, joint in enumerate(joints.values()):
            for name, value in joint.terms.items():
                gain[row, column[name]] = value
        numbers = np.array([(joint.offset, *(joint.limits or (-np.inf, np.inf)), joint.velocity, joint.acceleration)
                            for joint in joints.values()])
        return BoundRobot(tuple(joints), gain, *np.ascontiguousarray(numbers.T))


def plain_robot():
    """The robot whose joints are those of the model, without limits."""
    return Robot('plain', {}, keep_unlisted=True)


def read_robot(path):
    """Read a robot from YAML.

    The file holds ``joints``: robot joint -> mapping with ``from`` (a model joint, or a mapping of model joints to
    gains; left out for a joint that stands still) and, as needed, ``sign``, ``scale``, ``offset`` (rad), ``limits``
    (rad), and what the motor can do: ``velocity`` (rad/s) and ``acceleration`` (rad/s^2). Optional are ``defaults``
    (``velocity`` and ``acceleration`` of joints that do not say), ``name``, ``urdf``, and ``unlisted: keep`` or
    ``drop`` (default) for model joints not used.

    Raises
    ------
    ModelError
        If the file cannot be read or does not have this form; the message names the joint.
    """
    path = Path(path)
    entries, keep_unlisted, content = read_joint_file(path, 'robot', ('name', 'urdf', 'defaults'))
    defaults = content.get('defaults') or {}
    if not isinstance(defaults, dict) or not set(defaults) <= {'velocity', 'acceleration'}:
        raise ModelError(f'{path}: defaults may hold velocity and acceleration, and nothing else')
    joints = {}
    for name, entry in entries.items():
        try:
            joints[name] = _joint(entry or {}, defaults)
        except (ModelError, TypeError) as error:
            raise ModelError(f'{path}, joint {name}: {error}') from None
    return Robot(str(content.get('name', path.stem)), joints, str(content.get('urdf', '')), keep_unlisted)


def _joint(entry, defaults):
    if not isinstance(entry, dict) or not set(entry) <= {'from', 'sign', 'scale', 'offset', 'limits', 'velocity',
                                                         'acceleration'}:
        raise ModelError('may have from, sign, scale, offset, limits, velocity and acceleration, and nothing else')
    motor = {**defaults, **{key: entry[key] for key in ('velocity', 'acceleration') if key in entry}}
    source = entry.get('from') or {}
    if isinstance(source, str):
        source = {source: 1.0}
    limits = entry.get('limits')
    if not isinstance(source, dict) or (limits is not None and (not isinstance(limits, list) or len(limits) != 2)):
        raise ModelError('from must be a joint or a mapping of joints to gains, limits [lower, upper]')
    sign, scale, offset = entry.get('sign', 1), entry.get('scale', 1.0), entry.get('offset', 0.0)
    numbers = [sign, scale, offset, *source.values(), *(limits or ()), *motor.values()]
    if any(isinstance(x, bool) or not isinstance(x, (int, float)) or not np.isfinite(x) for x in numbers):
        raise ModelError('sign, scale, offset, gains and limits must be finite numbers')
    if not all(limit > 0 for limit in motor.values()):
        raise ModelError('velocity and acceleration must be positive')
    if sign not in (1, -1) or scale <= 0:
        raise ModelError('sign must be 1 or -1, and scale positive')
    if limits and limits[0] >= limits[1]:
        raise ModelError(f'limits must be [lower, upper] with lower < upper, not {limits}')
    return RobotJoint({str(joint): sign * scale * float(gain) for joint, gain in source.items()}, float(offset),
                      (float(limits[0]), float(limits[1])) if limits else None,
                      **{key: float(limit) for key, limit in motor.items()})


def write_robot(robot, path, comment=''):
    """Write a robot as YAML that `read_robot` reads, gains to four places; ``comment`` lines go first."""
    lines = [f'# {line}'.rstrip() for line in comment.splitlines()]
    lines += [f'name: {robot.name}'] + ([f'urdf: {robot.urdf}'] if robot.urdf else [])
    common = {}
    for key in ('velocity', 'acceleration'):
        values = [getattr(joint, key) for joint in robot.joints.values()]
        most = max(values, key=values.count, default=np.inf)
        if np.isfinite(values).all() and values:
            common[key] = most
    if common:
        lines.append('defaults: {' + ', '.join(f'{key}: {value:g}' for key, value in common.items()) + '}')
    lines.append('joints:')
    for name, joint in robot.joints.items():
        parts = []
        if joint.terms:
            terms = {one: gain for one, gain in joint.terms.items() if abs(gain) >= 5e-4}
            parts.append('from: {' + ', '.join(f'{one}: {gain:.4f}' for one, gain in terms.items()) + '}')
        if abs(joint.offset) >= 5e-5:
            parts.append(f'offset: {joint.offset:.4f}')
        if joint.limits:
            parts.append(f'limits: [{joint.limits[0]:.4f}, {joint.limits[1]:.4f}]')
        parts += [f'{key}: {getattr(joint, key):g}' for key in ('velocity', 'acceleration')
                  if np.isfinite(getattr(joint, key)) and getattr(joint, key) != common.get(key)]
        lines.append(f'  {name}: {{' + ', '.join(parts) + '}')
    with replacing(path) as stream:
        stream.write('\n'.join(lines) + '\n')
