"""Angles that run on smoothly: unwrapping, equivalent Euler triples, exponential maps."""
import numpy as np

__all__ = ['unwrap', 'continuous_triples', 'continuous', 'rotation_about', 'rotation_from_expmap']


def unwrap(angles):
    """Remove jumps of whole turns along the first axis.

    Parameters
    ----------
    angles : ndarray, shape (T, D)
        Rad; missing values (NaN) are stepped over and stay.

    Returns
    -------
    ndarray, shape (T, D)
        Each column moved by whole turns, so that steps are at most half a turn and the column's median lies within
        half a turn of zero.
    """
    result = np.array(angles, dtype=np.float64)
    complete = ~np.isnan(result).any(axis=0)
    result[:, complete] = np.unwrap(result[:, complete], axis=0)
    for column in np.flatnonzero(~complete):
        there = ~np.isnan(result[:, column])
        result[there, column] = np.unwrap(result[there, column])
    return result - _turns(result)


def continuous_triples(triples, middle, near=None):
    """Choose among equivalent Euler triples so that the course is continuous.

    The rotation of Tait-Bryan angles (a, b, c), b about the second axis of the order, is also that of
    (a + pi, pi - b, c + pi). Which of both a frame needs depends only on the frame before it, and exchanging both in
    both frames leaves their distance as it is; so the choice is the running parity of the exchanges.

    Parameters
    ----------
    triples : ndarray, shape (T, 3)
        Rad; frames with a NaN are stepped over and stay.
    middle : {0, 1, 2}
        Which column turns about the second axis of the order.
    near : array_like, shape (3,), optional
        Where the course comes from, rad.

    Returns
    -------
    ndarray, shape (T, 3)
        The same rotations, unwrapped; as a whole on the branch with the smaller angles, or the one that begins nearest
        to ``near``.
    """
    result = np.array(triples, dtype=np.float64)
    there = ~np.isnan(result).any(axis=1)
    here = result[there]
    if not len(here):
        return result
    other = _equivalent(here, middle)
    stay = np.sum(_wrapped(here[1:] - here[:-1])**2, axis=1)
    change = np.sum(_wrapped(other[1:] - here[:-1])**2, axis=1)
    exchanged = np.concatenate([[False], np.cumsum(change < stay) % 2 == 1])
    branch = unwrap(np.where(exchanged[:, None], other, here))
    opposite = unwrap(_equivalent(branch, middle))
    if near is None:
        sizes = [np.sum(one**2) for one in (branch, opposite)]
    else:
        branch, opposite = (one + 2 * np.pi * np.round((near - one[0]) / (2 * np.pi)) for one in (branch, opposite))
        sizes = [np.sum((one[0] - near)**2) for one in (branch, opposite)]
    result[there] = branch if sizes[0] <= sizes[1] else opposite
    return result


def continuous(motion, orders=None):
    """Give every joint of a motion a continuous course.

    Joints with all three of the channels ``.rx``, ``.ry``, ``.rz`` choose among equivalent Euler triples, all other
    angles are unwrapped; lengths stay.

    Parameters
    ----------
    motion : Motion
    orders : mapping of str to str, optional
        Order of rotation of a joint, e.g. ``{'hip': 'ZXY'}``; ``'XYZ'`` where not given.

    Returns
    -------
    Motion
    """
    orders = orders or {}
    positions = motion.positions.copy()
    column = {name: index for index, name in enumerate(motion.joint_names)}
    in_triple = set()
    for name in motion.joint_names:
        joint, _, axis = name.rpartition('.')
        triple = [column.get(f'{joint}.r{letter}') for letter in 'xyz']
        if axis == 'rx' and None not in triple:
            middle = 'XYZ'.index(orders.get(joint, 'XYZ')[1].upper())
            positions[:, triple] = continuous_triples(positions[:, triple], middle)
            in_triple.update(triple)
    rest = [c for c, unit in enumerate(motion.units) if unit == 'rad' and c not in in_triple]
    positions[:, rest] = unwrap(positions[:, rest])
    return motion.replace(positions=positions)


def rotation_about(axis, angles):
    """Rotation matrices about one axis.

    Parameters
    ----------
    axis : array_like, shape (3,)
        Unit vector.
    angles : ndarray, shape (T,)
        Rad.

    Returns
    -------
    ndarray, shape (T, 3, 3)
    """
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angles = angles[:, None, None]
    return np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross)


def rotation_from_expmap(expmaps):
    """Rotation matrices of exponential maps (Rodrigues' formula).

    Parameters
    ----------
    expmaps : ndarray, shape (..., 3)
        Axis times angle, rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    expmaps = np.asarray(expmaps, dtype=np.float64)
    angle = np.linalg.norm(expmaps, axis=-1)[..., None, None]
    cross = np.zeros(expmaps.shape[:-1] + (3, 3))
    cross[..., 2, 1], cross[..., 0, 2], cross[..., 1, 0] = expmaps[..., 0], expmaps[..., 1], expmaps[..., 2]
    cross -= np.swapaxes(cross, -1, -2)
    # sin(x) / x and (1 - cos(x)) / x^2 without dividing by zero
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi))**2
    return np.eye(3) + first * cross + second * (cross @ cross)


def _wrapped(angles):
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _equivalent(triples, middle):
    other = triples + np.pi
    other[:, middle] = np.pi - triples[:, middle]
    return other


def _turns(columns):
    """Whole turns to take off each column so that its median lies within half a turn of zero."""
    if not columns.size:
        return 0.0
    with np.errstate(invalid='ignore'):
        centre = np.array([np.median(column[~np.isnan(column)]) if not np.isnan(column).all() else 0.0
                           for column in columns.T])
    return 2 * np.pi * np.round(centre / (2 * np.pi))
