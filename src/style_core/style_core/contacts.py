"""When the feet touch the ground, from the kinematics alone."""
from dataclasses import dataclass

import numpy as np

from style_core.errors import MotionError

__all__ = ['FootContacts', 'contact_intervals', 'foot_contacts', 'CMU_FEET']

#: points of each foot of a CMU skeleton: ankle (end of the shank), ball (end of the foot), toe tip
CMU_FEET = {'left': ('ltibia', 'lfoot', 'ltoes'), 'right': ('rtibia', 'rfoot', 'rtoes')}


@dataclass(frozen=True, eq=False)
class FootContacts:
    """Ground contact of one foot.

    Attributes
    ----------
    foot : str
    times : ndarray, shape (T,)
        s.
    on_ground : ndarray of bool, shape (T,)
    heel_strikes, toe_offs : ndarray
        First time of each contact and first time after it, s. A contact that the recording starts or ends in has no
        heel strike or no toe-off.
    """

    foot: str
    times: np.ndarray
    on_ground: np.ndarray
    heel_strikes: np.ndarray
    toe_offs: np.ndarray


def contact_intervals(height, speed, times, touch=(0.02, 0.6), leave=(0.05, 1.2), shortest_s=0.05):
    """Contact of one point, with hysteresis.

    Parameters
    ----------
    height : ndarray, shape (T,)
        Above the point's own level on the ground, m.
    speed : ndarray, shape (T,)
        m/s.
    times : ndarray, shape (T,)
        s.
    touch : (float, float)
        Contact begins at a height (m) and speed (m/s) both below these.
    leave : (float, float)
        It ends as soon as the height or the speed is above these.
    shortest_s : float
        Shorter contacts, and shorter gaps within one, are taken for noise.

    Returns
    -------
    ndarray of bool, shape (T,)
        A frame with a NaN is no contact.
    """
    with np.errstate(invalid='ignore'):
        surely = (height < touch[0]) & (speed < touch[1])
        possibly = (height < leave[0]) & (speed < leave[1])
    # each stretch of possible contact counts from its first sure frame on
    started = np.zeros(len(times), dtype=bool)
    state = False
    for frame in range(len(times)):
        state = possibly[frame] and (state or surely[frame])
        started[frame] = state
    for value in (True, False):  # close short gaps, then drop short contacts
        for first, last in _runs(started != value):
            inside = first > 0 and last < len(times)
            if inside and times[last] - times[first] < shortest_s:
                started[first:last] = value
    return started


def foot_contacts(motion, skeleton, feet=None, **thresholds):
    """Contacts of the feet.

    A foot is on the ground while any of its points is: low above the height that this point has when it stands, and
    slow. Standing heights are fitted: one for each point, on a floor that all share and that may be tilted (optical
    recordings often are, by a few centimetres over their length).

    Parameters
    ----------
    motion : Motion
        With its root, at a constant rate.
    skeleton : Skeleton
    feet : mapping of str to sequence of str, optional
        Foot -> bodies on its sole; `CMU_FEET` where left out.
    **thresholds
        As for `contact_intervals`.

    Returns
    -------
    dict of str to FootContacts

    Raises
    ------
    MotionError
        If a body is not in the skeleton or the motion has a single frame or no root translation.
    """
    feet = CMU_FEET if feet is None else feet
    names = skeleton.body_names
    absent = [point for points in feet.values() for point in points if point not in names]
    if absent:
        raise MotionError(f'skeleton {skeleton.name!r} has no body {", ".join(absent)}')
    if motion.n_frames < 3:
        raise MotionError('contacts need three frames or more')
    if 'm' not in motion.units:
        raise MotionError('contacts need the translation of the root: without it the feet do not stand')
    places = skeleton.forward(motion)
    up = 'xyz'.index(skeleton.up)
    points = [point for group in feet.values() for point in group]
    tracks = places[:, [names.index(point) for point in points]]
    speeds = np.linalg.norm(np.gradient(tracks, motion.times, axis=0), axis=2)
    heights = _above_floor(tracks, speeds, up)
    result = {}
    for foot, group in feet.items():
        on_ground = np.zeros(motion.n_frames, dtype=bool)
        for point in group:
            column = points.index(point)
            on_ground |= contact_intervals(heights[:, column], speeds[:, column], motion.times, **thresholds)
        runs = _runs(on_ground)
        result[foot] = FootContacts(
            foot, motion.times, on_ground,
            np.array([motion.times[first] for first, _ in runs if first > 0]),
            np.array([motion.times[last] for _, last in runs if last < motion.n_frames]))
    return result


def _above_floor(tracks, speeds, up):
    """Heights of points, tracks of shape (T, K, 3), above where each of them stands; shape (T, K)."""
    count = tracks.shape[1]
    height = tracks[..., up]
    level = np.delete(tracks, up, axis=2)
    with np.errstate(invalid='ignore'):
        slow = speeds < 0.6
    level = level - np.nanmean(level, axis=(0, 1))
    above = height - np.nanpercentile(height, 5, axis=0)
    for near in (0.12, 0.06, 0.03):  # closer and closer to the floor found so far
        with np.errstate(invalid='ignore'):
            standing = slow & (np.abs(above) < near)
        frames, points = np.nonzero(standing)
        if len(frames) < 10 * count:
            break
        # least squares for a height of each point and one slope; a slope costs as much as 0.3 m of travel can show
        matrix = np.concatenate([np.eye(count)[points], level[frames, points]], axis=1)
        prior = np.diag(np.r_[np.full(count, 1e-9), np.full(2, 0.01 * len(frames))])
        solution = np.linalg.solve(matrix.T @ matrix + prior, matrix.T @ height[frames, points])
        above = height - solution[:count] - level @ solution[count:]
    return above


def _runs(flags):
    """First frame and frame after the last of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2], edges[1::2]))
