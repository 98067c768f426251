"""Space-time interpolation: a motion between two motions, or a little beyond them, in pose and in timing."""
import numpy as np

from style_core.angles import reordered
from style_core.effort.pose import Poses, pose_space
from style_core.effort.warping import smooth_warp, warp
from style_core.errors import MotionError, UsageError

__all__ = ['ALPHA_RANGE', 'interpolate_poses', 'interpolate_motions', 'sample_frames']

#: extrapolating further than this turns time around or breaks poses (Torresani et al., section 7.2)
ALPHA_RANGE = (-0.25, 1.25)


def interpolate_poses(first, second, alpha, path=None, scale=None):
    """Blend two pose sequences in space and time.

    Section 5 of Torresani, Hackney and Bregler (2006), with the staircase of the warp replaced by a smooth curve, so
    that alpha = 0 and 1 return the inputs exactly and nothing stutters in between.

    Parameters
    ----------
    first, second : Poses
        At the same rate.
    alpha : float
        0 is ``first``, 1 is ``second``; from -0.25 to 1.25.
    path : Warp, optional
        Computed where not given.
    scale : ndarray, shape (D,), optional
        Weight of each joint channel in the warp.

    Returns
    -------
    Poses
        Of round((1 - alpha) n + alpha m) frames.

    Raises
    ------
    UsageError
        If alpha lies outside the range.
    MotionError
        If lengths differ too much, see `smooth_warp`.
    """
    if not ALPHA_RANGE[0] <= alpha <= ALPHA_RANGE[1]:
        raise UsageError(f'alpha must lie in [{ALPHA_RANGE[0]}, {ALPHA_RANGE[1]}], got {alpha}')
    if path is None:
        scale = 1.0 if scale is None else scale
        path = warp(first.joints * scale, second.joints * scale)
    s, delta = smooth_warp(path)
    clock = s + (2 * alpha - 1) * delta  # (1 - alpha) p + alpha q, strictly increasing by the slope limit
    frames = max(2, round((1 - alpha) * len(first) + alpha * len(second)))
    ticks = np.linspace(0.0, clock[-1], frames)
    p, q = np.interp(ticks, clock, s - delta), np.interp(ticks, clock, s + delta)
    joints = (1 - alpha) * sample_frames(first.joints, p) + alpha * sample_frames(second.joints, q)
    root = None
    if first.root is not None and second.root is not None:
        root = (1 - alpha) * _sample_root(first.root, p) + alpha * _sample_root(second.root, q)
    return Poses(joints, root, first.start)


def interpolate_motions(first, second, alpha):
    """Blend two motions in space and time.

    Parameters
    ----------
    first, second : Motion
        With the same joints; ``second`` is resampled to the rate of ``first``.
    alpha : float
        0 is ``first``, 1 is ``second``; from -0.25 to 1.25.

    Returns
    -------
    Motion

    Raises
    ------
    MotionError
        If joints differ or values are missing.
    UsageError
        If alpha lies outside the range.
    """
    if set(first.joint_names) != set(second.joint_names):
        differing = sorted(set(first.joint_names) ^ set(second.joint_names))
        raise MotionError(f'cannot interpolate motions that differ in joints {", ".join(differing[:5])}')
    space = pose_space([first, second])
    # a resampling that changes nothing but rounding would cost the exactness at the ends
    rate = first.rate_hz
    a, b = (space.encode(motion if abs(motion.rate_hz - rate) < 1e-6 * rate else motion.resample(rate))
            for motion in (first, second))
    near = (first if alpha <= 0.5 else reordered(second, {**second.orders, **first.orders})).joints(space.joint_names)
    name = f'{first.name}~{second.name}@{alpha:g}'
    blend = space.decode(interpolate_poses(a, b, alpha), rate, name, near.positions[0])
    return blend.joints(first.joint_names)


def sample_frames(values, frames):
    """Values (T, D) at fractional frames by Catmull-Rom cubics; whole frames are returned exactly."""
    last = len(values) - 1
    frames = np.clip(frames, 0.0, last)
    whole = np.rint(frames)
    frames = np.where(np.abs(frames - whole) < 1e-9, whole, frames)
    left = np.minimum(frames.astype(int), max(last - 1, 0))
    u = (frames - left)[:, None]
    a, b = values[left], values[np.minimum(left + 1, last)]
    slope_a = 0.5 * (b - values[np.maximum(left - 1, 0)])
    slope_b = 0.5 * (values[np.minimum(left + 2, last)] - a)
    result = ((1 + 2 * u) * (1 - u)**2 * a + u**2 * (3 - 2 * u) * b
              + u * (1 - u) * ((1 - u) * slope_a - u * slope_b))
    exact = frames == whole
    result[exact] = values[whole[exact].astype(int)]
    return result


def _sample_root(root, frames):
    """As `sample_frames`; travel and turning a frame, columns 0, 1 and 3, scale with the speed of replay."""
    result = sample_frames(root, frames)
    speed = np.diff(frames)
    speed = np.concatenate([speed[:1], speed])
    result[:, [0, 1, 3]] *= speed[:, None]
    return result
