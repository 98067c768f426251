"""Bags of joint states, with what real bags do: several publishers, silence, disorder, damage."""
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from style_core.errors import MotionError
from style_core.formats import bag, read_motion, write_motion

STORE = get_typestore(Stores.ROS2_HUMBLE)
STATE, HEADER, TIME = (STORE.types[name] for name in
                       (bag.JOINT_STATE, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
EPOCH = 1_700_000_000 * 10**9


def record(path, messages, storage=StoragePlugin.SQLITE3):
    """Messages of (topic, stamp ns, names, positions); recorded at their stamps, in their order."""
    with Writer(path, version=8, storage_plugin=storage) as writer:
        connections = {}
        for number, (topic, stamp, names, positions) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, bag.JOINT_STATE, typestore=STORE)
            message = STATE(header=HEADER(stamp=TIME(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=''),
                            name=list(names), position=np.array(positions, dtype=float), velocity=np.empty(0),
                            effort=np.empty(0))
            writer.write(connections[topic], EPOCH + number * 10**6, STORE.serialize_cdr(message, bag.JOINT_STATE))
    return path


def state(k, names, positions, topic='/joint_states', step_ns=10**7):
    return topic, EPOCH + int(k * step_ns), names, positions


@pytest.mark.parametrize('name, storage', [('walk', 'sqlite3'), ('walk', 'mcap'), ('walk.mcap', None)])
def test_a_motion_comes_back_from_a_bag(tmp_path, gait, name, storage):
    values = gait.positions.copy()
    values[3, 2] = np.nan
    motion = gait.replace(positions=values, epoch_ns=EPOCH)
    write_motion(motion, tmp_path / name, storage=storage, topic='/legs')
    again = read_motion(tmp_path / name)
    assert again.joint_names == motion.joint_names and again.epoch_ns == EPOCH and again.rate_hz == 100
    np.testing.assert_array_equal(again.positions, motion.positions)
    np.testing.assert_allclose(again.times, motion.times, atol=1e-9)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert bag.topics(tmp_path / name) == {'/legs': motion.n_frames}
    part = read_motion(tmp_path / name, start_s=1.0, stop_s=2.0)
    np.testing.assert_allclose(part.times, np.arange(100, 200) / 100, atol=1e-9)
    np.testing.assert_array_equal(part.positions, motion.positions[100:200])


def recorded(gait):
    values = gait.positions[:50].copy()
    values[3, 2] = np.nan
    motion = gait.slice(0, 0.5).replace(positions=values, epoch_ns=EPOCH)
    return motion, (EPOCH + np.round(motion.times * 1e9).astype(np.int64)).tolist()


def test_mcap_is_read_by_a_program_that_shares_no_code_with_us(tmp_path, gait):
    """Foxglove's reader, which decodes by the definitions in the file."""
    read_ros2_messages = pytest.importorskip('mcap_ros2.reader').read_ros2_messages
    motion, stamps = recorded(gait)
    write_motion(motion, tmp_path / 'walk.mcap')
    messages = list(read_ros2_messages(str(tmp_path / 'walk.mcap')))
    assert [(m.channel.topic, m.schema.name, m.log_time_ns) for m in messages] == [
        ('/joint_states', bag.JOINT_STATE, stamp) for stamp in stamps]
    decoded = [m.ros_msg for m in messages]
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in decoded] == stamps
    assert all(tuple(m.name) == motion.joint_names and not m.velocity and not m.effort for m in decoded)
    np.testing.assert_array_equal([m.position for m in decoded], motion.positions)


def test_sqlite_answers_what_rosbag2_asks_for(tmp_path, gait):
    """The columns that Humble's rosbag2 selects, and messages decoded by the rules of CDR alone."""
    motion, stamps = recorded(gait)
    write_motion(motion, tmp_path / 'walk')
    database = sqlite3.connect(tmp_path / 'walk' / 'walk.db3')
    (topic,) = database.execute('SELECT id, name, type, serialization_format, offered_qos_profiles FROM topics')
    assert topic[1:] == ('/joint_states', bag.JOINT_STATE, 'cdr', '')
    rows = list(database.execute('SELECT data, timestamp FROM messages JOIN topics ON messages.topic_id = topics.id '
                                 "WHERE topics.name = '/joint_states' ORDER BY timestamp"))
    database.close()
    assert [row[1] for row in rows] == stamps
    for (data, stamp), expected in zip(rows, motion.positions):
        assert joint_state_by_hand(data) == (stamp, '', list(motion.joint_names), pytest.approx(expected, nan_ok=True),
                                             [], [])


def joint_state_by_hand(data):
    """Fields of a little-endian CDR JointState, by `struct` alone."""
    assert data[:4] == bytes((0, 1, 0, 0))
    body, at = data[4:], 0

    def take(code, count=1):
        nonlocal at
        size = struct.calcsize(code)
        at += -at % size if count else 0
        found = struct.unpack_from(f'<{count}{code}', body, at)
        at += count * size
        return list(found)

    def text():
        (length,) = take('I')
        return bytes(take('B', length)).decode()[:-1]
    seconds, nanoseconds = take('i') + take('I')
    frame = text()
    names = [text() for _ in range(take('I')[0])]
    return (seconds * 10**9 + nanoseconds, frame, names, *(take('d', take('I')[0]) for _ in range(3)))


def test_a_silent_joint_is_missing_and_publishers_with_their_own_stamps_are_interpolated(tmp_path):
    messages = []
    for k in range(50):
        messages.append(state(k, ('a', 'b') if k % 10 else ('a',), [k, -k] if k % 10 else [k]))
        if 5 < k < 40:
            messages.append(state(k + 0.5, ('c',), [2 * k]))
    motion = read_motion(record(tmp_path / 'bag', messages))
    assert motion.joint_names == ('a', 'b', 'c') and motion.n_frames == 50
    np.testing.assert_array_equal(motion.positions[:, 0], np.arange(50))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(motion.positions[:, 1])), np.arange(0, 50, 10))
    heard = np.isfinite(motion.positions[:, 2])
    np.testing.assert_array_equal(np.flatnonzero(heard), np.arange(7, 40))
    np.testing.assert_allclose(motion.positions[heard, 2], 2 * np.arange(7, 40) - 1, atol=1e-6)


