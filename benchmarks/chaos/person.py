"""A person who walks: joint states of a shipped model's behaviour, with a clock that others can set wrong."""
import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from style_core.phase_style import load_behaviours
from style_core.synthesis.sources.phase_style import CycleSource

RATE_HZ = 50.0


def main():
    """Walk until the program is ended; the argument is the model file."""
    import sys
    behaviour = load_behaviours(sys.argv[1])[0]
    source = CycleSource(behaviour)
    count = round(source.period * RATE_HZ)
    poses = source.window(np.arange(count) * source.period / count)[0]
    rclpy.init()
    node = rclpy.create_node('person')
    publisher, offset, frame = node.create_publisher(JointState, 'person/joint_states', 10), [0.0], [0]
    node.create_subscription(Float64, 'chaos/clock_offset', lambda message: offset.__setitem__(0, message.data), 10)

    def step():
        frame[0] += 1
        message = JointState(name=list(behaviour.joint_names), position=poses[frame[0] % count].tolist())
        stamp = node.get_clock().now().nanoseconds + round(offset[0] * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        publisher.publish(message)
    node.create_timer(source.period / count, step)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
