"""Coordinates of joints in which poses may be averaged, wherever a recording's angles wrap or lock."""
from style_core.joint_space.space import JointSpace, fit_space, read_space, space_of

__all__ = ['JointSpace', 'fit_space', 'read_space', 'space_of']
