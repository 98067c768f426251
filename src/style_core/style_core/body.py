"""Which channels of a recording are the body's joints, by its skeleton and, where there is none, by names."""
import re
from dataclasses import dataclass
from typing import Mapping, Tuple

import numpy as np

from style_core.errors import MotionError
from style_core.motion import matching_names, triples_of

__all__ = ['BodyJoints', 'body_joints', 'common_joints']

#: what is above the pelvis in recordings without a skeleton
_ROOTS = re.compile(r'(root|joint_?root|reference|world|hips|pelvis|bip\d*( pelvis)?|floating_base(_joint)?)$', re.I)
_DIGITS = re.compile(r'(?i:finger|thumb)|InHand|(Index|Middle|Ring|Pinky|Pinkie|Little)(_?\d|$)'
                     r'|(^|[_\W])(index|middle|ring|pinky|pinkie|little)(_?\d|$)')
_TOES = re.compile(r'toe', re.I)
_ENDS = re.compile(r'(_end\d*|_?end_?site|nub|_site)$', re.I)
#: parts of a hand or foot reach no further than this share of the skeleton's size
_HAND = 0.15
#: recordings that share less than this of their joints have different skeletons
_SHARED = 0.8


@dataclass(frozen=True)
class BodyJoints:
    """Channels of the body, and what was left out.

    Attributes
    ----------
    names : tuple of str
    left_out : mapping of str to tuple of str
        Reason -> channels.
    """

    names: Tuple[str, ...]
    left_out: Mapping[str, Tuple[str, ...]]

    def described(self):
        """What was left out, in one line; empty where nothing was."""
        parts = []
        for reason, names in self.left_out.items():
            joints = list(dict.fromkeys(_joint(name) for name in names))
            more = f' and {len(joints) - 4} more' if len(joints) > 4 else ''
            parts.append(f'{reason}: {", ".join(joints[:4])}{more}')
        return '; '.join(parts)


def body_joints(motion, skeleton=None, root=False):
    """Angles of the body's joints.

    Left out are positions in space; the root and all that carries the pelvis (the bodies down to the first that has two
    moving branches), as its angles say where the body faces; fingers and single toes (branches of a body with three or
    more that reach no further than 15 % of the skeleton's size, or by name; a joint for all toes of a foot stays); and
    joints at end sites.

    Parameters
    ----------
    motion : Motion
    skeleton : Skeleton, optional
        Names decide without it.
    root : bool
        Keep a root of which all six channels are there.

    Returns
    -------
    BodyJoints

    Raises
    ------
    MotionError
        If nothing is left.
    """
    joints = list(dict.fromkeys(_joint(name) for name in motion.joint_names))
    kept_root = 'root' if root and all(f'root.{k}{a}' in motion.joint_names for k in 'tr' for a in 'xyz') else None
    roots, digits = _by_skeleton(skeleton) if skeleton is not None else (set(), set())
    sided = {joint for joint in joints if _TOES.search(joint)}
    several_toes = {joint for joint in sided if _digitless(joint) in {_digitless(o) for o in sided - {joint}}}
    balls = triples_of(motion.joint_names)
    unit_of = dict(zip(motion.joint_names, motion.units))
    reasons, kept = {}, []
    for name in motion.joint_names:
        joint = _joint(name)
        if joint == kept_root:
            reason = None
        elif unit_of[name] == 'm':
            reason = 'positions'
        elif joint in roots or (joint in balls and _ROOTS.match(joint)):
            reason = 'root'
        elif joint in digits or _DIGITS.search(joint) or joint in several_toes:
            reason = 'fingers and toes'
        elif _ENDS.search(joint):
            reason = 'end sites'
        else:
            reason = None
        if reason is None:
            kept.append(name)
        else:
            reasons.setdefault(reason, []).append(name)
    if not kept:
        raise MotionError(f'motion {motion.name!r} has no joint of a body; choose with --joints')
    return BodyJoints(tuple(kept), {reason: tuple(names) for reason, names in reasons.items()})


