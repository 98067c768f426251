"""NumPy archives (``.npz``): a motion exactly as it is, never pickled; or the poses of a body model (AMASS)."""
import warnings

import numpy as np

from style_core.archive import read_archive
from style_core.errors import MotionError
from style_core.formats import smpl
from style_core.formats.files import replacing, write_arrays
from style_core.motion import Motion

__all__ = ['read', 'write']

READ_OPTIONS = ('rate_hz',)
WRITE_OPTIONS = ()
SKELETON = None
CHANNELS = "as joint_names says, or SMPL's: left_hip.rx [rad], pelvis.tx [m]"
HAS_UNITS = False

_FIELDS = ('joint_names', 'positions', 'times', 'units', 'name', 'epoch_ns', 'orders')


def read(path, rate_hz=None):
    """Read a motion that `write` wrote; any archive with ``joint_names``, ``positions`` and ``times`` will do.

    An archive with ``poses`` in their place is read by `style_core.formats.smpl`; ``rate_hz`` is for one that lacks its
    frame rate, others keep theirs with a UserWarning.
    """
    try:
        fields = read_archive(path, _FIELDS + smpl.FIELDS)
    except FileNotFoundError:
        raise MotionError(f'{path} does not exist') from None
    except IsADirectoryError:
        raise MotionError(f'{path} is a folder') from None
    except (OSError, ValueError) as error:
        raise MotionError(f'{path} is not a readable NumPy archive: {error}') from None
    if 'poses' in fields and 'positions' not in fields:
        return smpl.motion_of(path, fields, rate_hz)
    if rate_hz is not None:
        warnings.warn(f'{path} has its own times: the rate of {rate_hz:g} Hz is not used', stacklevel=3)
    absent = [key for key in _FIELDS[:3] if key not in fields]
    if absent:
        raise MotionError(f'{path} is no motion: it lacks {", ".join(absent)}')
    for key, kinds in zip(_FIELDS, ('U', 'fiu', 'fiu', 'U', 'U', 'iu', 'U')):
        if key in fields and fields[key].dtype.kind not in kinds:
            raise MotionError(f'{path}: {key} has the wrong type {fields[key].dtype}')
    if fields['joint_names'].ndim != 1 or np.ndim(fields.get('units', [])) != 1:
        raise MotionError(f'{path}: joint_names and units must be lists')
    orders = fields.get('orders', np.empty((0, 2), dtype='U1'))
    if orders.ndim != 2 or orders.shape[1] != 2:
        raise MotionError(f'{path}: orders must be pairs of a joint and its order of rotation')
    for key in ('name', 'epoch_ns'):
        if np.size(fields.get(key, 0)) != 1:
            raise MotionError(f'{path}: {key} must be a single value')
    return Motion(fields['joint_names'].tolist(), fields['positions'], fields['times'],
                  fields['units'].tolist() if 'units' in fields else None,
                  str(np.ravel(fields.get('name', path.stem))[0]), int(np.ravel(fields.get('epoch_ns', 0))[0]),
                  dict(orders.tolist()))


def write(motion, path):
    """Write a motion."""
    orders = np.array(sorted(motion.orders.items()), dtype=str).reshape(-1, 2)
    with replacing(path, 'wb') as stream:
        write_arrays(stream, joint_names=np.array(motion.joint_names), positions=motion.positions,
                     times=motion.times, units=np.array(motion.units), name=np.array(motion.name),
                     epoch_ns=np.array(motion.epoch_ns, dtype=np.int64), orders=orders)
