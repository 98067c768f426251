"""Poses of the SMPL family of body models, as in the archives of AMASS."""
import warnings

import numpy as np

from style_core.angles import rotation_from_expmap, triples_from
from style_core.errors import MotionError
from style_core.motion import Motion

__all__ = ['FIELDS', 'joint_names', 'motion_of']

FIELDS = ('poses', 'trans', 'mocap_framerate', 'mocap_frame_rate')

_BODY = ['pelvis', 'left_hip', 'right_hip', 'spine1', 'left_knee', 'right_knee', 'spine2', 'left_ankle', 'right_ankle',
         'spine3', 'left_foot', 'right_foot', 'neck', 'left_collar', 'right_collar', 'head', 'left_shoulder',
         'right_shoulder', 'left_elbow', 'right_elbow', 'left_wrist', 'right_wrist']
_FINGERS = [f'{side}_{finger}{joint}' for side in ('left', 'right') for finger in
            ('index', 'middle', 'pinky', 'ring', 'thumb') for joint in (1, 2, 3)]
_NAMES = {22: _BODY, 24: [*_BODY, 'left_hand', 'right_hand'], 52: [*_BODY, *_FINGERS],
          55: [*_BODY, 'jaw', 'left_eye', 'right_eye', *_FINGERS]}


def joint_names(count):
    """Names of the joints of the model with so many: 22 (body only), 24 (SMPL), 52 (SMPL+H), 55 (SMPL-X)."""
    return tuple(_NAMES[count])


def motion_of(path, fields, rate_hz=None):
    """Motion of an archive's arrays.

    Parameters
    ----------
    path : Path
        Named in messages and in the motion.
    fields : mapping of str to ndarray
        ``poses``, shape (T, 3 J): the rotation vector of each joint relative to its parent, rad; of the first one in
        the world, whose axis z points up. ``trans``, shape (T, 3): where the body is, m. ``mocap_framerate`` (or
        ``mocap_frame_rate``), Hz.
    rate_hz : float, optional
        Where the archive lacks its frame rate.

    Returns
    -------
    Motion
        Channels ``pelvis.tx`` (m), ``pelvis.rx``, ``left_hip.rx`` (rad), ... of turns about x, y and z.

    Raises
    ------
    MotionError
        If the arrays do not fit each other, or the rate is neither there nor given.

    Warns
    -----
    UserWarning
        If a rate is given and the archive has its own, which counts.
    """
    poses = np.asarray(fields['poses'])
    if poses.dtype.kind not in 'fiu' or poses.ndim != 2 or poses.shape[1] % 3 or poses.shape[1] // 3 not in _NAMES:
        raise MotionError(f'{path}: poses of shape {poses.shape} are not those of a known body: '
                          f'{", ".join(str(3 * count) for count in _NAMES)} numbers a frame')
    names, frames = joint_names(poses.shape[1] // 3), len(poses)
    trans = np.asarray(fields.get('trans', np.zeros((frames, 3))))
    if trans.dtype.kind not in 'fiu' or trans.shape != (frames, 3):
        raise MotionError(f'{path}: trans has shape {trans.shape}, poses need ({frames}, 3)')
    if not np.isfinite(poses).all() or not np.isfinite(trans).all():
        raise MotionError(f'{path}: poses and trans must be finite')
    rate_hz = _rate(path, fields, rate_hz)
    rotations = rotation_from_expmap(poses.astype(np.float64).reshape(frames, len(names), 3))
    angles = triples_from(rotations).reshape(frames, -1)
    channels = [f'{names[0]}.t{axis}' for axis in 'xyz'] + [f'{name}.r{axis}' for name in names for axis in 'xyz']
    return Motion(channels, np.hstack([trans, angles]), np.arange(frames) / rate_hz,
                  ('m',) * 3 + ('rad',) * angles.shape[1], path.stem)


def _rate(path, fields, given):
    own = next((fields[key] for key in FIELDS[2:] if key in fields), None)
    if own is None:
        if given is None:
            raise MotionError(f'{path} lacks mocap_framerate: say the rate (--recorded-rate)')
        return given
    if given is not None:
        warnings.warn(f'{path} says its own rate: {given:g} Hz is not used', stacklevel=4)
    if own.size != 1 or own.dtype.kind not in 'fiu' or not np.isfinite(float(own.ravel()[0])) or own.ravel()[0] <= 0:
        raise MotionError(f'{path}: mocap_framerate is no positive number')
    return float(own.ravel()[0])