def common_joints(motions, patterns=None, skeletons=None, root=False):
    """Joints to learn from several recordings.

    Parameters
    ----------
    motions : sequence of Motion
    patterns : sequence of str, optional
        As for `Motion.select`, of the channels that all recordings share; the body's joints where left out.
    skeletons : sequence of (Skeleton or None), optional
        Of each motion.
    root : bool
        See `body_joints`.

    Returns
    -------
    BodyJoints

    Raises
    ------
    MotionError
        If the recordings are of different skeletons: they share less than 80 % of the body's joints.
    """
    shared = set.intersection(*(set(motion.joint_names) for motion in motions))
    if patterns:
        names = [name for name in motions[0].joint_names if name in shared]
        if not names:
            raise MotionError('the recordings have no joint in common')
        return BodyJoints(tuple(matching_names(names, patterns)), {})
    skeletons = [None] * len(motions) if skeletons is None else skeletons
    chosen = [body_joints(motion, skeleton, root) for motion, skeleton in zip(motions, skeletons)]
    names = tuple(name for name in chosen[0].names if all(name in one.names for one in chosen))
    most = max(len(one.names) for one in chosen)
    if len(names) < _SHARED * most:
        kinds = {}
        for motion, one in zip(motions, chosen):
            kinds.setdefault(frozenset(one.names), []).append(motion.name)
        listed = '; '.join(f'{len(members)} like {members[0]!r} with {len(kind)} channels'
                           for kind, members in sorted(kinds.items(), key=lambda item: -len(item[1])))
        raise MotionError(f'the recordings are of different skeletons ({listed}): they share {len(names)} of {most} '
                          f'channels of the body. Train on one kind, or say with --joints what to learn')
    left = {reason: tuple(out) for reason, out in chosen[0].left_out.items()}
    missing = tuple(name for name in max((one.names for one in chosen), key=len) if name not in names)
    if missing:
        left['not in every recording'] = missing
    return BodyJoints(names, left)


def _joint(name):
    joint, dot, axis = name.rpartition('.')
    return joint if dot and re.match(r'[rt][xyz]$|l$', axis) else name


def _digitless(joint):
    return re.sub(r'\d+', '', joint)


def _by_skeleton(skeleton):
    """Joints that carry the pelvis, and joints of digits."""
    children = {index: [] for index in range(len(skeleton.bodies))}
    for index, body in enumerate(skeleton.bodies):
        if body.parent >= 0:
            children[body.parent].append(index)
    positions, _ = skeleton.rest()
    moving, reach = {}, {}
    for index in reversed(range(len(skeleton.bodies))):
        below = children[index]
        moving[index] = bool(skeleton.bodies[index].channels) or any(moving[child] for child in below)
        reach[index] = [index, *(far for child in below for far in reach[child])]
    size = np.ptp(positions, axis=0).max()
    roots, at = set(), next((i for i, body in enumerate(skeleton.bodies) if body.parent < 0), None)
    while at is not None:
        roots |= {_joint(channel.name) for channel in skeleton.bodies[at].channels if '.' in channel.name}
        onward = [child for child in children[at] if moving[child]]
        at = onward[0] if len(onward) == 1 else None
    digits = set()
    for index, below in children.items():
        branches = [child for child in below if moving[child]]
        if len(branches) >= 3 and size > 0:
            far = max(np.linalg.norm(positions[other] - positions[index]) for other in reach[index])
            if far < _HAND * size:
                digits |= {_joint(channel.name) for child in branches for other in reach[child]
                           for channel in skeleton.bodies[other].channels}
    if not set(skeleton.channel_names) - {name for name in skeleton.channel_names if _joint(name) in roots}:
        roots = set()  # a chain without branches: an arm, a leg
    return roots, digits
