"""Readers and writers of motion files, one module a format, chosen by the file's suffix."""
import importlib
from functools import lru_cache
from pathlib import Path

from style_core.errors import MotionError

__all__ = ['FORMATS', 'carried', 'read_motion', 'refuse', 'write_motion', 'skeleton_of', 'written_suffixes']

#: suffix -> module with ``read(path, **options) -> Motion`` and the names of its options in ``READ_OPTIONS``. Where it
#: writes, ``write(motion, path, **options)`` and ``WRITE_OPTIONS``. It says itself what it carries: ``SKELETON``
#: ('inside', 'beside' or None), ``CHANNELS`` (their names and units, a text) and ``HAS_UNITS`` (are units certain?)
FORMATS = {
    '.amc': 'style_core.formats.amc',
    '.bvh': 'style_core.formats.bvh',
    '.csv': 'style_core.formats.csv',
    '.npz': 'style_core.formats.npz',
    '.mcap': 'style_core.formats.bag',
    '.db3': 'style_core.formats.bag',
    '': 'style_core.formats.bag',  # a folder
    '.bag': 'style_core.formats.bag',
    '.mot': 'style_core.formats.opensim',
    '.sto': 'style_core.formats.opensim',
    '.mvnx': 'style_core.formats.mvnx',
    '.parquet': 'style_core.formats.locohub',
}

#: suffix -> what it is, and how to get from there to something that is read
_REFUSED = {
    '.c3d': 'markers, not joint angles: run inverse kinematics (OpenSim, Visual3D, Nexus) and give its .mot file or a '
            'table of angles',
    '.trc': 'markers, not joint angles: run inverse kinematics in OpenSim and give its .mot file',
    '.fbx': "a closed format: import it into Blender and export the armature's motion as .bvh",
    '.xacro': 'a template: expand it, ros2 run xacro xacro robot.urdf.xacro > robot.urdf',
    '.xml': "if it is MuJoCo's MJCF, give the .urdf of the same robot instead",
    '.mjcf': "MuJoCo's model: give the .urdf of the same robot instead",
    '.pkl': 'a pickle, which can run programs and is never read: save its arrays as .npz',
}


def read_motion(path, skeleton=None, start_s=None, stop_s=None, **options):
    """Read a motion file of any known format.

    Parameters
    ----------
    path : path-like
        A file with a suffix of `FORMATS`, or the folder of a bag.
    skeleton : Skeleton, optional
        For formats that do not describe their joints: the ``.asf`` file beside an AMC file where left out; of tables,
        archives and bags it says in which order joints turn where the file does not.
    start_s, stop_s : float, optional
        Read only the frames with ``start_s <= time < stop_s``.
    rate_hz : float, optional
        The recording's rate, for AMC files, which do not say (120 where left out), and others that may not say.
    length_m : float, optional
        Length unit of BVH files, which do not say (0.01 where left out).
    topic : str, optional
        Topic of a bag.
    unit : {'rad', 'deg'}, optional
        Of the columns of a table that name no unit, and of OpenSim files whose header does not say it.
    joints_of : path-like, optional
        URDF file of the robot whose joints a table without header holds.

    Returns
    -------
    Motion
        Angles as the file has them; `style_core.recordings.read_recording` makes them continuous.

    Raises
    ------
    MotionError
        If the file is absent, damaged or of an unknown format, or an option means nothing for it.

    Warns
    -----
    UserWarning
        Where the file departs from its format and could be read all the same.
    """
    path = Path(path)
    module = _module(path)
    options = _fitting(path, module.READ_OPTIONS, dict(options, skeleton=skeleton))
    if 'start_s' in module.READ_OPTIONS:
        return _ordered(module.read(path, start_s=start_s, stop_s=stop_s, **options), skeleton)
    motion = _ordered(module.read(path, **options), skeleton)
    return motion if start_s is None and stop_s is None else motion.slice(start_s, stop_s)


def _ordered(motion, skeleton):
    """With the skeleton's orders where the file has none of its own."""
    if skeleton is None or motion.orders:
        return motion
    orders = {joint: order for joint, order in skeleton.orders.items() if joint in motion.triples}
    return motion.replace(orders=orders)


