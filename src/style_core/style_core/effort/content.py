"""Content: which fragments show the same action, and a short vector that says how a fragment does it."""
from dataclasses import dataclass

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from style_core.effort.interpolation import sample_frames
from style_core.effort.pose import pose_space
from style_core.effort.warping import warp
from style_core.errors import MotionError
from style_core.style_machine.preprocessing import pose_weights

__all__ = ['joint_scale', 'content_distances', 'content_threshold', 'content_groups', 'ContentSpace', 'content_space']

#: frames to which every fragment is stretched before principal components are taken
_SET_LENGTH = 40


def joint_scale(motions, skeleton):
    """How far each joint moves the body: the weights of joints in distances and descriptors.

    Parameters
    ----------
    motions : sequence of Motion
        With the same joints; the root is left out.
    skeleton : Skeleton

    Returns
    -------
    ndarray, shape (D,)
        m/rad. The coordinates of a ball joint share their mean.
    """
    space = pose_space(motions).joints
    names = space.joint_names
    weights = pose_weights([space.encode_motion(motion.joints(names)) for motion in motions], skeleton, space=space)
    joints = [name.rpartition('.')[0] or name for name in names]
    return np.array([np.mean([w for w, other in zip(weights, joints) if other == joint]) for joint in joints])


def content_distances(sequences, progress=lambda items: items):
    """Mean squared pose distance along the best warp, for all pairs.

    Parameters
    ----------
    sequences : sequence of ndarray, shape (T_i, D)
        Scaled poses.
    progress : callable, optional
        Wraps the iteration, e.g. ``tqdm``.

    Returns
    -------
    ndarray, shape (N, N)
        Symmetric, zero diagonal. Equation (3) divided by the length of the path, so that long fragments are not less
        alike than short ones.
    """
    count = len(sequences)
    distances = np.zeros((count, count))
    for i in progress(range(count)):
        for j in range(i + 1, count):
            distances[i, j] = distances[j, i] = warp(sequences[i], sequences[j]).mean_cost
    return distances


def content_threshold(distances):
    """Distance that separates fragments of the same content from others.

    The split of the logarithms of all pair distances into two classes with the least variance within them (Otsu); the
    paper leaves the value open.

    Parameters
    ----------
    distances : ndarray, shape (N, N)

    Returns
    -------
    float
    """
    values = distances[np.triu_indices(len(distances), 1)]
    if len(values) < 2:
        return float('inf')
    logs = np.sort(np.log(np.maximum(values, 1e-12)))
    count = np.arange(1, len(logs))
    total = np.cumsum(logs)
    low, high = total[:-1] / count, (total[-1] - total[:-1]) / (len(logs) - count)
    between = count * (len(logs) - count) * (high - low)**2
    split = int(np.argmax(between))
    return float(np.exp(0.5 * (logs[split] + logs[split + 1])))


def content_groups(distances, threshold):
    """Group fragments by average linkage, cut at the threshold.

    Returns
    -------
    ndarray of int, shape (N,)
        Group of each fragment, numbered in the order in which groups first appear.
    """
    if len(distances) == 1:
        return np.zeros(1, dtype=int)
    found = fcluster(linkage(squareform(distances, checks=False), 'average'), threshold, 'distance')
    order = {}
    return np.array([order.setdefault(group, len(order)) for group in found])


@dataclass(frozen=True, eq=False)
class ContentSpace:
    """Principal components of fragments stretched to a set length (section 6).

    Attributes
    ----------
    mean : ndarray, shape (40 D,)
    basis : ndarray, shape (K, 40 D)
    """

    mean: np.ndarray
    basis: np.ndarray

    def coefficients(self, sequence):
        """Content vector c, shape (K,), of scaled poses (T, D)."""
        return self.basis @ (_stretched(sequence) - self.mean)


def content_space(sequences, components=3):
    """Fit a `ContentSpace` to scaled pose sequences.

    Raises
    ------
    MotionError
        If there are fewer than two sequences.
    """
    if len(sequences) < 2:
        raise MotionError('content needs at least two fragments')
    stacked = np.stack([_stretched(sequence) for sequence in sequences])
    mean = stacked.mean(axis=0)
    _, _, basis = np.linalg.svd(stacked - mean, full_matrices=False)
    return ContentSpace(mean, basis[:components])


def _stretched(sequence):
    return sample_frames(sequence, np.linspace(0, len(sequence) - 1, _SET_LENGTH)).ravel()