def test_names_in_another_order_late_messages_and_repeated_stamps(tmp_path):
    messages = [state(k, *((('a', 'b'), [k, 10 * k]) if k % 2 else (('b', 'a'), [10 * k, k])))
                for k in (0, 1, 3, 2, 4)]
    messages.append(state(4, ('a', 'b'), [44, 440]))
    motion = read_motion(record(tmp_path / 'bag', messages)).joints(['a', 'b'])
    np.testing.assert_array_equal(motion.positions[:, 1], 10 * motion.positions[:, 0])
    np.testing.assert_array_equal(motion.positions[:4, 0], np.arange(4))


def test_messages_that_cannot_be_used_are_counted(tmp_path):
    messages = [state(0, ('a', 'b'), [1, 2]), state(1, ('a', 'b'), [1]), state(2, (), []), state(3, ('a', 'a'), [1, 2]),
                state(4, ('a', 'b'), [np.inf, 4])]
    with pytest.warns(UserWarning) as said:
        motion = read_motion(record(tmp_path / 'bag', messages))
    assert sorted(str(warning.message).split(': ')[1][0] for warning in said) == ['1', '3']
    np.testing.assert_array_equal(motion.positions, [[1, 2], [np.nan, 4]])


def test_a_clock_that_is_set_back_is_said(tmp_path):
    messages = [state(k % 100, ('a',), [k]) for k in range(200)]
    with pytest.raises(MotionError, match=r'set back by 0\.99'):
        read_motion(record(tmp_path / 'bag', messages))


def test_zero_stamps_count_from_the_time_of_recording(tmp_path):
    path = record(tmp_path / 'bag', [('/joint_states', 0, ('a',), [k]) for k in range(5)])
    with pytest.warns(UserWarning, match='5 messages without a stamp'):
        motion = read_motion(path)
    np.testing.assert_allclose(motion.times, np.arange(5) / 1000, atol=1e-9)


def test_the_topic_is_asked_for_where_there_are_several(tmp_path):
    path = record(tmp_path / 'bag', [state(0, ('a',), [1], '/left'), state(0, ('b',), [2], '/right')])
    with pytest.raises(MotionError, match='/left, /right'):
        read_motion(path)
    assert read_motion(path, topic='/right').joint_names == ('b',)
    with pytest.raises(MotionError, match='no joint states on /up'):
        read_motion(path, topic='/up')
    with pytest.raises(MotionError, match='range'):
        read_motion(path, topic='/left', start_s=5.0)


def test_only_a_bag_is_replaced(tmp_path, gait):
    write_motion(gait, tmp_path / 'bag')
    write_motion(gait.slice(0, 1.0), tmp_path / 'bag', storage='mcap')
    assert read_motion(tmp_path / 'bag').n_frames == 100
    (tmp_path / 'precious').mkdir()
    (tmp_path / 'precious' / 'thesis.txt').write_text('words')
    (tmp_path / 'precious' / 'metadata.yaml').write_text('')
    for path, words in ((tmp_path / 'precious', 'no bag'), (tmp_path / 'x.db3', 'part'),
                        (tmp_path / 'no' / 'bag', 'folder')):
        with pytest.raises(MotionError, match=words):
            write_motion(gait, path)
    with pytest.raises(MotionError, match='negative'):
        write_motion(gait.replace(times=gait.times - 5), tmp_path / 'bag')
    assert (tmp_path / 'precious' / 'thesis.txt').read_text() == 'words'
    assert read_motion(tmp_path / 'bag').n_frames == 100


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_damaged_bag_is_an_error_and_nothing_else(tmp_path, gait, storage):
    write_motion(gait.slice(0, 0.3), tmp_path / 'bag', storage=storage)
    data = next(path for path in Path(tmp_path / 'bag').iterdir() if path.suffix in ('.db3', '.mcap'))
    for path in (data, tmp_path / 'bag' / 'metadata.yaml'):
        whole = path.read_bytes()
        rng = np.random.default_rng(0)
        for trial in range(40):
            broken = bytearray(whole[:rng.integers(len(whole))] if trial % 2 else whole)
            for place in rng.integers(0, max(len(broken), 1), 8) if broken else ():
                broken[place] = rng.integers(256)
            path.write_bytes(bytes(broken))
            try:
                motion = read_motion(tmp_path / 'bag')
            except MotionError:
                continue
            assert motion.positions.shape == (motion.n_frames, motion.n_joints)
        path.write_bytes(whole)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    with pytest.raises(MotionError, match=r'metadata\.yaml'):
        read_motion(tmp_path / 'bag')
