"""Left and right: which joint is whose partner, and which angles change sign."""
import re

import numpy as np

from style_core.errors import MotionError

__all__ = ['partner_name', 'mirror_rule']

#: reflection about x = 0: translations across the plane and rotations about axes in the plane change sign
_AXIS_SIGNS = {'tx': -1.0, 'ty': 1.0, 'tz': 1.0, 'rx': 1.0, 'ry': -1.0, 'rz': -1.0}
_WORDS = {'left': 'right', 'Left': 'Right', 'LEFT': 'RIGHT'}
_WORDS.update({right: left for left, right in list(_WORDS.items())})
_LETTERS = {'l': 'r', 'r': 'l', 'L': 'R', 'R': 'L'}


def partner_name(name, names):
    """Name of the same joint on the other side.

    Parameters
    ----------
    name : str
        ``left_hip``, ``LeftHip``, ``hip_l``, ``L_hip``, ``hip.R``, ``lfemur`` and the like.
    names : container of str
        All names there are; a bare first letter (``lfemur``) counts as a side only if the partner is among them.

    Returns
    -------
    str
        The partner (which may be absent from ``names`` where the side is spelt out), or ``name`` itself for a joint
        in the middle.
    """
    spelt = re.search(r'(?:(?<=[^A-Za-z])|^)(left|right|LEFT|RIGHT)(?=[^a-z]|$)|(Left|Right)(?![a-z])', name)
    if spelt:
        return name[:spelt.start()] + _WORDS[spelt.group()] + name[spelt.end():]
    letter = re.search(r'^[lrLR](?=[_.\- ])|(?<=[_.\- ])[lrLR](?=[_.\- ]|$)', name)
    if letter:
        return name[:letter.start()] + _LETTERS[letter.group()] + name[letter.end():]
    if name[:1] in _LETTERS:
        other = _LETTERS[name[0]] + name[1:]
        if other in names:
            return other
    return name


def mirror_rule(joint_names, skeleton=None, orders=None):
    """Columns and signs that exchange left and right.

    Parameters
    ----------
    joint_names : sequence of str, length D
    skeleton : Skeleton, optional
        See `Motion.mirror`.
    orders : mapping of str to str, optional
        As `Motion.orders`: partners must turn in the same order.

    Returns
    -------
    sources : ndarray of int, shape (D,)
        ``mirrored[:, d] = signs[d] * positions[:, sources[d]]``.
    signs : ndarray, shape (D,)

    Raises
    ------
    MotionError
        If a sign is not known or a partner is absent.
    """
    known = set(joint_names) if skeleton is None else set(joint_names) | set(skeleton.channel_names)
    column = {name: index for index, name in enumerate(joint_names)}
    signs_of = None if skeleton is None else _geometric_signs(skeleton)
    sources, signs = [], []
    for name in joint_names:
        partner = partner_name(name, known)
        if partner not in column:
            raise MotionError(f'cannot mirror: {name} needs its partner {partner}, which is not there')
        sources.append(column[partner])
        own, other = ((orders or {}).get(one.rpartition('.')[0], 'XYZ') for one in (name, partner))
        if own != other:
            raise MotionError(f'cannot mirror: {name} turns in the order {own}, its partner {partner} in {other}')
        if skeleton is not None:
            if name not in signs_of:
                raise MotionError(f'cannot mirror: skeleton {skeleton.name!r} has no channel {name}')
            if not signs_of[name]:
                raise MotionError(f'cannot mirror: the axes of {name} and {partner} are not mirror images')
            signs.append(signs_of[name])
            continue
        axis = name.rpartition('.')[2]
        if axis not in _AXIS_SIGNS:
            raise MotionError(f'cannot mirror {name}: the name does not tell its axis; give a skeleton')
        if partner == name and name[:1] in _LETTERS and not re.match(r'root|low', name):
            raise MotionError(f'cannot mirror: {name} looks like one side of a pair whose other side is not there')
        signs.append(_AXIS_SIGNS[axis])
    return np.array(sources), np.array(signs)


def _geometric_signs(skeleton):
    """Channel -> +1 or -1, or 0 where its axis and its partner's are not mirror images in the rest pose.

    Reflection S = I - 2 n n^T turns a rotation by theta about a into one by -theta about S a, and a translation
    along d into one along S d.
    """
    positions, _ = skeleton.rest()
    place = dict(zip(skeleton.body_names, positions))
    normal = np.zeros(3)
    for name, position in place.items():
        partner = partner_name(name, place)
        if partner in place and name < partner:
            apart = position - place[partner]
            normal += apart if normal @ apart >= 0 else -apart
    if np.linalg.norm(normal) == 0:
        raise MotionError(f'cannot mirror: skeleton {skeleton.name!r} has no pair of left and right bodies')
    across = int(np.argmax(np.abs(normal)))
    if np.abs(normal[across]) < 0.95 * np.linalg.norm(normal):
        raise MotionError(f'cannot mirror: left and right of skeleton {skeleton.name!r} do not face each other along '
                          f'one of its axes')
    reflection = np.ones(3)
    reflection[across] = -1
    axes = skeleton.rest_axes()
    signs = {}
    for name, (kind, axis) in axes.items():
        partner = partner_name(name, axes)
        if partner in axes and axes[partner][0] == kind:
            alike = axes[partner][1] @ (axis * reflection) * (1 if kind == 't' else -1)
            signs[name] = float(np.sign(alike)) if abs(alike) > 0.99 else 0.0
        else:
            signs[name] = 0.0
    return signs
