"""What the predictor publishes, and how it is written."""
import json

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.stream.stamp_policy import NANOSECONDS
from style_msgs.msg import MotionPrediction, StyleEstimate
from style_node.templates import MessageTemplate

__all__ = ['Outputs', 'Writers']

_FROM_PREDICTION = {'trajectory', 'prediction', 'ahead'}


def _trajectory(joints, horizons):
    """A trajectory with room for positions and velocities."""
    return JointTrajectory(joint_names=list(joints), points=[
        JointTrajectoryPoint(positions=[0.0] * len(joints), velocities=[0.0] * len(joints),
                             time_from_start=Duration(sec=int(ahead) // NANOSECONDS, nanosec=int(ahead) % NANOSECONDS))
        for ahead in np.round(horizons * NANOSECONDS)])


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
        self._trajectory = MessageTemplate(_trajectory(joints, horizons))
        self._prediction = MessageTemplate(MotionPrediction(
            model=live.name, mean=_trajectory(joints, horizons), standard_deviation=[0.0] * len(horizons) * count))
        self._filled = MessageTemplate(JointState(name=list(joints), position=[0.0] * count))
        self._ahead = MessageTemplate(JointState(name=list(joints), position=[0.0] * count, velocity=[0.0] * count))
        self._estimates = {}

    def filled(self, step):
        """Serialised JointState of a step."""
        return self._filled.write({'position': step.positions}, step.stamp)

    def trajectory(self, outlook):
        """Serialised JointTrajectory of a prediction."""
        return self._trajectory.write({'points.positions': outlook.mean, 'points.velocities': outlook.velocity},
                                      outlook.stamp)

    def prediction(self, outlook):
        """Serialised MotionPrediction of a prediction."""
        return self._prediction.write({
            'mean.header.stamp.sec': outlook.stamp // NANOSECONDS,
            'mean.header.stamp.nanosec': outlook.stamp % NANOSECONDS, 'mean.points.positions': outlook.mean,
            'mean.points.velocities': outlook.velocity, 'standard_deviation': outlook.std}, outlook.stamp)

    def ahead(self, outlook):
        """Serialised JointState of the farthest pose of a prediction."""
        return self._ahead.write({'position': outlook.mean[-1], 'velocity': outlook.velocity[-1]}, outlook.stamp)

    def estimate(self, step):
        """Serialised StyleEstimate of a step."""
        estimate = step.estimate
        key = len(estimate.style), tuple(estimate.behaviours)
        if key not in self._estimates:
            self._estimates[key] = self._estimate_template(*key)
        return self._estimates[key].write({
            'status': estimate.status, 'discrete': self.live.is_discrete(estimate),
            'phase': estimate.phase, 'phase_velocity': estimate.phase_velocity,
            'phase_covariance': estimate.phase_covariance, 'style': estimate.style,
            'style_covariance': estimate.style_covariance,
            'behaviour_probabilities': list(estimate.behaviours.values()), 'observed': estimate.observed,
            'innovation': estimate.innovation, 'log_likelihood': estimate.log_likelihood}, step.stamp)

    def _estimate_template(self, styles, behaviours):
        joints = list(self.live.predictor.joint_names)
        return MessageTemplate(StyleEstimate(
            model=self.live.name, style=[0.0] * styles, style_covariance=[0.0] * styles**2,
            behaviours=list(behaviours), behaviour_probabilities=[0.0] * len(behaviours), joint_names=joints,
            observed=[False] * len(joints)))


class Outputs:
    """The predictor's publishers."""

    def __init__(self, node):
        self._node = node
        create = node.create_lifecycle_publisher
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._topics = {
            name: create(kind, f'~/{name}', 5) for name, kind in (
                ('trajectory', JointTrajectory), ('prediction', MotionPrediction), ('estimate', StyleEstimate),
                ('filled', JointState), ('ahead', JointState))}
        self._model = create(String, '~/model', latched)
        self._ahead_heard = False

    def destroy(self):
        """Take the publishers down."""
        for publisher in (*self._topics.values(), self._model):
            self._node.destroy_lifecycle_publisher(publisher)

    def publish(self, writers, step, predict):
        """Publish one step and what is ahead of it, the trajectory first; what nobody listens to is not made.

        Parameters
        ----------
        writers : Writers
        step : Step
        predict : callable
            Returns the Outlook, or None.

        Returns
        -------
        Outlook or None
            What was predicted.
        """
        # asked anew beforehand only where nobody listened: then nobody is kept waiting
        ahead = self._ahead_heard or _FROM_PREDICTION & self._heard()
        outlook = predict() if ahead else None
        if outlook is not None:
            self._topics['trajectory'].publish(writers.trajectory(outlook))
        heard = self._heard()
        self._ahead_heard = bool(_FROM_PREDICTION & heard)
        for name in heard - {'trajectory'}:
            source = outlook if name in _FROM_PREDICTION else step
            if source is not None:
                self._topics[name].publish(getattr(writers, name)(source))
        return outlook

    def _heard(self):
        """Names of the topics that have listeners."""
        return {name for name, publisher in self._topics.items() if publisher.get_subscription_count()}

    def describe(self, live, stream, horizons):
        """Publish the latched description of the model in use."""
        self._model.publish(String(data=json.dumps({
            'model': live.name, 'kind': live.kind, 'method': live.method, 'training_rate_hz': live.rate_hz,
            'behaviours': {name: 'rhythmic' if rhythmic else 'discrete' for name, rhythmic in live.rhythmic.items()},
            'model_joints': list(live.predictor.joint_names), 'robot_joints': list(stream.robot_joints),
            'horizons_s': [round(float(ahead), 9) for ahead in horizons]})))
