"""What the predictor publishes, and how it is written."""
import array
import json

import numpy as np
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.live.stamp_policy import NANOSECONDS
from style_msgs.msg import MotionPrediction, StyleEstimate
from style_predictor.templates import MessageTemplate, set_stamp

__all__ = ['Outputs', 'Writers', 'diagnostics_message']

_STAMP = (set_stamp, np.int32, 2)


def _trajectory(joints, horizons):
    points = [JointTrajectoryPoint(time_from_start=Duration(
        sec=int(ahead_ns // NANOSECONDS), nanosec=int(ahead_ns % NANOSECONDS)))
        for ahead_ns in np.round(horizons * NANOSECONDS).astype(np.int64)]
    return JointTrajectory(joint_names=list(joints), points=points)


def _fill_points(attribute, width):
    def fill(trajectory, values):
        for point, row in zip(trajectory.points, values.reshape(-1, width)):
            setattr(point, attribute, array.array('d', row.tobytes()))
    return fill


def _on(member, setter):
    return lambda message, values: setter(getattr(message, member), values)


def _scalar(member, convert):
    return lambda message, values: setattr(message, member, convert(values[0]))


def _vector(member):
    return lambda message, values: setattr(message, member, array.array('d', values.tobytes()))


class Writers:
    """Serialised messages for one model, joint map and list of horizons.

    Parameters
    ----------
    live : LiveModel
    stream : PredictorStream
    horizons : ndarray, shape (H,)
        S.
    """

    def __init__(self, live, stream, horizons):
        self.live = live
        joints, count = stream.robot_joints, len(stream.robot_joints)
        points = len(horizons) * count
        self._trajectory = MessageTemplate(_trajectory(joints, horizons), {
            'stamp': _STAMP,
            'positions': (_fill_points('positions', count), np.float64, points),
            'velocities': (_fill_points('velocities', count), np.float64, points)})
        self._prediction = MessageTemplate(MotionPrediction(model=live.name, mean=_trajectory(joints, horizons)), {
            'stamp': _STAMP, 'mean_stamp': (_on('mean', set_stamp), np.int32, 2),
            'positions': (_on('mean', _fill_points('positions', count)), np.float64, points),
            'velocities': (_on('mean', _fill_points('velocities', count)), np.float64, points),
            'std': (_vector('standard_deviation'), np.float64, points)})
        self._filled = MessageTemplate(JointState(name=list(joints)), {
            'stamp': _STAMP, 'positions': (_vector('position'), np.float64, count)})
        self._model_joints = tuple(live.predictor.joint_names)
        self._estimates = {}

    def filled(self, step):
        """Serialised JointState of a step."""
        return self._filled.write(stamp=_split(step.stamp), positions=step.positions)

    def trajectory(self, outlook):
        """Serialised JointTrajectory of a prediction."""
        return self._trajectory.write(stamp=_split(outlook.stamp), positions=outlook.mean, velocities=outlook.velocity)

    def prediction(self, outlook):
        """Serialised MotionPrediction of a prediction."""
        stamp = _split(outlook.stamp)
        return self._prediction.write(stamp=stamp, mean_stamp=stamp, positions=outlook.mean,
                                      velocities=outlook.velocity, std=outlook.std)

    def estimate(self, step):
        """Serialised StyleEstimate of a step."""
        estimate = step.estimate
        key = len(estimate.style), tuple(estimate.behaviours)
        template = self._estimates.get(key)
        if template is None:
            template = self._estimates[key] = self._estimate_template(*key)
        return template.write(
            stamp=_split(step.stamp), status=int(estimate.status), discrete=self.live.is_discrete(estimate),
            phase=estimate.phase, phase_velocity=estimate.phase_velocity, phase_covariance=estimate.phase_covariance,
            style=estimate.style, style_covariance=estimate.style_covariance,
            probabilities=list(estimate.behaviours.values()), observed=estimate.observed,
            innovation=estimate.innovation, log_likelihood=estimate.log_likelihood)

    def _estimate_template(self, styles, behaviours):
        return MessageTemplate(
            StyleEstimate(model=self.live.name, behaviours=list(behaviours), joint_names=list(self._model_joints)), {
                'stamp': _STAMP, 'status': (_scalar('status', int), np.uint8, 1),
                'discrete': (_scalar('discrete', bool), bool, 1),
                'phase': (_scalar('phase', float), np.float64, 1),
                'phase_velocity': (_scalar('phase_velocity', float), np.float64, 1),
                'phase_covariance': (lambda m, v: setattr(m, 'phase_covariance', v), np.float64, 4),
                'style': (_vector('style'), np.float64, styles),
                'style_covariance': (_vector('style_covariance'), np.float64, styles**2),
                'probabilities': (_vector('behaviour_probabilities'), np.float64, len(behaviours)),
                'observed': (lambda m, v: setattr(m, 'observed', v.tolist()), bool, len(self._model_joints)),
                'innovation': (_scalar('innovation', float), np.float64, 1),
                'log_likelihood': (_scalar('log_likelihood', float), np.float64, 1)})


def _split(stamp):
    return divmod(stamp, NANOSECONDS)


class Outputs:
    """The predictor's publishers."""

    def __init__(self, node):
        self._node = node
        create = node.create_lifecycle_publisher
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._trajectory = create(JointTrajectory, '~/trajectory', 5)
        self._prediction = create(MotionPrediction, '~/prediction', 5)
        self._estimate = create(StyleEstimate, '~/estimate', 5)
        self._filled = create(JointState, '~/filled', 5)
        self._model = create(String, '~/model', latched)

    def destroy(self):
        """Take the publishers down."""
        for publisher in (self._trajectory, self._prediction, self._estimate, self._filled, self._model):
            self._node.destroy_lifecycle_publisher(publisher)

    def publish(self, writers, step, outlook):
        """Publish one step, and its prediction where there is one."""
        if outlook is not None:
            self._trajectory.publish(writers.trajectory(outlook))
            self._prediction.publish(writers.prediction(outlook))
        self._estimate.publish(writers.estimate(step))
        self._filled.publish(writers.filled(step))

    def describe(self, live, stream, horizons):
        """Publish the latched description of the model in use."""
        self._model.publish(String(data=json.dumps({
            'model': live.name, 'kind': live.kind, 'method': live.method, 'training_rate_hz': live.rate_hz,
            'behaviours': {name: 'rhythmic' if rhythmic else 'discrete' for name, rhythmic in live.rhythmic.items()},
            'model_joints': list(live.predictor.joint_names), 'robot_joints': list(stream.robot_joints),
            'horizons_s': [round(float(ahead), 9) for ahead in horizons]})))


def diagnostics_message(stamp, name, health, hardware=''):
    """DiagnosticArray with one status."""
    status = DiagnosticStatus(level=bytes([health.level]), name=name, message=health.summary, hardware_id=hardware,
                              values=[KeyValue(key=key, value=value) for key, value in health.facts.items()])
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
