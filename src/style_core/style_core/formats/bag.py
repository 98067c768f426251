"""ROS 2 bags of ``sensor_msgs/msg/JointState`` (sqlite3, MCAP), read and written without ROS; ROS 1 bags are read."""
import contextlib
import os
import shutil
import tempfile
import warnings
from pathlib import Path

import numpy as np

from style_core.errors import MotionError
from style_core.motion import Motion, usual_units

__all__ = ['read', 'write', 'topics', 'JOINT_STATE', 'DEFAULT_TOPIC']

READ_OPTIONS = ('topic', 'start_s', 'stop_s')
WRITE_OPTIONS = ('topic', 'storage')
#: suffixes that are not written (of ROS 1)
READ_ONLY = ('.bag',)
SKELETON = None
CHANNELS = 'as the messages name them'
HAS_UNITS = False

JOINT_STATE = 'sensor_msgs/msg/JointState'
DEFAULT_TOPIC = '/joint_states'

#: a stamp further back than this before an earlier one is a clock that was set back, not a late message, s
_SET_BACK_S = 0.5

#: no joint goes to zero and back by more than this from one message to the next, rad
_IDLE_JUMP_RAD = 0.2

#: a zero stamp means that there is none, so a motion without absolute time is written from one second on
_START_NS = 1_000_000_000


def topics(path):
    """Topics of a bag with joint states: name -> number of messages."""
    with _open(path) as reader:
        return {connection.topic: sum(other.msgcount for other in reader.connections if other.topic == connection.topic)
                for connection in reader.connections if connection.msgtype == JOINT_STATE}


def read(path, topic=None, start_s=None, stop_s=None):
    """Read the joint states of a bag.

    Messages may hold different joints, from one or several publishers. The frames are the stamps of the joint that
    is heard most often; a joint that is silent at some of them is NaN there; a joint that comes at stamps of its own
    (another publisher) is interpolated between them, never beyond them or over a gap.

    Parameters
    ----------
    path : path-like
        Folder of the bag, or a ``.mcap`` or ``.db3`` file; or the ``.bag`` file of ROS 1.
    topic : str, optional
        The only topic of joint states, or ``/joint_states``, where left out.
    start_s, stop_s : float, optional
        Only what was recorded in ``start_s <= time < stop_s``, counted from the topic's first message.

    Returns
    -------
    Motion
        Time zero is the first stamp read from the topic, ``epoch_ns`` in absolute time. Messages with zero stamp
        count from the time they were recorded.

    Raises
    ------
    MotionError
        If the bag is damaged or has no joint states, or its stamps are set back (a bag of a simulation that was
        started again: read its parts by ``start_s`` and ``stop_s``).

    Warns
    -----
    UserWarning
        With the number of messages that could not be used, and of values that are infinite.
    """
    message_of = _deserializer(path)
    with _open(path) as reader:
        known = sorted({connection.topic for connection in reader.connections if connection.msgtype == JOINT_STATE})
        if topic is None:
            topic = known[0] if len(known) == 1 else DEFAULT_TOPIC
        connections = [connection for connection in reader.connections
                       if connection.topic == topic and connection.msgtype == JOINT_STATE]
        if not connections:
            raise MotionError(f'{path} has no joint states on {topic}; topics with {JOINT_STATE}: '
                              f'{", ".join(known) or "none"}')
        first = next(iter(reader.messages(connections)), None)
        if first is None:
            raise MotionError(f'{path} has no message on {topic}')
        limits = [None if limit is None else int(first[1] + round(limit * 1e9)) for limit in (start_s, stop_s)]
        origin = _stamp(message_of(first[2]), first[1])
        series = _series(path, ((message_of(data), recorded) for _, recorded, data in
                                reader.messages(connections, start=limits[0], stop=limits[1])))
    if not series:
        raise MotionError(f'{path} has no joint positions on {topic}'
                          f'{" in this range" if (start_s, stop_s) != (None, None) else ""}')
    return _merged(series, origin, Path(path).stem)


