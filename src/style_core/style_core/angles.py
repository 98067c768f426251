"""Angles that run on smoothly: unwrapping, equivalent Euler triples, exponential maps."""
import numpy as np

__all__ = ['unwrap', 'continuous_triples', 'continuous', 'matrices_of', 'triples_from', 'reordered', 'rotation_about',
           'rotation_from_expmap', 'rotation_from_quaternion']


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


def continuous(motion):
    """Give every joint of a motion a continuous course.

    Joints with all three of the channels ``.rx``, ``.ry``, ``.rz`` choose among equivalent Euler triples, all other
    angles are unwrapped; lengths stay.

    Parameters
    ----------
    motion : Motion
        Its ``orders`` say how each joint turns.

    Returns
    -------
    Motion
    """
    positions = motion.positions.copy()
    in_triple = set()
    for joint, triple in motion.triples.items():
        middle = 'XYZ'.index(motion.order_of(joint)[1])
        positions[:, triple] = continuous_triples(positions[:, triple], middle)
        in_triple.update(triple)
    rest = [c for c, unit in enumerate(motion.units) if unit == 'rad' and c not in in_triple]
    positions[:, rest] = unwrap(positions[:, rest])
    return motion.replace(positions=positions)


def matrices_of(triples, order='XYZ'):
    """Rotation matrices of Euler triples.

    Parameters
    ----------
    triples : ndarray, shape (..., 3)
        Angles about x, y and z, rad.
    order : str
        Axes in the order in which is turned about them, all fixed: ``'XYZ'`` is Rz Ry Rx.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    triples = np.asarray(triples, dtype=np.float64)
    result = np.broadcast_to(np.eye(3), triples.shape[:-1] + (3, 3))
    for letter in order:
        axis = 'XYZ'.index(letter)
        turns = rotation_about(np.eye(3)[axis], triples[..., axis].ravel())
        result = turns.reshape(result.shape) @ result
    return result


def triples_from(matrices, order='XYZ'):
    """Euler triples of rotation matrices; the inverse of `matrices_of`.

    Parameters
    ----------
    matrices : ndarray, shape (..., 3, 3)
    order : str

    Returns
    -------
    ndarray, shape (..., 3)
        Angles about x, y and z, rad, the second of the order within a quarter turn; at the gimbal lock the third of
        the order is zero.
    """
    i, j, k = ('XYZ'.index(letter) for letter in order)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # a left-handed order turns the other way round
    m = np.asarray(matrices, dtype=np.float64)
    across = np.hypot(m[..., i, i], m[..., j, i])
    locked = across < 1e-9
    result = np.empty(m.shape[:-1])
    result[..., j] = sign * np.arctan2(-m[..., k, i], across)
    result[..., i] = sign * np.where(locked, np.arctan2(-m[..., j, k], m[..., j, j]),
                                     np.arctan2(m[..., k, j], m[..., k, k]))
    result[..., k] = sign * np.where(locked, 0.0, np.arctan2(m[..., j, i], m[..., i, i]))
    return result


def reordered(motion, orders):
    """The same rotations in other orders.

    Parameters
    ----------
    motion : Motion
    orders : mapping of str to str
        Wanted order of each joint; ``'XYZ'`` where not given. Joints that turn in it already stay bit for bit.

    Returns
    -------
    Motion
    """
    positions, changed = motion.positions, {}
    for joint, triple in motion.triples.items():
        wanted = orders.get(joint, 'XYZ')
        if wanted != motion.order_of(joint):
            angles = triples_from(matrices_of(positions[:, triple], motion.order_of(joint)), wanted)
            changed[triple] = continuous_triples(angles, 'XYZ'.index(wanted[1]))
    if not changed:
        return motion
    positions = positions.copy()
    for triple, angles in changed.items():
        positions[:, triple] = angles
    return motion.replace(positions=positions, orders={joint: orders.get(joint, 'XYZ') for joint in motion.triples})


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


def rotation_from_quaternion(quaternions):
    """Rotation matrices of unit quaternions.

    Parameters
    ----------
    quaternions : ndarray, shape (..., 4)
        x, y, z, w; of length one.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    x, y, z, w = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    return np.stack(rows, axis=-1).reshape(x.shape + (3, 3))


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
