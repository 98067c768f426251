"""Serialised templates say exactly what a message built in the usual way says, on whatever middleware runs."""
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from style_core.predictor import Estimate, Status
from style_core.stream.joint_map import JointMap, JointRule, identity_map
from style_core.stream.loading import LiveModel
from style_core.stream.stream import Outlook, Step
from style_msgs.msg import MotionPrediction, StyleEstimate
from style_node.templates import MessageTemplate, stamps_of
from style_predictor.outputs import Writers

NAMES = ('hip', 'knee', 'Knöchel')
HORIZONS = np.array([0.1, 0.25, 1.75])
STAMP = 1_700_000_000_123_456_789


class Predictor:
    joint_names = NAMES


class Stream:
    def __init__(self, joint_map):
        self.robot_joints = joint_map.bind(NAMES).robot_joints


def writers(joint_map):
    live = LiveModel('walk', 'phase-style', 'full', Predictor(), {'walk': True, 'jump': False}, 60.0)
    return Writers(live, Stream(joint_map), HORIZONS)


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.parametrize('joint_map', [identity_map(), JointMap({'knee': JointRule('a_robot_knee')})])
def test_everything_written_is_read_back(joint_map):
    write = writers(joint_map)
    joints = joint_map.bind(NAMES).robot_joints
    rng = np.random.default_rng(1)
    for _ in range(3):  # later messages are not mixed with earlier ones
        mean, std, velocity = rng.standard_normal((3, 3, len(joints)))
        outlook = Outlook(STAMP, mean, std, velocity)
        trajectory = deserialize_message(write.trajectory(outlook), JointTrajectory)
        prediction = deserialize_message(write.prediction(outlook), MotionPrediction)
        for message in (trajectory, prediction.mean):
            assert tuple(message.joint_names) == joints and stamp_of(message) == STAMP
            np.testing.assert_array_equal([point.positions for point in message.points], mean)
            np.testing.assert_array_equal([point.velocities for point in message.points], velocity)
            assert all(len(point.accelerations) == len(point.effort) == 0 for point in message.points)
            assert [(p.time_from_start.sec, p.time_from_start.nanosec) for p in message.points] == [
                (0, 100_000_000), (0, 250_000_000), (1, 750_000_000)]
        np.testing.assert_array_equal(prediction.standard_deviation, std.ravel())
        again = MessageTemplate(prediction).read(
            write.prediction(outlook), 'mean.points.positions', 'standard_deviation')
        for found, wanted in zip(again, (mean, std)):
            np.testing.assert_array_equal(found.ravel(), wanted.ravel())
        assert stamps_of([write.trajectory(outlook)] * 2).tolist() == [STAMP] * 2
        ahead = deserialize_message(write.ahead(outlook), JointState)
        assert tuple(ahead.name) == joints and stamp_of(ahead) == STAMP
        np.testing.assert_array_equal([ahead.position, ahead.velocity], [mean[-1], velocity[-1]])
        assert prediction.model == 'walk' and stamp_of(prediction) == STAMP


@pytest.mark.parametrize('styles, behaviours', [(2, {'walk': 0.25, 'jump': 0.75}), (5, {'walk': 1.0}), (0, {})])
def test_estimates_of_any_size_are_read_back(styles, behaviours):
    write = writers(identity_map())
    rng = np.random.default_rng(2)
    estimate = Estimate(0.0, 1.25, -0.5, rng.standard_normal((2, 2)), rng.standard_normal(styles),
                        rng.standard_normal((styles, styles)), np.zeros(3), np.ones(3), np.array([True, False, True]),
                        float('nan'), -12.5, Status.LOST, behaviours)
    positions = rng.standard_normal(3)
    step = Step(STAMP, estimate, positions, np.ones(3), estimate.observed, ~estimate.observed)
    read = deserialize_message(write.estimate(step), StyleEstimate)
    assert stamp_of(read) == STAMP and read.status == StyleEstimate.LOST and read.model == 'walk'
    assert read.discrete == ('jump' in behaviours)
    assert (read.phase, read.phase_velocity, read.log_likelihood) == (1.25, -0.5, -12.5) and np.isnan(read.innovation)
    np.testing.assert_array_equal(read.phase_covariance, estimate.phase_covariance.ravel())
    np.testing.assert_array_equal(read.style, estimate.style)
    np.testing.assert_array_equal(read.style_covariance, estimate.style_covariance.ravel())
    assert dict(zip(read.behaviours, read.behaviour_probabilities)) == behaviours
    assert list(read.observed) == [True, False, True] and tuple(read.joint_names) == NAMES
    filled = deserialize_message(write.filled(step), JointState)
    np.testing.assert_array_equal(filled.position, positions)
    assert tuple(filled.name) == NAMES and len(filled.velocity) == 0


def test_messages_are_as_long_as_cdr_says_so_that_other_readers_take_them():
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    write = writers(identity_map())
    mean = np.arange(9.0).reshape(3, 3)
    written = write.trajectory(Outlook(STAMP, mean, mean, mean))
    read = store.deserialize_cdr(written, 'trajectory_msgs/msg/JointTrajectory')
    np.testing.assert_array_equal([point.positions for point in read.points], mean)


def test_as_many_numbers_as_the_field_has():
    template = MessageTemplate(JointState(name=['a', 'b'], position=[0.0, 0.0]))
    with pytest.raises(ValueError):
        template.write({'position': [1.0, 2.0, 3.0]})
    with pytest.raises(KeyError):
        template.write({'positions': [1.0, 2.0]})
