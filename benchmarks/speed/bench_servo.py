"""Speed of the servo path: limiter and interpolation, and the bridge node on a simulated chain.

    python benchmarks/speed/bench_servo.py              limiter and interpolation only (no ROS, no bus)
    python benchmarks/speed/bench_servo.py --bridge     also the bridge node on 20 simulated servos

Times of the first table are compared with the same mathematics in plain Python and in scipy, in the same run. For the
second, the node runs as a process of its own, the simulated chain (a pseudo-terminal) as another; windows of 20 points
stream in at 50 Hz over the middleware. A period error is the difference between the beginnings of two cycles (right
before the command is computed, after whatever else was done first), less the period, as the node counts them in its
diagnostics. They depend on how busy the machine is; the load is printed.
"""
import argparse
import math
import os
import sys
import tempfile
import time
from pathlib import Path

import machine
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from style_core.follow.limiter import Limiter
from style_core.follow.playback import Playback, make_track

ROOT = Path(__file__).resolve().parents[2]
RATE = 200.0


def microseconds(call, repeats=2000, rounds=7):
    """Median over rounds of the mean time of a call, us."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(repeats):
            call()
        times.append((time.perf_counter() - start) / repeats)
    return 1e6 * float(np.median(times))


class PlainLimiter:
    """The limiter's law in plain Python floats, as a peer for speed."""

    def __init__(self, n):
        self.p, self.w = [0.0] * n, [0.0] * n

    def step(self, target, rate, lower=-1.0, upper=1.0, s=3.0 / RATE, a=20.0 / RATE / RATE):
        def reach(gap):
            if gap <= 0:
                return 0.0
            n = math.floor((math.sqrt(1 + 8 * gap / a) - 1) / 2)
            return (gap + a * n * (n + 1) / 2) / (n + 1)
        for i, p in enumerate(self.p):
            w = self.w[i]
            up = min(w + a, s, reach(upper - p))
            down = max(w - a, -s, -reach(p - lower))
            flow = max(-s, min(s, rate[i] / RATE))
            gap = target[i] - flow - p
            w = self.w[i] = max(down, min(up, flow + reach(gap) - reach(-gap)))
            self.p[i] = p + w


def mathematics():
    """Limiter and interpolation for 30 joints."""
    n = 30
    rng = np.random.default_rng(0)
    ones = np.ones(n)
    limiter = Limiter(-ones, ones, 3 * ones, 20 * ones, 900 * ones, 1 / RATE)
    limiter.reset(np.zeros(n))
    times = np.arange(1, 26) / 60
    positions, velocities = rng.normal(0, 0.3, (2, 25, n))
    player = Playback(n, 3 * ones, 20 * ones)
    player.hold(np.zeros(n))
    state = np.zeros(n), np.zeros(n)

    def track():
        return make_track(times, positions, velocities, start=0.0, now=0.0, current=state)
    player.take_over(track(), 0.0, 0.2)
    clock = [0.0]

    def tick():
        clock[0] = (clock[0] + 0.005) % 0.4
        limiter.step(*player.sample(clock[0]))
    plain, target, rate = PlainLimiter(n), positions[0].tolist(), velocities[0].tolist()
    spline = CubicHermiteSpline(times, positions, velocities)
    slope = spline.derivative()
    rows = [
        ('limiter, a tick', microseconds(lambda: limiter.step(positions[0], velocities[0])),
         'plain Python', microseconds(lambda: plain.step(target, rate), 200)),
        ('interpolation with a decaying difference, a tick', microseconds(lambda: player.sample(0.1)),
         'scipy CubicHermiteSpline and its derivative', microseconds(lambda: (spline(0.1), slope(0.1)))),
        ('limiter and interpolation, a tick (to be below 30 us)', microseconds(tick), '', math.nan),
        ('a new window of 25 points: polynomials and take-over',
         microseconds(lambda: player.take_over(track(), 0.1, 0.06), 200), 'scipy, making the spline alone',
         microseconds(lambda: CubicHermiteSpline(times, positions, velocities), 200))]
    print(f'30 joints; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors')
    for name, ours, peer, theirs in rows:
        versus = f'{theirs:8.2f} us  {peer} ({theirs / ours:.1f} times)' if peer else ''
        print(f'  {name:55s} {ours:8.2f} us  {versus}')


def bridge(seconds, priority):
    """The bridge node at 200 Hz on 20 simulated servos, windows streaming in."""
    os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    sys.path.insert(0, str(ROOT / 'test'))
    try:
        from servo_rig import ServoRig
    except ModuleNotFoundError as error:
        sys.exit(f'{error}: the bridge needs ROS; source install/setup.bash first')
    from style_servo.hostile import legal_fields
    from style_servo.states import State
    with tempfile.TemporaryDirectory() as folder:
        rig = ServoRig(folder, chain='humanoid20.yaml', listen=False, rate=RATE, realtime_priority=priority)
        try:
            rig.up()

            def stream(duration):
                end = time.monotonic() + duration
                while time.monotonic() < end:
                    rig.send(legal_fields(rig.chain, time.monotonic(), 0.4, 20))
                    rig.spin(0.02)
            stream(4.0)
            assert rig.state is State.STREAMING, rig.reason
            rig.diagnostics.clear()
            busy, begin = machine.processor_time(rig.bridge.pid), time.monotonic()
            stream(seconds)
            busy = (machine.processor_time(rig.bridge.pid) - busy) / (time.monotonic() - begin)
            state = rig.states[-1]
            seen = [{value.key: value.value for value in message.status[0].values} for message in rig.diagnostics]
        finally:
            rig.close()
    cycles, errors = (np.array([[float(x) for x in one[f'{name} p50, p99, max (ms)'].split(',')] for one in seen])
                      for name in ('cycle time', 'period error'))
    count, off = (int(seen[-1][name]) - int(seen[0][name]) for name in ('cycles', 'periods off by more than 1 ms'))
    print(f'bridge node, 20 simulated servos, {RATE:g} Hz, {seconds:g} s, {state.accepted} windows, '
          f'{State(state.state).name}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors')
    def written(numbers):
        return ', '.join(f'{x:.3f}' for x in numbers)
    rows = {'periods off by more than 1 ms (p99 is below 1 ms under 1 %)':
                f'{off} of {count}, {100 * off / count:.2f} %',
            'period error p50, p99, max of a second: median (ms)': written(np.median(errors, axis=0)),
            'the same: worst (ms)': written(errors.max(axis=0)),
            'cycle (limit, write, read) p50, worst p99 of a second (ms)':
                f'{np.median(cycles[:, 0]):.3f}, {cycles[:, 1].max():.3f}',
            'processor time of the node': f'{100 * busy:.0f} % of one, {1e3 * busy / RATE:.2f} ms a cycle',
            'cycles longer than their period': str(state.missed_deadlines),
            'bus errors': str(state.bus_errors)}
    for name, value in rows.items():
        print(f'  {name:60s} {value}')


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bridge', action='store_true',
                        help='also measure the bridge node on a simulated chain (needs ROS)')
    parser.add_argument('--seconds', type=float, default=20.0, help='length of that measurement (default %(default)s)')
    parser.add_argument('--priority', type=int, default=0, help='real-time priority of the node (default: none)')
    machine.add_argument(parser)
    arguments = parser.parse_args()
    mathematics()
    if arguments.bridge:
        with machine.watched(arguments.awake):
            bridge(arguments.seconds, arguments.priority)


if __name__ == '__main__':
    main()
