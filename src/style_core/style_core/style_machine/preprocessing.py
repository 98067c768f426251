"""From joint angles to the coordinates a style machine works in, and back, exactly (Brand and Hertzmann 2000, 4.1)."""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.errors import ModelError, MotionError

__all__ = ['Coordinates', 'fit_coordinates', 'pose_weights']

_SAMPLED_FRAMES = 200


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A complete orthonormal basis of the weighted joint angles; the first ``leading`` axes carry the variation.

    Attributes
    ----------
    joint_names : tuple of str, length D
    units : tuple of str, length D
    rate_hz : float
    weights : ndarray, shape (D,)
        How far the body moves per radian of each joint, m/rad (1 without a skeleton).
    reference : ndarray, shape (D,)
        Mean of the recordings' mean poses, rad.
    basis : ndarray, shape (D, D)
        Orthonormal columns, most variation first.
    leading : int
        Number of axes used in training.
    variances : ndarray, shape (D,)
        Of the training data along each axis.
    """

    joint_names: Tuple[str, ...]
    units: Tuple[str, ...]
    rate_hz: float
    weights: np.ndarray
    reference: np.ndarray
    basis: np.ndarray
    leading: int
    variances: np.ndarray

    def encode(self, positions):
        """Joint coordinates, rad (..., D), to model coordinates (..., D)."""
        return ((positions - self.reference) * self.weights) @ self.basis

    def decode(self, coordinates):
        """Model coordinates (..., D) to joint coordinates, rad (..., D)."""
        return coordinates @ (self.basis.T / self.weights) + self.reference

    def fit(self, motion, absent='refuse'):
        """The motion with this model's joints in this model's order at this model's rate.

        Parameters
        ----------
        motion : Motion
        absent : {'refuse', 'nan'}
            What to do about joints the motion lacks: refuse it, or count them as missing.

        Raises
        ------
        ModelError
            If joints are absent, or units differ.
        """
        lacking = [name for name in self.joint_names if name not in motion.joint_names]
        if lacking and (absent == 'refuse' or len(lacking) == len(self.joint_names)):
            raise ModelError(f"{motion.name or 'the motion'} lacks {len(lacking)} of the model's "
                             f"{len(self.joint_names)} joints: {', '.join(lacking[:5])}")
        if lacking:
            units = dict(zip(self.joint_names, self.units))
            motion = motion.replace(
                joint_names=(*motion.joint_names, *lacking), units=(*motion.units, *(units[name] for name in lacking)),
                positions=np.concatenate([motion.positions, np.full((motion.n_frames, len(lacking)), np.nan)], axis=1))
        motion = motion.joints(self.joint_names)
        if motion.units != self.units:
            raise ModelError(f'{motion.name or "the motion"} has other units than the model')
        if motion.n_frames > 1 and abs(motion.rate_hz - self.rate_hz) > 1e-3 * self.rate_hz:
            motion = motion.resample(self.rate_hz)
        return motion


def pose_weights(motions, skeleton, seed=0, space=None):
    """How far the body moves when each joint turns, measured in the data.

    The root mean square, over frames, of the root of the summed squared displacements of all bodies per unit of
    the joint, by central differences of the skeleton's forward kinematics.

    Parameters
    ----------
    motions : list of Motion
    skeleton : Skeleton
        ``forward(motion)`` gives (T, B, 3) m.
    seed : int
        Chooses the frames.
    space : JointSpace, optional
        In which the motions are; joint angles where left out.

    Returns
    -------
    ndarray, shape (D,)
        m/rad (or m/m); never below a hundredth of the largest.
    """
    names = motions[0].joint_names
    poses = np.concatenate([motion.positions[~np.isnan(motion.positions).any(axis=1)] for motion in motions])
    if not len(poses):
        raise MotionError('no frame has all joints: weights of the joints cannot be measured')
    rng = np.random.default_rng(seed)
    poses = poses[rng.choice(len(poses), min(_SAMPLED_FRAMES, len(poses)), replace=False)]
    times, step = np.arange(len(poses)) / 60.0, 1e-3
    weights = np.empty(len(names))
    for column in range(len(names)):
        ends = []
        for sign in (1, -1):
            moved = poses.copy()
            moved[:, column] += sign * step
            moved = motions[0].replace(positions=moved, times=times)
            ends.append(skeleton.forward(moved if space is None else space.decode_motion(moved)))
        displacement = (ends[0] - ends[1]) / (2 * step)
        weights[column] = np.sqrt((displacement ** 2).sum(axis=(1, 2)).mean())
    if not weights.max() > 0:
        raise MotionError('no joint of the motion moves the skeleton')
    return np.maximum(weights, 0.01 * weights.max())


def fit_coordinates(motions, rate_hz, weights=None, leading=10):
    """Weights, mean poses and principal axes of recordings at one rate with the same joints.

    Parameters
    ----------
    motions : list of Motion
    rate_hz : float
    weights : ndarray, shape (D,), optional
        From `pose_weights`; 1 without.
    leading : int
        At most this many axes are used for training.

    Returns
    -------
    Coordinates

    Raises
    ------
    MotionError
        If nothing varies, or some joint is never seen in a recording.
    """
    weights = np.ones(motions[0].n_joints) if weights is None else weights
    poses, residuals = [], []
    for motion in motions:
        pose = mean_pose(motion)
        poses.append(pose)
        whole = motion.positions[~np.isnan(motion.positions).any(axis=1)]
        residuals.append((whole - pose) * weights)
    residuals = np.concatenate(residuals)
    if not len(residuals):
        raise MotionError('no frame of the recordings has all joints')
    values, vectors = np.linalg.eigh(residuals.T @ residuals / len(residuals))
    order = np.argsort(values)[::-1]
    values, vectors = np.maximum(values[order], 0.0), vectors[:, order]
    vectors *= np.sign(vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(values))])  # the same on any machine
    rank = int((values > 1e-10 * values[0]).sum()) if values[0] > 1e-16 else 0
    if rank == 0:
        raise MotionError('the recordings do not move: every frame is the mean pose')
    return Coordinates(motions[0].joint_names, motions[0].units, float(rate_hz), np.asarray(weights, dtype=float),
                       np.mean(poses, axis=0), vectors, min(leading, rank), values)


def mean_pose(motion):
    """Mean of each joint over the frames that have it, rad, shape (D,)."""
    seen = ~np.isnan(motion.positions)
    if not seen.any(axis=0).all():
        never = [name for name, some in zip(motion.joint_names, seen.any(axis=0)) if not some]
        raise MotionError(f'{motion.name or "a recording"} never shows {", ".join(never[:5])}')
    return np.nanmean(motion.positions, axis=0)
