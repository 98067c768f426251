"""Joining pose sequences so that position and velocity run on across the seam."""
import numpy as np

from style_core.effort.pose import Poses

__all__ = ['Joiner', 'join']

#: a correction fades over at most this long on either side of a seam, s
_FADE_S = 0.2


class Joiner:
    """Appends sequences one at a time and yields frames that no later seam can change.

    The mismatch of pose and velocity at a seam is shared by both sides: each is moved half-way, by a quintic that
    starts with the mismatch and fades to nothing with zero slope and zero curvature.

    Parameters
    ----------
    rate_hz : float
    """

    def __init__(self, rate_hz):
        self._fade = max(2, round(_FADE_S * rate_hz))
        self._waiting = None

    def append(self, poses):
        """Add a sequence; returns the `Poses` that are final, or None."""
        if self._waiting is None:
            self._waiting = poses
            return None
        before, after = _blended(self._waiting, poses, self._fade)
        self._waiting = after
        return before

    def finish(self):
        """Return the last sequence (None where nothing was added)."""
        rest, self._waiting = self._waiting, None
        return rest


def join(sequences, rate_hz):
    """Join sequences into one.

    Parameters
    ----------
    sequences : sequence of Poses
        At least one.
    rate_hz : float

    Returns
    -------
    Poses
    """
    joiner = Joiner(rate_hz)
    parts = [part for part in map(joiner.append, sequences) if part is not None] + [joiner.finish()]
    root = None if parts[0].root is None else np.concatenate([part.root for part in parts])
    return Poses(np.concatenate([part.joints for part in parts]), root, parts[0].start)


def _blended(before, after, fade):
    joints = _meet(before.joints, after.joints, fade)
    if before.root is None or after.root is None:
        return Poses(joints[0], None, before.start), Poses(joints[1], None, after.start)
    root = _meet(before.root, after.root, fade)
    return Poses(joints[0], root[0], before.start), Poses(joints[1], root[1], after.start)


def _meet(before, after, fade):
    # at most half of each side, so that the corrections of its two seams do not overlap
    left, right = min(fade, len(before) // 2), min(fade, len(after) // 2)
    left_slope, right_slope = _slope(before[::-1]) * -1.0, _slope(after)
    slope = 0.5 * (left_slope + right_slope)
    # the last frame of one side and the first of the other are one frame apart
    gap = after[0] - before[-1] - slope
    return (before + _quintic(0.5 * gap, slope - left_slope, len(before), left, backwards=True),
            after + _quintic(-0.5 * gap, slope - right_slope, len(after), right, backwards=False))


def _slope(values):
    """Slope a frame at the first frame, second order where three frames are there."""
    if len(values) < 2:
        return np.zeros(values.shape[1])
    if len(values) == 2:
        return values[1] - values[0]
    return -1.5 * values[0] + 2.0 * values[1] - 0.5 * values[2]


def _quintic(offset, slope, length, fade, backwards):
    """Correction (length, D) with value and slope at the seam, zero curvature there, fading out in ``fade`` frames."""
    correction = np.zeros((length, len(offset)))
    if not fade:
        correction[:1] = offset
        return correction[::-1] if backwards else correction
    u = np.arange(fade + 1) / fade
    value = 1 - 10 * u**3 + 15 * u**4 - 6 * u**5
    rate = u - 6 * u**3 + 8 * u**4 - 3 * u**5
    sign = -1.0 if backwards else 1.0
    course = value[:, None] * offset + sign * fade * rate[:, None] * slope
    count = min(length, fade + 1)
    correction[:count] = course[:count]
    return correction[::-1] if backwards else correction
