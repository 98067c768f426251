"""The joints that a training command learns, and what it says of those it leaves out."""
from style_core.body import common_joints
from style_core.formats import skeleton_of

__all__ = ['JOINTS_HELP', 'chosen_joints']

JOINTS_HELP = ("joints to learn, as shell patterns; '!PATTERN' excludes (default: the body's joints: no root, no "
               'positions, no fingers and toes, no end sites)')


def chosen_joints(motions, paths, patterns=None, root=False):
    """Names of the joints to learn that all recordings have; prints what is left out and why.

    Parameters
    ----------
    motions : sequence of Motion
    paths : sequence of path-like
        Their files, for their skeletons.
    patterns : sequence of str, optional
    root : bool
        Keep a root that travels.
    """
    found = common_joints(motions, patterns, None if patterns else [skeleton_of(path) for path in paths], root)
    if found.left_out:
        print(f'left out: {found.described()} (--joints says otherwise)')
    return list(found.names)
