"""The chain file: which servo moves which joint, and what each joint may do."""
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple

import numpy as np

from style_core.errors import ModelError, UsageError
from style_core.yaml_file import read_yaml

__all__ = ['Joint', 'Chain', 'load_chain']


@dataclass(frozen=True)
class Joint:
    """One joint and its servo.

    Attributes
    ----------
    name : str
    lower, upper : float
        Position limits, rad.
    velocity, acceleration : float
        Limits, rad/s and rad/s^2.
    discontinuity : float
        A target that jumps by more than this is an error of the sender, rad; see Limiter.
    following_error : float
        Largest difference between command and measurement, rad.
    id : int, optional
        Of the Dynamixel; None for joints of ros2_control.
    model : str
        Of the Dynamixel, for example ``'XM430-W350'``.
    sign : int
        +1 or -1: whether servo and joint turn the same way.
    offset : float
        Servo angle at joint angle 0, rad from the middle of the servo's range.
    reverse : bool
        Whether the servo's Drive Mode turns its scale round; checked, not written.
    homing_offset : int
        Of the servo, position values; checked, not written.
    position_p_gain : int, optional
        Position P gain to write; the servo's own if not given.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    discontinuity: float = 0.35
    following_error: float = 0.35
    id: Optional[int] = None
    model: str = ''
    sign: int = 1
    offset: float = 0.0
    reverse: bool = False
    homing_offset: int = 0
    position_p_gain: Optional[int] = None


@dataclass(frozen=True)
class Chain:
    """All joints of a robot, in the order of every array.

    Attributes
    ----------
    joints : tuple of Joint
    name : str
    """

    joints: Tuple[Joint, ...]
    name: str = ''

    @property
    def names(self):
        """Joint names."""
        return tuple(joint.name for joint in self.joints)

    def array(self, field):
        """One number of every joint: ndarray of shape (D,)."""
        return np.array([getattr(joint, field) for joint in self.joints], dtype=np.float64)


_NUMBERS = {'lower': 'rad', 'upper': 'rad', 'velocity': 'rad/s', 'acceleration': 'rad/s^2', 'discontinuity': 'rad',
            'following_error': 'rad', 'offset': 'rad'}
_WHOLE = {'id': (0, 252), 'sign': (-1, 1), 'position_p_gain': (0, 16383),
          'homing_offset': (-1044479, 1044479)}


def load_chain(path):
    """Read a chain file (YAML; config/servo/ has examples with every key explained).

    Raises
    ------
    UsageError
        Naming the file, the joint, and what is wrong with it.
    """
    path = Path(path)
    try:
        content = read_yaml(path, 'chain file')
    except ModelError as error:
        raise UsageError(str(error)) from None
    if not isinstance(content, dict) or not isinstance(content.get('joints'), dict) or not content['joints']:
        raise UsageError(f'{path} has no joints: it must have a mapping "joints" of joint names')
    unknown = set(content) - {'name', 'defaults', 'joints'}
    if unknown:
        raise UsageError(f'{path}: unknown key {", ".join(sorted(map(str, unknown)))} (known: name, defaults, joints)')
    defaults = content.get('defaults') or {}
    joints = tuple(_joint(path, str(name), {**defaults, **(values or {})})
                   for name, values in content['joints'].items())
    ids = [joint.id for joint in joints if joint.id is not None]
    twice = sorted({one for one in ids if ids.count(one) > 1})
    if twice:
        raise UsageError(f'{path}: two joints share the servo ID {", ".join(map(str, twice))}')
    if ids and len(ids) < len(joints):
        raise UsageError(f'{path}: either every joint has a servo ID or none has')
    return Chain(joints, str(content.get('name', path.stem)))


def _joint(path, name, values):
    where = f'{path}: joint {name}'
    known = Joint.__dataclass_fields__
    unknown = set(values) - set(known)
    if unknown:
        raise UsageError(f'{where}: unknown key {", ".join(sorted(map(str, unknown)))} '
                         f'(known: {", ".join(k for k in known if k != "name")})')
    missing = [key for key in ('lower', 'upper', 'velocity', 'acceleration') if key not in values]
    if missing:
        raise UsageError(f'{where} lacks {", ".join(missing)}')
    for key, unit in _NUMBERS.items():
        if key in values and not (isinstance(values[key], (int, float)) and math.isfinite(values[key])):
            raise UsageError(f'{where}: {key} must be a number in {unit}, not {values[key]!r}')
    for key, (low, high) in _WHOLE.items():
        if values.get(key) is not None and not (type(values[key]) is int and low <= values[key] <= high):
            raise UsageError(f'{where}: {key} must be a whole number from {low} to {high}, not {values[key]!r}')
    if not isinstance(values.get('reverse', False), bool):
        raise UsageError(f'{where}: reverse must be true or false, not {values["reverse"]!r}')
    joint = Joint(name=name, **values)
    if joint.sign == 0:
        raise UsageError(f'{where}: sign must be 1 or -1')
    if not joint.lower < joint.upper:
        raise UsageError(f'{where}: lower {joint.lower} must be below upper {joint.upper}')
    for key in ('velocity', 'acceleration', 'discontinuity', 'following_error'):
        if getattr(joint, key) <= 0:
            raise UsageError(f'{where}: {key} must be positive, not {getattr(joint, key)}')
    if (joint.id is None) != (not joint.model):
        raise UsageError(f'{where}: a Dynamixel needs both id and model')
    return joint
