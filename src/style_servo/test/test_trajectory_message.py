"""Trajectories as bytes: what the middleware's own reader finds in them, and an error for everything else."""
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy import serialization
from trajectory_msgs import msg as messages

from style_core.errors import MotionError
from style_servo.trajectory_message import TrajectoryReader


def message(rng, n, k, velocities=True, accelerations=False, effort=0, frame=''):
    result = messages.JointTrajectory(joint_names=[f'joint{"x" * int(rng.integers(4))}_{i}' for i in range(n)])
    result.header.frame_id = frame
    result.header.stamp.sec, result.header.stamp.nanosec = int(rng.integers(2**31)), int(rng.integers(10**9))
    for _ in range(k):
        point = messages.JointTrajectoryPoint(
            positions=rng.normal(size=n).tolist(), velocities=rng.normal(size=n * velocities).tolist(),
            accelerations=rng.normal(size=n * accelerations).tolist(), effort=rng.normal(size=effort).tolist())
        point.time_from_start.sec, point.time_from_start.nanosec = int(rng.integers(9)), int(rng.integers(10**9))
        result.points.append(point)
    return result


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 7), k=st.integers(1, 5), velocities=st.booleans(),
       accelerations=st.booleans(), effort=st.integers(0, 3), frame=st.text('ab', max_size=5))
@settings(max_examples=150, deadline=None)
def test_it_reads_what_the_middleware_reads(seed, n, k, velocities, accelerations, effort, frame):
    sent = message(np.random.default_rng(seed), n, k, velocities, accelerations, effort, frame)
    stamp, points = TrajectoryReader().read(serialization.serialize_message(sent))
    assert stamp == sent.header.stamp.sec * 10**9 + sent.header.stamp.nanosec
    assert points.joint_names == tuple(sent.joint_names)
    np.testing.assert_array_equal(points.times, [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec
                                                 for p in sent.points])
    for field, wanted in (('positions', True), ('velocities', velocities), ('accelerations', accelerations)):
        found = getattr(points, field)
        if wanted:
            np.testing.assert_array_equal(found, [getattr(p, field) for p in sent.points])
        else:
            assert found is None


def test_one_reader_hears_several_senders():
    rng, reader = np.random.default_rng(0), TrajectoryReader()
    sent = [message(rng, n, 3) for n in (2, 5, 2, 3)]
    for one in sent * 3:
        assert reader.read(serialization.serialize_message(one))[1].joint_names == tuple(one.joint_names)


@given(seed=st.integers(0, 2**32 - 1), cut=st.floats(0, 1), spoil=st.integers(0, 6))
@settings(max_examples=300, deadline=None)
def test_damaged_bytes_are_refused_or_read_never_a_crash(seed, cut, spoil):
    rng = np.random.default_rng(seed)
    data = bytearray(serialization.serialize_message(message(rng, 3, 4)))
    for _ in range(spoil):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    reader = TrajectoryReader()
    try:
        _, points = reader.read(bytes(data[:round(cut * len(data))]))
    except MotionError:
        return
    assert points.positions.shape == (len(points.times), len(points.joint_names))


def test_lengths_that_differ_between_points_are_refused():
    for k in range(4):
        one = message(np.random.default_rng(k), 3, 4)
        one.points[k].velocities = [1.0]
        # (how many bytes follow the last point is up to the middleware)
        with pytest.raises(MotionError, match=r'different numbers|velocities|cut off'):
            TrajectoryReader().read(serialization.serialize_message(one))
    with pytest.raises(MotionError, match='no points'):
        TrajectoryReader().read(serialization.serialize_message(message(np.random.default_rng(0), 2, 0)))
    with pytest.raises(MotionError, match='at most 2'):
        TrajectoryReader(2).read(serialization.serialize_message(message(np.random.default_rng(0), 2, 3)))
    with pytest.raises(MotionError, match='0 joints'):
        TrajectoryReader().read(serialization.serialize_message(message(np.random.default_rng(0), 0, 3)))


def big_endian(sent):
    """A message as a big-endian machine would send it."""
    out = bytearray(4)

    def put(kind, *values):
        size = struct.calcsize(kind)
        out.extend(bytes((4 - len(out)) % size))
        out.extend(struct.pack(f'>{len(values)}{kind}', *values))

    def text(one):
        put('I', len(one) + 1)
        out.extend(one.encode() + b'\0')
    put('i', sent.header.stamp.sec)
    put('I', sent.header.stamp.nanosec)
    text(sent.header.frame_id)
    put('I', len(sent.joint_names))
    for name in sent.joint_names:
        text(name)
    put('I', len(sent.points))
    for point in sent.points:
        for field in ('positions', 'velocities', 'accelerations', 'effort'):
            values = getattr(point, field)
            put('I', len(values))
            if len(values):
                put('d', *values)
        put('i', point.time_from_start.sec)
        put('I', point.time_from_start.nanosec)
    return bytes(out)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 7), k=st.integers(1, 5), velocities=st.booleans())
@settings(max_examples=50, deadline=None)
def test_byte_order_makes_no_difference(seed, n, k, velocities):
    sent = message(np.random.default_rng(seed), n, k, velocities, True)
    here, there = (TrajectoryReader().read(data) for data in (serialization.serialize_message(sent), big_endian(sent)))
    assert here[0] == there[0] and here[1].joint_names == there[1].joint_names
    for field in ('times', 'positions', 'velocities', 'accelerations'):
        one, other = getattr(here[1], field), getattr(there[1], field)
        assert one is other is None or np.array_equal(one, other)