def write_motion(motion, path, skeleton=None, **options):
    """Write a motion file; the suffix says which format, none means a bag.

    An existing file is replaced only by a complete new one.

    Parameters
    ----------
    motion : Motion
    path : path-like
    skeleton : Skeleton, optional
        For BVH, and for AMC of a skeleton other than CMU's.
    length_m : float, optional
        Length unit of a BVH file (0.01 where left out).
    topic, storage : str, optional
        Of a bag: its topic and ``'sqlite3'`` or ``'mcap'``.

    Raises
    ------
    MotionError
        If the format cannot hold the motion; the message says why.
    """
    path = Path(path)
    module = _module(path)
    if not path.is_dir() and not _writes(path.suffix.lower()):
        raise MotionError(f'{path}: {path.suffix} files are read only; written are {", ".join(written_suffixes())}')
    module.write(motion, path, **_fitting(path, module.WRITE_OPTIONS, dict(options, skeleton=skeleton)))


def skeleton_of(path, length_m=None):
    """Skeleton that belongs to a motion file: in it (BVH) or beside it (AMC); None where there is none.

    Beside ``08_01.amc`` it is ``08_01.asf`` or ``08.asf``, or the only ``.asf`` file of the folder. ``length_m`` is
    the length unit of a BVH file (0.01 where left out).
    """
    path = Path(path)
    kind = carried(path)['skeleton'] if path.suffix.lower() in FORMATS else None
    if kind == 'inside' and path.is_file():
        return _read_skeleton(path, path.stat().st_mtime_ns, length_m)
    if kind == 'beside':
        beside = {file.stem: file for file in path.parent.glob('*.[aA][sS][fF]')}
        for stem in (path.stem, path.stem.split('_')[0], next(iter(beside)) if len(beside) == 1 else None):
            if stem in beside:
                return _read_skeleton(beside[stem], beside[stem].stat().st_mtime_ns)
    return None


@lru_cache(maxsize=16)
def _read_skeleton(path, modified_ns, length_m=None):
    """A folder of recordings shares one skeleton file, which is read once."""
    from style_core.skeleton import read_skeleton
    return read_skeleton(path, length_m)


def carried(path):
    """What a format says of itself.

    Parameters
    ----------
    path : path-like
        A file, which need not be there, or a bag's folder.

    Returns
    -------
    dict
        ``skeleton``: 'inside' the file, 'beside' it, or None; ``channels``: their names and units in words;
        ``has_units``: whether the units are certain; ``written``: whether it can be written; ``options`` of reading.

    Raises
    ------
    MotionError
        If no format has the suffix.
    """
    module = _module(Path(path))
    return {'skeleton': module.SKELETON, 'channels': module.CHANNELS, 'has_units': module.HAS_UNITS,
            'written': _writes(Path(path).suffix.lower()), 'options': module.READ_OPTIONS}


def written_suffixes():
    """Suffixes of the formats that can be written, sorted."""
    return tuple(sorted(suffix for suffix in FORMATS if suffix and _writes(suffix)))


def _writes(suffix):
    module = importlib.import_module(FORMATS.get(suffix, FORMATS['']))
    return hasattr(module, 'write') and suffix not in getattr(module, 'READ_ONLY', ())


def refuse(path):
    """Raise MotionError where a file is of a kind that is known and not read; it says how to get from there."""
    suffix = Path(path).suffix.lower()
    if suffix in _REFUSED and not Path(path).is_dir():
        raise MotionError(f'{path}: no format that is read has the suffix {suffix!r}: {_REFUSED[suffix]}')


def _module(path):
    suffix = path.suffix.lower()
    if path.is_dir():
        suffix = ''
    refuse(path)
    if suffix not in FORMATS:
        known = ', '.join(sorted(filter(None, FORMATS)))
        raise MotionError(f'{path}: no format has the suffix {suffix!r}; known are {known}, and folders as bags')
    return importlib.import_module(FORMATS[suffix])


def _fitting(path, names, options):
    """The options that are given; the skeleton is dropped where a format has no use for it, others are refused."""
    given = {key: value for key, value in options.items() if value is not None}
    unfit = sorted(set(given) - set(names) - {'skeleton'})
    if unfit:
        raise MotionError(f'{path}: {", ".join(unfit)} means nothing for {path.suffix or "a bag"}')
    return {key: value for key, value in given.items() if key in names}
