"""Bodies on the floor: what touches it, and how a body without a root moves over it."""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.contacts import contact_intervals
from style_core.view.figure import sides

__all__ = ['Contact', 'contacts_of', 'feet_of', 'walked']

#: parts of names that bodies of a foot have
_FOOT = ('foot', 'toe', 'ankle', 'heel', 'sole', 'ball')
#: another foot carries the body once it is so much lower, m
_CHANGE_M = 0.008


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of one foot with the floor.

    Attributes
    ----------
    foot : str
    bodies : tuple of int
        Of the sole.
    on_ground : ndarray of bool, shape (T,)
    """

    foot: str
    bodies: Tuple[int, ...]
    on_ground: np.ndarray


def feet_of(body_names):
    """Foot -> numbers of its bodies, found by name; empty where no name speaks of a foot on either side."""
    names = list(body_names)
    spoken = [index for index, name in enumerate(names) if any(word in name.lower() for word in _FOOT)]
    which = dict(zip(spoken, sides([names[index] for index in spoken], names)))
    found = {side: tuple(index for index in spoken if which[index] == side) for side in ('left', 'right')}
    return {side: bodies for side, bodies in found.items() if bodies} if all(found.values()) else {}


def walked(figure, feet=None):
    """Put a body whose root is not recorded on the floor: its lowest point rests there and does not slide.

    Such a body hangs at the origin. The path that the stance foot implies is exact while one foot stands still; where
    both feet leave the floor it is not known, and the lowest point is taken to stand.

    Parameters
    ----------
    figure : Figure
    feet : mapping of str to tuple of int, optional
        As of `feet_of`, which is asked where left out; all bodies where there are no feet.

    Returns
    -------
    Figure
    """
    feet = feet_of(figure.body_names) if feet is None else feet
    chosen = sorted({body for bodies in feet.values() for body in bodies}) or range(len(figure.body_names))
    points = figure.points[:, list(chosen)]
    heights = np.where(np.isfinite(points[..., 2]), points[..., 2], np.inf)
    anchors = _anchors(heights)
    frames = np.arange(1, len(points))
    steps = points[frames, anchors[:-1], :2] - points[frames - 1, anchors[:-1], :2]
    offset = np.zeros((len(points), 3))
    offset[1:, :2] = -np.cumsum(np.nan_to_num(steps), axis=0)
    lowest = heights.min(axis=1)
    offset[:, 2] = -np.where(np.isfinite(lowest), lowest, 0.0)
    return figure.moved(offset)


def _anchors(heights):
    """Which of K points carries the body at each frame, heights of shape (T, K), with hysteresis."""
    anchors = np.empty(len(heights), dtype=int)
    anchor = int(np.argmin(heights[0]))
    for frame, row in enumerate(heights):
        lowest = int(np.argmin(row))
        if row[lowest] < row[anchor] - _CHANGE_M:
            anchor = lowest
        anchors[frame] = anchor
    return anchors


def contacts_of(figure, feet=None):
    """When the feet touch the floor at height 0, from heights above each body's own standing height and speeds.

    Parameters
    ----------
    figure : Figure
    feet : mapping of str to tuple of int, optional
        As of `feet_of`, which is asked where left out.

    Returns
    -------
    tuple of Contact
        Empty where the body has no feet by name, or fewer than three frames.
    """
    feet = feet_of(figure.body_names) if feet is None else feet
    if len(figure.times) < 3:
        return ()
    found = []
    for foot, bodies in feet.items():
        on_ground = np.zeros(len(figure.times), dtype=bool)
        for body in bodies:
            track = figure.points[:, body]
            if not np.isfinite(track).any():
                continue
            speed = np.linalg.norm(np.gradient(track, figure.times, axis=0), axis=1)
            height = track[:, 2] - np.nanpercentile(track[:, 2], 5)
            on_ground |= contact_intervals(height, speed, figure.times)
        found.append(Contact(foot, bodies, on_ground))
    return tuple(found)
