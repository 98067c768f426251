"""Publish any motion file as joint states, with the faults of real sensors where wanted."""
import array
import sys

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState

from style_core.errors import UsageError
from style_core.places import find_file
from style_core.recordings import read_recording
from style_core.skeleton import read_skeleton
from style_core.stream.joint_map import identity_map, read_joint_map
from style_core.stream.stamp_policy import NANOSECONDS
from style_core.synthesis.player import loop_cut, play
from style_node.executor import run
from style_node.ros_parameters import declare, values_of, watch
from style_predictor.parameters import PLAYER, faults_of

__all__ = ['PlayerNode', 'main']


class PlayerNode(Node):
    """Publishes ``joint_states`` as recorded and faulted, and ``~/truth`` without the faults."""

    def __init__(self, **options):
        super().__init__('motion_player', **options)
        declare(self, PLAYER)
        watch(self, PLAYER, lambda: True, lambda values: None)
        values = values_of(self, PLAYER)
        motion = _motion_of(values, self.get_logger())
        name = values['joint_map']
        joint_map = read_joint_map(find_file(name, 'joint map')) if name else identity_map()
        bound = joint_map.bind(motion.joint_names)
        motion = motion.replace(joint_names=bound.robot_joints, positions=bound.to_robot(motion.positions), units=None)
        self._names = list(bound.robot_joints)
        self._epoch = motion.epoch_ns
        self._mode = values['stamps']
        self._samples = play(motion, faults_of(values), values['loop'] != 'no', values['speed'], self._mode)
        qos = QoSProfile(depth=64)
        self._output = self.create_publisher(JointState, 'joint_states', qos)
        self._truth = self.create_publisher(JointState, '~/truth', qos)
        self.done = Future()
        self._exit_at_end = values['exit_at_end']
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._delay = round(values['delay'] * NANOSECONDS)
        self._pending = next(self._samples)
        self._wanted = values['await_subscribers']
        self._timer = self.create_timer(0.02, self._begin, clock=self._steady)
        self.get_logger().info(f'playing {motion.name or values["file"]}: {motion.n_frames} frames, '
                               f'{len(self._names)} joints, {motion.rate_hz:g} Hz, loop: {values["loop"]}')

    def _begin(self):
        """Wait for listeners, then take the time."""
        if self._output.get_subscription_count() < self._wanted:
            return
        self._timer.callback = self._play
        self._start = self._steady.now().nanoseconds + self._delay
        self._start_stamp = self.get_clock().now().nanoseconds + self._delay

    def _play(self):
        while self._pending is not None:
            wait = self._start + round(self._pending.due * NANOSECONDS) - self._steady.now().nanoseconds
            if wait > 20_000:  # 20 microseconds early is on time
                self._timer.timer_period_ns = wait
                self._timer.reset()
                return
            self._publish(self._pending)
            self._pending = next(self._samples, None)
        self._timer.cancel()
        self.get_logger().info('everything has been played')
        if self._exit_at_end:
            self.done.set_result(True)

    def _publish(self, sample):
        message = JointState(name=list(sample.names), position=array.array('d', sample.positions.tobytes()))
        truth = JointState(name=self._names, position=array.array('d', sample.truth.tobytes()))
        if sample.stamp is not None:
            epoch = self._epoch if self._mode == 'file' else self._start_stamp
            # a recording may begin at zero, but a stamp of zero would mean that there is none
            stamp = max(epoch + round(sample.stamp * NANOSECONDS), 1)
            for header in (message.header, truth.header):
                header.stamp.sec, header.stamp.nanosec = divmod(stamp, NANOSECONDS)
        self._output.publish(message)
        self._truth.publish(truth)


def _motion_of(values, logger):
    """The motion to play, as the parameters say."""
    if not values['file']:
        raise UsageError('the parameter file is empty: give the path of a motion file')
    skeleton = read_skeleton(values['skeleton']) if values['skeleton'] else None
    motion = read_recording(values['file'], skeleton, values['start'] or None, values['stop'] or None,
                            **({'topic': values['topic']} if values['topic'] else {}))
    joints = [pattern for pattern in values['joints'] if pattern]
    if joints:
        motion = motion.select(*joints)
    if values['rate']:
        motion = motion.resample(values['rate'])
    if values['loop'] == 'seamless':
        motion, seam = loop_cut(motion)
        logger.info(f'loop of {motion.duration_s:.2f} s; the joints jump by {seam:.4f} rad (RMS) at its seam')
    return motion


def main(args=None):
    """Play until the end, or until told to stop."""
    return run(PlayerNode, 'motion_player', until=lambda node: node.done.done(), args=args)


if __name__ == '__main__':
    sys.exit(main())