def write(motion, path, topic=None, storage=None):
    """Write a bag of joint states, one message a frame; missing positions are NaN.

    Parameters
    ----------
    motion : Motion
    path : path-like
        A folder, or a single ``.mcap`` file.
    topic : str, optional
        ``/joint_states`` where left out.
    storage : {'sqlite3', 'mcap'}, optional
        Of a folder; ``sqlite3`` (the default of Humble) where left out.

    Raises
    ------
    MotionError
        If the path is taken by something that is no bag.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
    path = Path(path)
    single = path.suffix.lower() == '.mcap'
    storage = 'mcap' if single else storage or 'sqlite3'
    if path.suffix.lower() == '.db3':
        raise MotionError(f'{path}: a .db3 file is only a part of a bag; give the name of a folder')
    if storage not in ('sqlite3', 'mcap'):
        raise MotionError(f"{path}: bags are stored as 'sqlite3' or 'mcap', not {storage!r}")
    if not path.absolute().parent.is_dir():
        raise MotionError(f'the folder {path.parent} does not exist')
    if path.is_dir() if single else path.exists() and not _is_bag(path):
        raise MotionError(f'{path} exists and is no bag; it stays as it is')
    if motion.orders:
        warnings.warn(f'{path}: a bag has no place for the orders in which joints turn ({next(iter(motion.orders))} '
                      f'and others): give the skeleton when it is read', stacklevel=3)
    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, time = (store.types[name] for name in
                           (JOINT_STATE, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    stamps = (motion.epoch_ns or _START_NS) + np.round(motion.times * 1e9).astype(np.int64)
    if stamps[0] < 0 or (np.diff(stamps) <= 0).any():
        raise MotionError(f'{path}: the times cannot be stamps in nanoseconds: they are negative or closer than 1 ns')
    names, nothing = list(motion.joint_names), np.empty(0)
    given, path = path, Path(os.path.realpath(path))
    folder = Path(tempfile.mkdtemp(dir=path.parent, prefix='.' + path.name, suffix='.part'))
    try:
        with Writer(folder / path.stem, version=8, storage_plugin=getattr(StoragePlugin, storage.upper())) as bag:
            connection = bag.add_connection(topic or DEFAULT_TOPIC, JOINT_STATE, typestore=store)
            for stamp, positions in zip(stamps.tolist(), motion.positions):
                at = time(sec=stamp // 10**9, nanosec=stamp % 10**9)
                message = state(header=header(stamp=at, frame_id=''), name=names, position=positions,
                                velocity=nothing, effort=nothing)
                bag.write(connection, stamp, store.serialize_cdr(message, JOINT_STATE))
        if single:
            written = next((folder / path.stem).glob('*.mcap'))
            if path.exists():
                written.chmod(path.stat().st_mode & 0o7777)
            os.replace(written, path)
        else:
            if path.exists():
                path.rename(folder / 'replaced')
            (folder / path.stem).rename(path)
    except Exception as error:  # a full disk shows in the library's, sqlite's and Python's own ways
        raise MotionError(f'{given} cannot be written: {error}') from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _open(path):
    """A reader of the bag; whatever its library stumbles over in a damaged bag becomes a MotionError."""
    path = Path(path)
    if _of_ros1(path):
        from rosbags.rosbag1 import Reader
    else:
        from rosbags.rosbag2 import Reader
    if not path.exists():
        raise MotionError(f'{path} does not exist')
    if path.is_dir() and not (path / 'metadata.yaml').is_file():
        raise MotionError(f'{path} is a folder without metadata.yaml, so it is no bag (ros2 bag reindex can mend one)')
    try:
        with Reader(path) as reader:
            yield reader
    except (MotionError, KeyboardInterrupt):
        raise
    except Exception as error:
        raise MotionError(f'{path} is not a readable bag (damaged or truncated?): {error}') from None


def _of_ros1(path):
    return Path(path).suffix.lower() == '.bag' and not Path(path).is_dir()


def _deserializer(path):
    """Function that makes a joint state of a message's bytes."""
    from rosbags.typesys import Stores, get_typestore
    if _of_ros1(path):
        store = get_typestore(Stores.ROS1_NOETIC)
        return lambda data: store.deserialize_ros1(data, JOINT_STATE)
    store = get_typestore(Stores.ROS2_HUMBLE)
    return lambda data: store.deserialize_cdr(data, JOINT_STATE)


def _is_bag(path):
    return path.is_dir() and (path / 'metadata.yaml').is_file() and all(
        file.name == 'metadata.yaml' or file.suffix in ('.db3', '.mcap', '.zstd') for file in path.iterdir())


def _stamp(message, recorded):
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    return stamp or recorded


