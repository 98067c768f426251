"""What the synthesizer publishes, and how it is written."""
import json

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_core.stream.stamp_policy import NANOSECONDS
from style_msgs.msg import StyleVector, SynthesisStatus
from style_node.templates import MessageTemplate

__all__ = ['Outputs', 'status_message', 'style_message', 'trajectory_message']

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def trajectory_message(joints, times, positions, velocities):
    """A JointTrajectory without stamp, of arrays (K,), (K, R), (K, R)."""
    return JointTrajectory(joint_names=list(joints), points=[
        JointTrajectoryPoint(positions=p.tolist(), velocities=v.tolist(), time_from_start=Duration(
            sec=int(t) // NANOSECONDS, nanosec=int(t) % NANOSECONDS))
        for t, p, v in zip(np.round(times * NANOSECONDS), positions, velocities)])


def style_message(source, v):
    """A StyleVector: coordinates, and the name where it is a named style."""
    name = next((name for name, own in source.styles.items() if np.allclose(own, v, atol=1e-9)), '') if len(v) else ''
    return StyleVector(name=name, labels=list(source.labels), values=[float(x) for x in v])


def status_message(standing, source, model, stamp):
    """A SynthesisStatus of a `Standing`."""
    message = SynthesisStatus(model=model, state=standing.state, message=standing.message, phase=standing.phase,
                              speed=float(standing.speed), elapsed=standing.elapsed,
                              remaining=float(standing.remaining))
    if source is not None:
        message.style = style_message(source, standing.style)
        message.target = style_message(source, standing.target)
    message.header.stamp = stamp
    return message


class Outputs:
    """The synthesizer's publishers, and the serialised window."""

    def __init__(self, node, joints, ahead):
        self._node = node
        create = node.create_lifecycle_publisher
        self._trajectory = create(JointTrajectory, 'joint_trajectory', 5)
        self._status = create(SynthesisStatus, '~/status', LATCHED)
        self._models = create(String, '~/models', LATCHED)
        self._styles = create(String, '~/styles', LATCHED)
        zero = np.zeros((len(ahead), len(joints)))
        self._window = MessageTemplate(trajectory_message(joints, ahead, zero, zero))
        self._last = 0

    def destroy(self):
        """Take the publishers down."""
        for publisher in (self._trajectory, self._status, self._models, self._styles):
            self._node.destroy_lifecycle_publisher(publisher)

    def window(self, now, positions, velocities):
        """Publish a window; stamps strictly increase, unless the clock is set back by more than a second."""
        self._last = now if now < self._last - NANOSECONDS else max(now, self._last + 1)
        self._trajectory.publish(self._window.write(
            {'points.positions': positions, 'points.velocities': velocities}, self._last))

    def status(self, message):
        """Publish a status."""
        self._status.publish(message)

    def describe(self, repertoire, models, source, joints):
        """Publish the latched lists of models, and of styles."""
        self._models.publish(String(data=json.dumps({
            'in_use': repertoire.name, 'kind': repertoire.kind, 'modes': list(repertoire.modes),
            'behaviours': list(repertoire.behaviours), 'robot_joints': list(joints),
            'models': [{'file': name, 'kind': kind} for name, kind in models]})))
        styles = {} if source is None else source.styles
        self._styles.publish(String(data=json.dumps({
            'model': repertoire.name, 'labels': [] if source is None else list(source.labels),
            'styles': {name: [round(float(x), 9) for x in v] for name, v in styles.items()}})))
