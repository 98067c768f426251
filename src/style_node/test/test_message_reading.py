"""The checked reader against rclpy's own conversion, the judge of valid messages; and damage, which costs nothing."""
import contextlib
import random
import tracemalloc

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.errors import MotionError
from style_core.wire.joint_state_reader import JointStateReader
from style_msgs.msg import BridgeState, MotionPrediction, StateSequence, StyleEstimate, StyleVector, SynthesisStatus
from style_node.message_reading import reader_of

RANDOM = random.Random(22)
NAMES = ['hip', 'knee', 'ankle', '', 'Hüfte', 'x' * 200]


def names(most=6):
    return [RANDOM.choice(NAMES) for _ in range(RANDOM.randrange(most))]


def numbers(most=6):
    return [RANDOM.choice([0.0, -1.5, 1e300, float('nan'), float('inf'), RANDOM.random()])
            for _ in range(RANDOM.randrange(most))]


def stamped(message):
    message.header.stamp.sec = RANDOM.randrange(-2**31, 2**31)
    message.header.stamp.nanosec = RANDOM.randrange(2**32)
    message.header.frame_id = RANDOM.choice(NAMES)
    return message


def trajectory():
    return stamped(JointTrajectory(joint_names=names(), points=[
        JointTrajectoryPoint(positions=numbers(), velocities=numbers(), effort=numbers())
        for _ in range(RANDOM.randrange(4))]))


MADE = {
    StyleEstimate: lambda: stamped(StyleEstimate(
        model=RANDOM.choice(NAMES), status=RANDOM.randrange(256), discrete=RANDOM.random() < 0.5, phase=RANDOM.random(),
        phase_velocity=1e308, phase_covariance=[RANDOM.random() for _ in range(4)], style=numbers(),
        style_covariance=numbers(), behaviours=names(), behaviour_probabilities=numbers(), joint_names=names(),
        observed=[RANDOM.random() < 0.5 for _ in range(RANDOM.randrange(9))], innovation=RANDOM.random())),
    StyleVector: lambda: StyleVector(name=RANDOM.choice(NAMES), labels=names(), values=numbers()),
    StateSequence: lambda: StateSequence(name=RANDOM.choice(NAMES), states=[RANDOM.randrange(2**32) for _ in range(3)],
                                         dwell_times=numbers(), n_states=RANDOM.randrange(9), step=RANDOM.random(),
                                         occupancy=numbers(20)),
    SynthesisStatus: lambda: stamped(SynthesisStatus(model='m', style=StyleVector(labels=names(), values=numbers()))),
    MotionPrediction: lambda: stamped(MotionPrediction(model='m', mean=trajectory(), standard_deviation=numbers())),
    BridgeState: lambda: stamped(BridgeState(joint_names=names(), commanded=numbers(), limited=[True, False],
                                             cycles=RANDOM.randrange(2**64))),
    JointState: lambda: stamped(JointState(name=names(), position=numbers(), velocity=numbers(), effort=numbers())),
    JointTrajectory: trajectory,
    DiagnosticArray: lambda: stamped(DiagnosticArray(status=[DiagnosticStatus(
        level=b'\x02', name='n', values=[KeyValue(key=key, value='v') for key in names()])])),
    PoseWithCovarianceStamped: lambda: stamped(PoseWithCovarianceStamped()),
    ParameterDescriptor: lambda: ParameterDescriptor(name='n', type=RANDOM.randrange(256), read_only=True),
    ParameterEvent: lambda: ParameterEvent(node=RANDOM.choice(NAMES)),
}


def same(read, judge):
    """Whether what was read says what rclpy's message says."""
    for name in judge.get_fields_and_field_types():
        mine, theirs = getattr(read, name), getattr(judge, name)
        if hasattr(theirs, 'get_fields_and_field_types'):
            assert same(mine, theirs)
        elif isinstance(theirs, bytes):
            assert mine == theirs[0]
        elif isinstance(theirs, list) and theirs and hasattr(theirs[0], 'get_fields_and_field_types'):
            assert len(mine) == len(theirs) and all(map(same, mine, theirs))
        elif isinstance(theirs, (str, list)) and not isinstance(mine, np.ndarray):
            assert list(mine) == list(theirs)
        else:
            np.testing.assert_array_equal(np.asarray(mine), np.asarray(theirs))
    return True


@pytest.mark.parametrize('kind', MADE, ids=lambda kind: kind.__name__)
def test_what_rclpy_reads_is_read_the_same(kind):
    reader = reader_of(kind, 'message')
    for _ in range(100):
        data = serialize_message(MADE[kind]())
        assert same(reader.read(data), deserialize_message(data, kind))


def exact(store, data, name):
    """Rosbags' message; it takes no more than three bytes behind, and some middleware leaves more."""
    for end in range(len(data), 0, -1):
        with contextlib.suppress(SerdeError):
            return store.deserialize_cdr(data[:end], name)
    raise AssertionError(name)


@pytest.mark.parametrize('kind', [StyleEstimate, StateSequence, JointState], ids=lambda kind: kind.__name__)
def test_the_other_byte_order_is_read_the_same(kind):
    """Rosbags is the judge: it writes both orders."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
    if name not in store.types:
        from ament_index_python.packages import get_package_share_directory
        folder = get_package_share_directory('style_msgs')
        with open(f'{folder}/msg/{kind.__name__}.msg') as text:
            store.register(get_types_from_msg(text.read(), name))
    reader = reader_of(kind, 'message')
    for _ in range(50):
        data = serialize_message(MADE[kind]())
        big = bytes(store.serialize_cdr(exact(store, data, name), name, little_endian=False))
        assert big[1] == 0 and same(reader.read(big), deserialize_message(data, kind))


def test_what_is_not_wanted_is_checked_and_left_out():
    reader = reader_of(StyleEstimate, 'estimate', ('phase', 'style'))
    data = serialize_message(MADE[StyleEstimate]())
    assert set(vars(reader.read(data))) == {'phase', 'style'}
    with pytest.raises(MotionError, match='cut off'):
        reader.read(data[:-12])


def damaged(data):
    """Every kind of damage to a message, by turns."""
    yield from (data[:end] for end in range(len(data)))
    for place in range(len(data)):
        for value in (0, 1, 127, 255, RANDOM.randrange(256)):
            yield data[:place] + bytes([value]) + data[place + 1:]
    for place in range(4, len(data) - 3, 4):
        for length in (2**32 - 1, 2**31 - 1, 2**31, 10**6, len(data)):
            yield data[:place] + length.to_bytes(4, 'little') + data[place + 4:]
    for _ in range(500):
        broken = bytearray(data)
        for _ in range(RANDOM.randrange(1, 9)):
            broken[RANDOM.randrange(len(broken))] = RANDOM.randrange(256)
        yield bytes(broken)


@pytest.mark.parametrize('kind', MADE, ids=lambda kind: kind.__name__)
def test_damage_is_an_error_or_another_message_and_costs_no_memory(kind):
    reader, count = reader_of(kind, 'message'), 0
    own = JointStateReader() if kind is JointState else None
    tracemalloc.start()
    try:
        for data in damaged(serialize_message(MADE[kind]())):
            count += 1
            for one in (reader, own) if own else (reader,):
                try:
                    one.read(data)
                except MotionError as error:
                    assert len(str(error)) < 200
        assert count > 500 and tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


def test_a_message_that_is_too_large_is_refused_unread():
    data = serialize_message(StateSequence(occupancy=[0.5] * 200_000))
    with pytest.raises(MotionError, match='refused unread'):
        reader_of(StateSequence, 'sequence').read(data)
