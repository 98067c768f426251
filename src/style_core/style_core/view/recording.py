"""What a page shows of a recording: the body that fits it, on the floor."""
from pathlib import Path

import numpy as np

from style_core.errors import UsageError
from style_core.view.figure import figure_of
from style_core.view.ground import feet_of, walked
from style_core.view.robot import robot_figure

__all__ = ['COLOURS', 'body_of', 'lowest_level', 'placed', 'trail_bodies']

#: colours of the motions laid side by side, right side of each body
COLOURS = ((213, 94, 0), (0, 114, 178))


def body_of(motion, skeleton, skeleton_path=None, colour=COLOURS[0]):
    """Figure, meshes and names of missing mesh files of a motion; channels that the body lacks are left out.

    Parameters
    ----------
    motion : Motion
    skeleton : Skeleton or None
    skeleton_path : path-like, optional
        Where it was read from: a ``.urdf`` file is drawn as a robot.
    colour : three int

    Raises
    ------
    UsageError
        If there is no skeleton, or none of the motion's channels is the skeleton's.
    """
    if skeleton is None:
        raise UsageError(f'{motion.name}: its format holds no skeleton: give one with --skeleton (.asf, .bvh or .urdf)')
    own = [name for name in motion.joint_names if name in set(skeleton.channel_names)]
    if not own:
        raise UsageError(f'{motion.name}: no channel ({", ".join(motion.joint_names[:4])} ...) is one of skeleton '
                         f'{skeleton.name!r} ({", ".join(skeleton.channel_names[:4])} ...)')
    motion = motion if len(own) == motion.n_joints else motion.joints(own)
    if skeleton_path is not None and Path(skeleton_path).suffix.lower() == '.urdf':
        return robot_figure(motion, skeleton_path)
    return figure_of(motion, skeleton, colour), (), ()


def placed(figure, has_root):
    """On the floor: a person without a root walks over it; what has a root, or is a robot, keeps its path.

    The lowest level that it comes to, but for 5 % of the frames, is then the floor. A robot without a root hangs by its
    trunk: how it would stand its joints alone do not say.
    """
    if not has_root and set(figure.shapes) <= {'bone', 'head'}:
        return walked(figure)
    lowest = lowest_level(figure)
    lowest = lowest[np.isfinite(lowest)]
    return figure.moved((0, 0, -np.percentile(lowest, 5) if len(lowest) else 0.0))


def lowest_level(figure):
    """Height of the lowest corner of the boxes around its parts at every frame, shape (T,), m; inf where unknown."""
    if not figure.shapes:
        return np.nanmin(figure.points[..., 2], axis=1)
    w, x, y, z = np.moveaxis(figure.wxyzs, -1, 0)
    upwards = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)
    bottom = figure.positions[..., 2] - 0.5 * (np.abs(upwards) * figure.scales).sum(axis=-1)
    return np.where(np.isfinite(bottom), bottom, np.inf).min(axis=1)


def trail_bodies(figure):
    """Bodies whose path is drawn: the first, and the first of each foot."""
    return (0, *(bodies[0] for bodies in feet_of(figure.body_names).values()))
