"""A bridge with motors made of thin air and a clock made of a loop."""
import numpy as np

from style_servo.backend import Measurement
from style_servo.bridge import Bridge, BridgeSettings, Points
from style_servo.chain import Chain, Joint
from style_servo.states import State

RATE = 200.0
NAMES = ('hip', 'knee')
START = np.array([0.1, -0.2])


class IdealMotors:
    """Joints that are where they are told to be, until a test says otherwise."""

    def __init__(self):
        self.measurement = Measurement.unknown(2)
        self.statistics, self.notes, self.facts, self.warnings = {}, [], {}, []
        self.posture = START.copy()
        self.sent = []
        self.torque = False
        self.stuck = self.fault = None
        self.wall = np.array([[-np.inf], [np.inf]])     # between which the joints can be
        self.enabling = lambda: None    # called while torque comes on
        self.answers = True
        self.connected = 0

    def connect(self):
        self.torque = False
        if self.fault:
            raise self.fault
        self.connected += 1
        self.observe()

    def observe(self):
        if self.fault:
            raise self.fault
        self.measurement.position = self.posture.copy()
        self.measurement.fresh = self.answers

    def enable(self):
        if self.fault:
            raise self.fault
        self.torque = True
        self.enabling()
        self.observe()

    def exchange(self, position, velocity, stop):
        assert self.torque
        self.sent.append(position.copy())
        self.posture = np.clip(position, *self.wall)
        if self.stuck is not None:
            self.posture[0] = self.stuck
        self.observe()

    def disable(self):
        self.torque = False
        return True

    def close(self):
        self.disable()


class Rig:
    """A bridge, its motors and a clock."""

    def __init__(self, armed=True, **changes):
        self.chain = Chain(tuple(Joint(name, -1.0, 1.0, 3.0, 20.0, 0.3, 0.3) for name in NAMES))
        self.motors = IdealMotors()
        self.bridge = Bridge(self.chain, self.motors, BridgeSettings(rate=RATE, **changes))
        self.now = 100.0
        self.path = []
        if armed:
            self.motors.connect()
            self.bridge.arm(self.now)
            assert self.bridge.state is State.READY

    def run(self, seconds):
        for _ in range(round(seconds * RATE)):
            self.now += 1 / RATE
            self.bridge.tick(self.now)
            self.path.append(self.bridge.command.copy())
        return self

    def send(self, times, positions, velocities=None, names=NAMES, delay=0.0):
        self.bridge.submit(Points(names, np.asarray(times, float), np.asarray(positions, float), velocities),
                           self.now + delay, self.now)

    def wave(self, seconds=0.6):
        """A window of an endless motion, as a predictor sends it."""
        times = np.linspace(0, seconds, 20)
        t = (self.now - 100.0 + times)[:, None]
        phase = np.array([0.0, 1.0])
        self.send(times, 0.4 * np.sin(3 * t + phase), 1.2 * np.cos(3 * t + phase))

    def stream(self, seconds, every=5):
        for k in range(round(seconds * RATE)):
            if k % every == 0:
                self.wave()
            self.run(1 / RATE)
        return self

    def stays_within_limits(self):
        path = np.array(self.motors.sent)
        steps = np.diff(path, axis=0)
        assert np.all(np.abs(path) <= 1.0)
        assert np.all(np.abs(steps) <= 3.0 / RATE)
        assert np.all(np.abs(np.diff(steps, axis=0)) <= 20.0 / RATE / RATE)


def fast_wave(rig, frequency, amplitude):
    """A window of a motion that may ask for more than the joints can do."""
    times = np.linspace(0, 0.4, 20)
    angle = frequency * (rig.now + times)[:, None] + [0.0, 1.0]
    rig.send(times, amplitude * np.sin(angle), amplitude * frequency * np.cos(angle))
    return amplitude * np.sin(frequency * rig.now + np.array([0.0, 1.0]))
