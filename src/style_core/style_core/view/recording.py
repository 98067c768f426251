"""What a page shows of a recording: the body that fits it, on the floor."""
from pathlib import Path

import numpy as np

from style_core.errors import UsageError
from style_core.view.figure import figure_of
from style_core.view.ground import feet_of, walked
from style_core.view.robot import robot_figure

__all__ = ['COLOURS', 'body_of', 'placed', 'trail_bodies']

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
    """On the floor: a body without a root walks over it; one with a root keeps its path, its lowest level at 0."""
    if not has_root:
        return walked(figure)
    lowest = np.min(np.where(np.isfinite(figure.points[..., 2]), figure.points[..., 2], np.inf), axis=1)
    lowest = lowest[np.isfinite(lowest)]
    return figure.moved((0, 0, -np.percentile(lowest, 5) if len(lowest) else 0.0))


def trail_bodies(figure):
    """Bodies whose path is drawn: the first, and the first of each foot."""
    return (0, *(bodies[0] for bodies in feet_of(figure.body_names).values()))
