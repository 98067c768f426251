"""What a joint_trajectory_controller makes of the bridge's messages, and of windows sent straight to it.

    source install/setup.bash
    python3 benchmarks/experiments/servo_controller.py --minutes 10

Bridge, back end and a stand-in of Humble's controller (test/controller_stand_in.py) run in lock step on simulated time.
A random motion that uses nine tenths of the limits comes in 60 windows a second. Beside the suite's messages stand
those whose first point lies one period ahead, with a zero stamp, as senders often make them. Writes
docs/results/servo/controller.md. Exit status 1 if a goal is missed.
"""
import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'test'))

from lock_step import LockStep, Motion, chain_of, judge  # noqa: E402

from style_core.report import Report  # noqa: E402
from style_servo.ros2_control_backend import Ros2ControlBackend  # noqa: E402

SETTLED = 1.5
RATES = tuple((bridge, controller) for bridge in (100, 200) for controller in (100, 200, 500, 1000))
COLUMNS = ['bridge / controller (Hz)', 'still (%)', 'largest error (rad)', 'RMS (rad)', 'largest speed', 'acceleration',
           'faults']


class PointAhead(Ros2ControlBackend):
    """Messages that begin one period ahead, stamp 0: where to be then, and where to stand after braking."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.lead, self._ahead = 0.0, 0.0

    def _message(self, times, positions, velocities):
        arrive = self._period * (self._every if self._action is not None else 1)
        points = np.array([arrive, arrive + times[-1] - self._now])
        self._stamp = lambda moment: 0
        message = super()._message(points, np.array([self._position, positions[-1]]),
                                   np.array([self._velocity, velocities[-1]]))
        return _from_time(message, round(arrive * 1e9))

    def exchange(self, position, velocity, coming):
        self._position, self._velocity, self._now = position.copy(), velocity.copy(), coming.time
        super().exchange(position, velocity, coming)

    def _has_left(self, position, velocity, moment):
        return False


def _from_time(raw, shift):
    """Move all points of a serialised trajectory by ``shift`` ns."""
    from rclpy.serialization import deserialize_message, serialize_message
    from trajectory_msgs.msg import JointTrajectory
    message = deserialize_message(raw, JointTrajectory)
    for point in message.points:
        time = point.time_from_start
        time.sec, time.nanosec = divmod(time.sec * 10**9 + time.nanosec + shift, 10**9)
    return serialize_message(message)


def row(name, step, motion):
    """A row of a table, and whether all goals are met."""
    found = judge(step, motion, SETTLED)
    good = (found['still'] == 0.0 and found['error'] < 0.01 and found['speed'] <= 1.05 and not step.reasons)
    return [name, f'{100 * found["still"]:.1f}', *(f'{found[key]:.4f}' for key in ('error', 'rms')),
            *(f'{found[key]:.2f}' for key in ('speed', 'acceleration')), len(step.reasons)], good


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--minutes', type=float, default=10.0, help='of the long runs (default %(default)s)')
    parser.add_argument('--seconds', type=float, default=10.0, help='of the others (default %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='default %(default)s')
    parser.add_argument('--output', default=ROOT / 'docs' / 'results' / 'servo', help='folder of the result page')
    arguments = parser.parse_args()
    chain = chain_of()
    motion = Motion(chain, arguments.seconds + 1, arguments.seed)
    report = Report('controller', 'A joint_trajectory_controller behind the bridge',
                    f'python3 benchmarks/experiments/servo_controller.py --minutes {arguments.minutes:g} '
                    f'--seconds {arguments.seconds:g}', seed=arguments.seed)
    report.text(f'Lock step on simulated time, {len(chain.joints)} joints, {arguments.seconds:g} s of random motion at '
                '90 % of the velocity and acceleration limits, 60 windows a second; the controller is the stand-in of '
                'test/controller_stand_in.py, the joints do what it commands. Still: updates of a joint without motion '
                'though it should move faster than 0.1 rad/s. Error: commanded position against the motion. Speed and '
                'acceleration: largest step and change of step between two updates, as shares of the limits.')
    failed = False
    for rate, name in ((None, 'topic'), (20.0, 'action, 20 goals a second')):
        for kind, title in ((PointAhead, f'{name}: first point one period ahead, stamp 0'),
                            (Ros2ControlBackend, f'{name}: this suite')):
            rows = []
            for bridge, controller in RATES:
                options = {'controller': {'open_loop_control': True}} if kind is PointAhead else {}
                step = LockStep(chain, bridge, controller, rate, backend=kind, **options)
                cells, good = row(f'{bridge} / {controller}', step.run(arguments.seconds, motion), motion)
                rows.append(cells)
                failed |= kind is Ros2ControlBackend and not good
            report.table(f'{name.split(",")[0]} {kind.__name__}', COLUMNS, rows, title)
    rows = []
    for controller in (100, 200, 500, 1000):
        for first, words in ((1 / 60, 'first point at 1/60 s'), (0.0, 'first point at 0')):
            step = LockStep(chain, 200, controller).run(arguments.seconds, motion, straight=True, first=first)
            cells, good = row(f'{words}, {controller}', step, motion)
            rows.append(cells)
            failed |= first == 0.0 and not good
    report.table('windows', ['windows / controller (Hz)', *COLUMNS[1:]], rows,
                 'Windows of 0.4 s, 60 a second, straight to the controller')
    rng = np.random.default_rng(arguments.seed)
    rows = []
    for words, options in (
            ('messages 0.5 to 3 ms, ticks up to 2 ms late', {'transport': lambda: rng.uniform(5e-4, 3e-3),
                                                             'lateness': lambda: rng.uniform(0.0, 2e-3)}),
            ('one tick in a hundred 40 ms late', {'lateness': lambda: 0.04 * (rng.random() < 0.01)}),
            ('one tick in a hundred 300 ms late', {'lateness': lambda: 0.3 * (rng.random() < 0.01)})):
        for rate, name in ((None, 'topic'), (20.0, 'action')):
            step = LockStep(chain, 200, 1000, rate, **options).run(arguments.seconds, motion)
            rows.append(row(f'{name}: {words}', step, motion)[0])
    report.table('late', ['200 / 1000 Hz', *COLUMNS[1:]], rows, 'What comes late')
    rows, long = [], Motion(chain, 60 * arguments.minutes + 1, arguments.seed + 1)
    for bridge, controller, rate in ((100, 100, None), (100, 200, 20.0)):
        step = LockStep(chain, bridge, controller, rate).run(60 * arguments.minutes, long)
        cells, good = row(f'{bridge} / {controller}, {"topic" if rate is None else "action"}', step, long)
        rows.append([*cells, step.goals or step.backend.statistics['goals sent'], step.bridge.counts['rejected']])
        failed |= not good
    report.table('long', [*COLUMNS, 'messages or goals', 'windows refused'], rows,
                 f'{arguments.minutes:g} minutes at the limits')
    print(report.write(arguments.output))
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
