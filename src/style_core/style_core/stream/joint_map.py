"""Which robot joint is which model joint, and how its angle is counted."""
from dataclasses import dataclass
from typing import Mapping, Optional, Tuple

import numpy as np

from style_core.errors import ModelError
from style_core.joint_file import read_joint_file
from style_core.stream.bound_map import BoundMap

__all__ = ['JointRule', 'JointMap', 'identity_map', 'read_joint_map']


@dataclass(frozen=True)
class JointRule:
    """One joint: ``robot = sign * scale * model + offset``.

    Attributes
    ----------
    robot : str
        The joint's name on the robot.
    sign : int
        1 or -1.
    offset : float
        Robot angle where the model's is zero, rad.
    scale : float
        Robot angle per model angle, > 0.
    limits : tuple of float, optional
        Lower and upper robot angle, rad.
    """

    robot: str
    sign: int = 1
    offset: float = 0.0
    scale: float = 1.0
    limits: Optional[Tuple[float, float]] = None

    def __post_init__(self):
        numbers = (self.offset, self.scale) + (self.limits or ())
        if not isinstance(self.robot, str) or not self.robot:
            raise ModelError(f'the robot joint must be a name, not {self.robot!r}')
        if any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in (self.sign,) + numbers):
            raise ModelError(f'{self.robot}: sign, offset, scale and limits must be numbers')
        if self.sign not in (1, -1):
            raise ModelError(f'{self.robot}: sign must be 1 or -1, not {self.sign}')
        if not np.isfinite(numbers).all() or self.scale <= 0:
            raise ModelError(f'{self.robot}: offset and limits must be finite and scale positive')
        if self.limits is not None and (len(self.limits) != 2 or self.limits[0] >= self.limits[1]):
            raise ModelError(f'{self.robot}: limits must be [lower, upper] with lower < upper, not {self.limits}')


@dataclass(frozen=True)
class JointMap:
    """Rules by model joint name.

    Attributes
    ----------
    rules : mapping of str to JointRule
    keep_unlisted : bool
        Whether model joints without a rule are on the robot under their own names.
    """

    rules: Mapping[str, JointRule]
    keep_unlisted: bool = False

    def bind(self, model_joints):
        """Fit the map to a model's joint names.

        Raises
        ------
        ModelError
            If a rule names a joint the model does not have, two model joints meet in one robot joint, or nothing
            is left.
        """
        model_joints = tuple(model_joints)
        strange = [name for name in self.rules if name not in model_joints]
        if strange:
            raise ModelError(f'the joint map names {", ".join(strange)}, which the model does not have; '
                             f'it has {", ".join(model_joints)}')
        pairs = [(i, self.rules[name] if name in self.rules else JointRule(name))
                 for i, name in enumerate(model_joints) if name in self.rules or self.keep_unlisted]
        if not pairs:
            raise ModelError('the joint map leaves no joint of the model')
        names = [rule.robot for _, rule in pairs]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ModelError(f'several model joints are mapped to {", ".join(twice)}')
        limits = np.array([rule.limits or (-np.inf, np.inf) for _, rule in pairs])
        return BoundMap(
            robot_joints=tuple(names), channels=np.array([i for i, _ in pairs]),
            gain=np.array([float(rule.sign * rule.scale) for _, rule in pairs]),
            offset=np.array([float(rule.offset) for _, rule in pairs]),
            lower=limits[:, 0], upper=limits[:, 1])


def identity_map():
    """The map of a robot whose joints are named and counted as the model's."""
    return JointMap({}, keep_unlisted=True)


def read_joint_map(path):
    """Read a joint map from YAML.

    The file holds ``joints``, a mapping from model joint to the robot joint's name or to a mapping with ``robot`` and,
    as needed, ``sign``, ``offset`` (rad), ``scale`` and ``limits`` (rad); and optionally ``unlisted: keep`` or ``drop``
    (default) for the model joints it does not list.

    Raises
    ------
    ModelError
        If the file cannot be read or does not have this form; the message names the entry.
    """
    joints, keep_unlisted, _ = read_joint_file(path, 'joint map')
    return JointMap({name: _read_rule(f'{path}, joint {name}', entry) for name, entry in joints.items()}, keep_unlisted)


def _read_rule(where, entry):
    try:
        return _rule(entry)
    except ModelError as error:
        raise ModelError(f'{where}: {error}') from None


def _rule(entry):
    if isinstance(entry, str):
        return JointRule(entry)
    if not isinstance(entry, dict):
        raise ModelError('must be a robot joint name or a mapping with "robot"')
    strange = set(entry) - {'robot', 'sign', 'offset', 'scale', 'limits'}
    if strange or 'robot' not in entry:
        raise ModelError('must have "robot", may have sign, offset, scale, limits'
                         + (f', and cannot have {", ".join(map(str, sorted(strange, key=str)))}' if strange else ''))
    entry = dict(entry)
    if entry.get('limits') is not None:
        if not isinstance(entry['limits'], list):
            raise ModelError('limits must be [lower, upper]')
        entry['limits'] = tuple(entry['limits'])
    return JointRule(**entry)