def _series(path, messages):
    """Joint -> (stamps in ns, positions) in the order of the messages."""
    gathered, latest, unusable, unstamped = {}, {}, 0, 0
    for message, recorded in messages:
        names = tuple(message.name)
        if not names or len(message.position) != len(names) or len(set(names)) != len(names):
            unusable += 1
            continue
        unstamped += not (message.header.stamp.sec or message.header.stamp.nanosec)
        stamp = _stamp(message, recorded)
        if stamp < latest.get(names, stamp) - _SET_BACK_S * 1e9:
            raise MotionError(f'{path}: the stamps are set back by {(latest[names] - stamp) * 1e-9:.3f} s in a message '
                              f'recorded at {recorded * 1e-9:.3f} s; read the parts before and after by start and stop')
        latest[names] = max(stamp, latest.get(names, stamp))
        # publishers of the same joints may list them in different orders
        listed, stamps, positions = gathered.setdefault(frozenset(names), (names, [], []))
        stamps.append(stamp)
        positions.append(message.position if names == listed else
                         [message.position[names.index(name)] for name in listed])
    series, idle, twofold = {}, 0, 0
    for names, stamps, positions in gathered.values():
        stamps, positions = np.array(stamps, dtype=np.int64), np.array(positions, dtype=np.float64)
        kept, differing = _of_one_publisher(stamps, positions)
        idle, twofold = idle + int((~kept).sum()), twofold + differing
        for name, column in zip(names, positions[kept].T):
            series.setdefault(name, []).append((stamps[kept], column))
    infinite = 0
    for name, parts in series.items():
        stamps = np.concatenate([part[0] for part in parts])
        values = np.concatenate([part[1] for part in parts])
        infinite += int(np.isinf(values).sum())
        values[np.isinf(values)] = np.nan
        order = np.argsort(stamps, kind='stable')
        stamps, values = stamps[order], values[order]
        last = np.append(np.diff(stamps) > 0, True)  # of several messages with one stamp the last counts
        series[name] = stamps[last], values[last]
    for count, what in ((unusable, 'messages without a position for each of their joints were left out'),
                        (unstamped, 'messages without a stamp count from the time they were recorded'),
                        (infinite, 'infinite positions count as missing'),
                        (idle, 'messages of zeros only, amid others that move, were left out: a second publisher?'),
                        (twofold, 'stamps come again with other positions, the last count: a second publisher?')):
        if count:
            warnings.warn(f'{path}: {count} {what}', stacklevel=4)
    return series


def _of_one_publisher(stamps, positions):
    """Which messages count, and how many stamps are left that come again with other positions.

    A message of zeros only does not count where another one has its stamp, or where both messages beside it are
    further from zero than a joint could go meanwhile.
    """
    order = np.argsort(stamps, kind='stable')
    sorted_stamps, rows = stamps[order], positions[order]
    size = np.abs(np.where(np.isnan(rows), 0.0, rows)).max(axis=1, initial=0.0)
    zero = (rows == 0).all(axis=1)
    kept = np.ones(len(rows), dtype=bool)
    if zero.any() and not zero.all():
        again = sorted_stamps[1:] == sorted_stamps[:-1]
        beside = np.zeros(len(rows), dtype=bool)   # another message, not of zeros, has the stamp
        beside[1:] |= again & ~zero[:-1]
        beside[:-1] |= again & ~zero[1:]
        before, after = np.append(0.0, size[:-1]), np.append(size[1:], 0.0)
        kept = ~(zero & (beside | (np.minimum(before, after) > _IDLE_JUMP_RAD)))
    left = np.flatnonzero(kept)
    same = sorted_stamps[left][1:] == sorted_stamps[left][:-1]
    with np.errstate(invalid='ignore'):
        other = (np.abs(rows[left][1:] - rows[left][:-1]) > 1e-9).any(axis=1)
    result = np.empty(len(rows), dtype=bool)
    result[order] = kept
    return result, int((same & other).sum())


def _merged(series, origin, name):
    frames = max((stamps for stamps, _ in series.values()), key=len)
    times = (frames - origin) * 1e-9
    columns = []
    for stamps, values in series.values():
        place = np.minimum(np.searchsorted(frames, stamps), len(frames) - 1)
        if (frames[place] == stamps).all():
            column = np.full(len(frames), np.nan)
            column[place] = values
        else:
            column = Motion(('joint',), values[:, None], (stamps - origin) * 1e-9).at(times).positions[:, 0]
        columns.append(column)
    return Motion(tuple(series), np.column_stack(columns), times, usual_units(series), name, int(origin))
