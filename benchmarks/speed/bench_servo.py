"""Speed of the servo path: limiter and interpolation, and the bridge on a simulated chain.

    python benchmarks/speed/bench_servo.py              limiter and interpolation only (no ROS, no bus)
    python benchmarks/speed/bench_servo.py --bridge     also the back end and the whole bridge on 20 simulated servos

Times of the first table are compared with the same mathematics in plain Python and in scipy, in the same run. The
bridge's figures depend on how busy the machine is; the load is printed beside them.
"""
import argparse
import math
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from style_core.live.limiter import Limiter
from style_core.live.playback import Playback, make_track

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
        ('limiter and interpolation, a tick', microseconds(tick), '', math.nan),
        ('a new window of 25 points: polynomials and take-over',
         microseconds(lambda: player.take_over(track(), 0.1, 0.06), 200), 'scipy, making the spline alone',
         microseconds(lambda: CubicHermiteSpline(times, positions, velocities), 200))]
    print(f'30 joints; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors')
    for name, ours, peer, theirs in rows:
        versus = f'{theirs:8.2f} us  {peer} ({theirs / ours:.1f} times)' if peer else ''
        print(f'  {name:55s} {ours:8.2f} us  {versus}')


def bridge(seconds):
    """The back end and the whole bridge at 200 Hz on 20 simulated servos, each in its own process."""
    from style_core.errors import MotionError
    from style_servo.backend import BackendFault
    from style_servo.bridge import Bridge, BridgeSettings, Points
    from style_servo.bridge_health import CycleTimes
    from style_servo.chain import Chain, Joint
    from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
    joints = tuple(Joint(f'joint_{k}', -1.5, 1.5, 3.0, 30.0, following_error=1.0, id=k, model='XM430-W350')
                   for k in range(1, 21))
    chain = Chain(joints)
    with tempfile.TemporaryDirectory() as folder:
        link = os.path.join(folder, 'port')
        simulator = subprocess.Popen([sys.executable, '-m', 'style_servo.dynamixel_sim', '--link', link, '--servos',
                                      '1-20:XM430-W350'], stdout=subprocess.PIPE)
        simulator.stdout.readline()
        backend = DynamixelBackend(chain, BusSettings(link, reply_timeout=0.02, watchdog=1.0), 1 / RATE)
        machine = Bridge(chain, backend, BridgeSettings(rate=RATE))
        times = CycleTimes(1 / RATE)
        try:
            backend.connect()
            machine.arm(time.monotonic())
            begin = due = time.monotonic()
            busy = time.process_time()
            points = np.linspace(0, 0.4, 25)
            while due - begin < seconds:
                due += 1 / RATE
                time.sleep(max(0.0, due - time.monotonic()))
                now = time.monotonic()
                if times.cycles % 2 == 0:
                    angle = 3 * (now - begin + points)[:, None] + np.arange(20)
                    machine.submit(Points(chain.names, points, 0.5 * np.sin(angle), 1.5 * np.cos(angle)), now, now)
                times.done(now, machine.tick(now), time.monotonic() - now)
            busy = (time.process_time() - busy) / seconds
            print(f'bridge without middleware, 20 simulated servos, {RATE:g} Hz, {seconds:g} s, {machine.state.name}; '
                  f'load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors')
            facts = {**times.report(), 'processor time of the bridge': f'{100 * busy:.0f} %',
                     'cycles longer than their period': f'{times.missed} of {times.cycles}',
                     'bus reads without an answer': str(backend.statistics['read errors'])}
            for name, value in facts.items():
                print(f'  {name:55s} {value}')
        except (BackendFault, MotionError) as error:
            print(f'the bridge gave up ({error}): {machine.reason}')
        finally:
            backend.close()
            simulator.terminate()
            simulator.wait()
            simulator.stdout.close()


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bridge', action='store_true', help='also measure the bridge on a simulated chain')
    parser.add_argument('--seconds', type=float, default=20.0, help='length of that measurement (default %(default)s)')
    arguments = parser.parse_args()
    mathematics()
    if arguments.bridge:
        bridge(arguments.seconds)


if __name__ == '__main__':
    main()
