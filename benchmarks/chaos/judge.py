"""An independent subscriber: limits, continuity, stamps and freshness of what the robot is told, from messages alone.

It knows the chain file and the messages, and none of the suite's code. Five times a second it prints a line of JSON.
"""
import json
import math
import sys
import time

import rclpy
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from style_msgs.msg import BridgeState, StyleEstimate

#: a command may be so much further from the last than their stamps say: missed periods that are made up for, s
MADE_UP = 0.06
#: a command may start anew from the measured posture within this time of a change to READY, s
NEAR_READY = 1.5


class Judge:
    """Counts commands and windows, and every one that is wrong."""

    def __init__(self, chain):
        content = yaml.safe_load(open(chain))       # noqa: SIM115
        joints = {name: {**content.get('defaults', {}), **own} for name, own in content['joints'].items()}
        self.limits = {name: tuple(one[key] for key in ('lower', 'upper', 'velocity', 'acceleration'))
                       for name, one in joints.items()}
        self.counts = dict.fromkeys(('commands', 'windows', 'estimates', 'not finite', 'position', 'velocity',
                                     'acceleration', 'command stamps', 'window stamps', 'window content'), 0)
        self.last = self.window_stamp = None
        self.suspects, self.ready, self.state, self.first_of_life = [], [], -1, True
        self.seen = dict.fromkeys(('command', 'window', 'tracking', 'state'), -math.inf)

    def command(self, message):
        """Judge a command against the limits and the command before."""
        self.counts['commands'] += 1
        self.seen['command'] = now = time.monotonic()
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        values = dict(zip(message.name, zip(message.position, message.velocity)))
        if not all(math.isfinite(x) for pair in values.values() for x in pair):
            self.counts['not finite'] += 1
            return
        for name, (position, _) in values.items():
            lower, upper = self.limits[name][:2]
            if not lower - 0.0501 <= position <= upper + 0.0501:     # the documented room after arming
                self.counts['position'] += 1
        if self.last is not None:
            before, old = self.last
            if stamp <= before:
                self.suspects.append((now, 'command stamps'))
            room = stamp - before + MADE_UP
            for name, (position, velocity) in values.items():
                _, _, fastest, hardest = self.limits[name]
                if abs(position - old[name][0]) > fastest * room:
                    self.suspects.append((now, 'velocity'))
                if abs(velocity - old[name][1]) > hardest * room:
                    self.suspects.append((now, 'acceleration'))
        self.last = stamp, values

    def bridge(self, message):
        """Note the state, and when the bridge started anew."""
        self.seen['state'] = time.monotonic()
        if message.state == BridgeState.READY and self.state in (-1, 0, 4, 5, 6, 7):
            self.ready.append(time.monotonic())
            del self.ready[:-50]
        self.state = message.state

    def window(self, message):
        """Judge a trajectory of the synthesizer (others send on the same topic; it alone sends 21 points)."""
        if len(message.points) != 21:
            return
        self.counts['windows'] += 1
        self.seen['window'] = time.monotonic()
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
        finite = all(math.isfinite(x) for point in message.points for x in (*point.positions, *point.velocities))
        within = finite and all(self.limits[name][0] - 1e-6 <= x <= self.limits[name][1] + 1e-6
                                for point in message.points for name, x in zip(message.joint_names, point.positions))
        if not within or times[0] <= 0 or any(b <= a for a, b in zip(times, times[1:])):     # noqa: RUF007
            self.counts['window content'] += 1
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if self.window_stamp is not None and stamp <= self.window_stamp:
            self.counts['window stamps'] += 1
        self.window_stamp = stamp

    def estimate(self, message):
        """Note whether the person is tracked."""
        self.counts['estimates'] += 1
        if message.status == StyleEstimate.TRACKING:
            self.seen['tracking'] = time.monotonic()

    def report(self):
        """Judge what was put off, and print."""
        now = time.monotonic()
        due = [one for one in self.suspects if now - one[0] > 2 * NEAR_READY]
        self.suspects = [one for one in self.suspects if now - one[0] <= 2 * NEAR_READY]
        for when, what in due:
            if not any(abs(when - ready) < NEAR_READY for ready in self.ready):
                self.counts[what] += 1
        print(json.dumps({'counts': self.counts, 'state': self.state,
                          'ages': {name: min(now - seen, 1e6) for name, seen in self.seen.items()}}), flush=True)


def main():
    """Listen until the program is ended; the argument is the chain file."""
    rclpy.init()
    node, judge = rclpy.create_node('judge'), Judge(sys.argv[1])
    latched = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(JointState, '/servo_bridge/command', judge.command, 500)
    node.create_subscription(BridgeState, '/servo_bridge/state', judge.bridge, latched)
    node.create_subscription(JointTrajectory, '/joint_trajectory', judge.window, 100)
    node.create_subscription(StyleEstimate, '/predictor/estimate', judge.estimate,
                             QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT))
    node.create_timer(0.2, judge.report)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
