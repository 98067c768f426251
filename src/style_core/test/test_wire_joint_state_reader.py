"""Serialised joint states: as rosbags writes them, of either byte order, damaged, and from several publishers."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from style_core.errors import MotionError
from style_core.wire.joint_state_reader import JointStateReader

STORE = get_typestore(Stores.ROS2_HUMBLE)
KIND = 'sensor_msgs/msg/JointState'
STATE, HEADER, TIME = (STORE.types[name] for name in (KIND, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
NAME = st.text(st.characters(blacklist_categories=('Cs',), blacklist_characters='\0'), max_size=9)
NUMBERS = st.lists(st.floats(width=64), max_size=5)


def serialised(stamp, frame, names, positions, velocity=(), effort=(), little=True):
    header = HEADER(stamp=TIME(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)
    message = STATE(header=header, name=list(names),
                    **{field: np.array(values, dtype=float) for field, values in
                       (('position', positions), ('velocity', velocity), ('effort', effort))})
    return bytes(STORE.serialize_cdr(message, KIND, little_endian=little))


MESSAGE = st.builds(serialised, st.integers(0, 2**31 * 10**9 - 1), NAME, st.lists(NAME, max_size=5), NUMBERS, NUMBERS,
                    NUMBERS, st.booleans())


@given(messages=st.lists(MESSAGE, min_size=1, max_size=8))
@settings(deadline=None, max_examples=150)
def test_what_was_sent_is_read_whatever_came_before(messages):
    reader = JointStateReader()
    for data in messages:
        stamp, names, positions = reader.read(data)
        expected = STORE.deserialize_cdr(data, KIND)
        assert stamp == expected.header.stamp.sec * 10**9 + expected.header.stamp.nanosec
        assert list(names) == expected.name
        np.testing.assert_array_equal(positions, expected.position)


@given(data=MESSAGE, changes=st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=4),
       end=st.integers(0, 400))
@settings(deadline=None, max_examples=300)
def test_damage_is_an_error_or_another_message(data, changes, end):
    broken = bytearray(data)
    for place, value in changes:
        broken[place % len(broken)] = value
    reader = JointStateReader()
    reader.read(data)
    for trial in (bytes(broken), bytes(broken[:end])):
        try:
            stamp, names, positions = reader.read(trial)
        except MotionError:
            continue
        assert isinstance(stamp, int) and all(isinstance(name, str) for name in names) and positions.ndim == 1


def test_names_are_read_once_for_each_publisher():
    reader = JointStateReader()
    left, right = ([f'{side}_{joint}' for joint in ('hip', 'knee', 'ankle')] for side in ('left', 'right'))
    first = {}
    for k in range(1, 20):
        for names in (left, right):
            stamp, found, positions = reader.read(serialised(k, 'body', names, [k, 2.0 * k, np.nan]))
            assert stamp == k and found is first.setdefault(names[0], found) and list(found) == names
            np.testing.assert_array_equal(positions, [k, 2.0 * k, np.nan])
    for k in range(100):  # names that change all the time do not fill the memory
        reader.read(serialised(k, '', [f'joint_{k}'], [0.0]))
    assert len(reader.known) <= 16


def test_a_name_longer_by_the_padding_is_another_name():
    reader = JointStateReader()
    for names in (['ab'], ['abc'], ['a'], ['ab', ''], ['ab', 'c']):
        for frame in ('', 'x', 'xyz'):
            assert list(reader.read(serialised(1, frame, names, [1.0] * len(names)))[1]) == names


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', bytes(12), b'\0\7\0\0' + bytes(40), b'\0\1\0\0' + b'\xff' * 60])
def test_what_is_no_joint_state_is_refused(data):
    with pytest.raises(MotionError, match='damaged'):
        JointStateReader().read(data)
