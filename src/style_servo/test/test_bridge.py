"""The bridge's behaviour, tick by tick, with motors made of thin air and a clock made of a loop."""
import contextlib
import math
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from style_core.errors import MotionError, UsageError
from style_servo.backend import BackendFault, Measurement
from style_servo.bridge import Bridge, BridgeSettings, Points
from style_servo.chain import Chain, Joint
from style_servo.states import EDGES, Event, State, mermaid

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
        self.observe()

    def exchange(self, position, velocity, stop):
        assert self.torque
        self.sent.append(position.copy())
        self.posture = position.copy()
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

    taken: ClassVar[dict] = {}      # edges of the state table taken by all rigs of this file

    def __init__(self, armed=True, **changes):
        self.chain = Chain(tuple(Joint(name, -1.0, 1.0, 3.0, 20.0, 0.3, 0.3) for name in NAMES))
        self.motors = IdealMotors()
        self.bridge = Bridge(self.chain, self.motors, BridgeSettings(rate=RATE, **changes))
        self.bridge.machine.taken = Rig.taken
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


def test_it_holds_the_measured_posture_until_a_trajectory_comes():
    rig = Rig().run(0.5)
    np.testing.assert_allclose(rig.path, np.tile(START, (100, 1)), atol=1e-12)


def test_streaming_ramps_in_and_then_follows_exactly():
    rig = Rig().stream(0.1)
    assert rig.bridge.state is State.RAMPING
    rig.stream(3.0)
    assert rig.bridge.state is State.STREAMING
    t = rig.now - 100.0
    np.testing.assert_allclose(rig.bridge.command, 0.4 * np.sin(3 * t + np.array([0, 1])), atol=1e-4)
    rig.stays_within_limits()
    # the ramp stays within its fraction of the speed limit, on top of the motion's own 1.2 rad/s
    ramp = np.abs(np.diff(rig.path[:60], axis=0)) * RATE
    assert ramp.max() < 0.3 * 3.0 + 1.2 + 0.01


def test_late_ticks_make_up_for_missed_periods_within_the_limits():
    """A busy machine: the commands still come from steps of one period each, and the motion keeps its time."""
    rig = Rig()
    rows = []
    rig.bridge.trace = lambda now, state, target, command, measured, playing: rows.append(command.copy())
    rng = np.random.default_rng(0)
    sent = 0
    while rig.now < 104.0:
        rig.wave()
        gap = float(rng.choice([0.002, 0.005, 0.012, 0.03]))
        rig.now += gap
        sent += rig.bridge.tick(rig.now) > 0
    assert rig.bridge.state is State.STREAMING and sent < 0.6 * len(rows)
    assert abs(len(rows) - 4.0 * RATE) <= 2
    np.testing.assert_allclose(rig.bridge.command, 0.4 * np.sin(3 * (rig.now - 100) + np.array([0, 1])), atol=1e-3)
    steps = np.diff(rows, axis=0)
    assert np.all(np.abs(steps) <= 3.0 / RATE) and np.all(np.abs(np.diff(steps, axis=0)) <= 20.0 / RATE / RATE)


@pytest.mark.parametrize('late', [0.011, 0.03, 0.2])
@pytest.mark.parametrize('begin', [0.0, 2.0])
def test_a_trajectory_that_comes_right_before_a_late_tick_is_no_jump(late, begin):
    """The periods made up for lie before it took over."""
    rig, rows = Rig().run(0.1), []
    rig.bridge.trace = lambda now, state, target, command, measured, playing: rows.append((*target, *command))
    rig.now += late
    if begin:
        rig.send([begin], [[0.5, -0.5]])
    else:
        rig.wave()
    assert rig.bridge.tick(rig.now) > 1
    assert rig.bridge.state in (State.RAMPING, State.STREAMING)
    rig.run(0.2)
    if not begin:
        rig.stream(1.0).now += late
        rig.wave()      # takes over in the middle of a motion
        rig.bridge.tick(rig.now)
    assert rig.bridge.counts['limiter rejections'] == 0
    assert np.all(np.isfinite(rows)) and np.abs(rows).max() < 1.0
    steps = np.diff(np.array(rows)[:, 2:], axis=0)
    assert np.all(np.abs(steps) <= 3.0 / RATE) and np.all(np.abs(np.diff(steps, axis=0)) <= 20.0 / RATE / RATE)


def test_a_long_pause_is_not_made_up_for():
    rig = Rig().stream(2.0)
    rig.now += 3.0
    assert rig.bridge.tick(rig.now) == 10
    assert np.max(np.abs(rig.bridge.command - rig.path[-1])) <= 10 * 3.0 / RATE


def test_what_a_fast_motion_does_in_a_long_pause_is_no_jump():
    rig = Rig()
    for _ in range(600):
        fast_wave(rig, 8.0, 0.9)
        rig.run(1 / RATE)
    for _ in range(10):
        fast_wave(rig, 8.0, 0.9)
        rig.now += 0.15         # of which 0.1 s are lost: 0.7 rad at most
        rig.bridge.tick(rig.now)
        assert rig.bridge.state is State.STREAMING
    assert rig.bridge.counts['limiter rejections'] == 0


def test_a_single_goal_is_approached_and_kept():
    rig = Rig()
    rig.send([1.5], [[0.8, 0.5]])
    rig.run(2.0)
    assert rig.bridge.state is State.READY and rig.bridge.reason == ''
    np.testing.assert_allclose(rig.bridge.command, [0.8, 0.5], atol=1e-9)
    rig.stays_within_limits()


def test_input_that_stops_leads_to_a_smooth_hold_within_the_configured_time():
    rig = Rig(input_timeout=0.2).stream(2.0)
    rig.run(0.15)
    assert rig.bridge.state is State.STREAMING
    rig.run(0.07)
    assert rig.bridge.state is State.HOLDING and 'no new trajectory' in rig.bridge.reason
    rig.run(0.3)
    held = rig.bridge.command.copy()
    rig.run(1.0)
    np.testing.assert_array_equal(rig.bridge.command, held)
    rig.stays_within_limits()
    rig.stream(2.0)      # and back, without a jump
    assert rig.bridge.state is State.STREAMING
    rig.stays_within_limits()


def test_a_window_that_runs_out_while_moving_coasts_and_holds():
    rig = Rig(input_timeout=0.0).stream(1.5)
    rig.run(0.9)
    assert rig.bridge.state is State.HOLDING and 'ended while moving' in rig.bridge.reason
    rig.stays_within_limits()


def test_a_latched_hold_wants_a_reset():
    rig = Rig(latch_hold=True).stream(1.5)
    rig.run(1.0)
    with pytest.raises(MotionError, match='HOLDING: call reset first'):
        rig.wave()
    rig.bridge.reset(rig.now)
    rig.stream(1.5)
    assert rig.bridge.state is State.STREAMING
    rig.stays_within_limits()


@pytest.mark.parametrize('policy, state, torque', [('hold', State.HOLDING, True), ('relax', State.RELAXED, False),
                                                   ('fault', State.FAULT, True)])
def test_the_hold_policy(policy, state, torque):
    rig = Rig(hold_policy=policy, hold_timeout=0.5).stream(1.0)
    rig.run(1.2)
    assert rig.bridge.state is state and rig.motors.torque is torque
    if state is not State.HOLDING:
        rig.motors.posture += 0.05       # sagged
        rig.bridge.reset(rig.now)
        assert rig.bridge.state is State.READY and rig.motors.torque
        if policy == 'relax':
            np.testing.assert_allclose(rig.bridge.command, rig.motors.posture, atol=1e-12)


@pytest.mark.parametrize('action, torque', [('brake', True), ('torque_off', False)])
def test_an_emergency_stop_acts_in_the_next_cycle_and_latches(action, torque):
    rig = Rig(estop_action=action).stream(2.0)
    speed = np.abs(rig.bridge.command_velocity)
    assert speed.max() > 0.5
    rig.bridge.estop(rig.now)
    assert rig.motors.torque is torque
    rig.run(1 / RATE)
    assert rig.bridge.state is State.ESTOP
    if torque:      # braking as hard as the limits allow, from the very next command
        np.testing.assert_allclose(np.abs(rig.bridge.command_velocity), np.maximum(speed - 20.0 / RATE, 0), atol=1e-6)
    rig.run(0.5)
    with pytest.raises(MotionError, match='ESTOP'):
        rig.wave()
    rig.bridge.estop_held = True
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.reset(rig.now)
    rig.bridge.estop_held = False
    rig.motors.sent.clear()     # with torque off nothing was sent; it starts anew where the joints are
    rig.bridge.reset(rig.now)
    rig.stream(2.0)
    assert rig.bridge.state is State.STREAMING
    rig.stays_within_limits()


def test_reset_waits_until_the_joints_stand():
    rig = Rig().stream(2.0)
    rig.bridge.estop(rig.now)
    rig.run(1 / RATE)
    with pytest.raises(UsageError, match='still brake'):
        rig.bridge.reset(rig.now)


def test_a_following_error_is_a_fault_that_names_the_joint():
    rig = Rig()
    rig.motors.stuck = 0.1
    rig.send([1.0], [[0.9, 0.0]])
    rig.run(1.5)
    assert rig.bridge.state is State.FAULT and 'hip does not follow' in rig.bridge.reason
    rig.motors.stuck = None
    rig.run(0.5)
    rig.bridge.reset(rig.now)
    assert rig.bridge.state is State.READY


@pytest.mark.parametrize('lost', [True, False])
def test_a_back_end_fault_latches_and_reset_reconnects(lost):
    rig = Rig().stream(1.0)
    rig.motors.fault = BackendFault('servo gone', connection_lost=lost)
    rig.run(0.1)
    assert rig.bridge.state is State.FAULT and rig.bridge.reason == 'servo gone'
    with pytest.raises(BackendFault):
        rig.bridge.reset(rig.now)
    assert rig.bridge.state is State.FAULT and 'reset failed' in rig.bridge.reason
    rig.motors.fault = None
    rig.bridge.reset(rig.now)
    assert rig.bridge.state is State.READY and rig.motors.connected == 2
    rig.stream(2.0)
    assert rig.bridge.state is State.STREAMING


@pytest.mark.parametrize('action', ['brake', 'torque_off'])
def test_an_emergency_stop_counts_while_a_fault_is_latched(action):
    """The motors hold with torque in a fault; who presses the button then means it."""
    rig = Rig(estop_action=action)
    rig.motors.stuck = 0.1
    rig.send([1.0], [[0.9, 0.0]])
    rig.run(1.5)
    assert rig.bridge.state is State.FAULT and rig.motors.torque
    rig.bridge.estop(rig.now)
    rig.run(0.2)
    assert rig.bridge.state is State.FAULT and 'hip does not follow' in rig.bridge.reason
    assert rig.motors.torque == (action == 'brake')
    rig.motors.stuck = None
    rig.run(0.5)
    rig.bridge.reset(rig.now)
    assert rig.bridge.state is State.READY and rig.motors.torque


def test_arming_refuses_an_impossible_posture_and_an_unknown_one():
    rig = Rig(armed=False)
    rig.motors.posture = np.array([0.0, 1.2])
    with pytest.raises(UsageError, match=r'knee stands at 1\.200 rad, outside its limits'):
        rig.bridge.arm(rig.now)
    assert not rig.motors.torque and rig.bridge.state is State.DISARMED
    rig.motors.posture = START.copy()
    rig.motors.answers = False
    with pytest.raises(UsageError, match='not known'):
        rig.bridge.arm(rig.now)
    rig.motors.answers = True
    rig.bridge.estop_held = True
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.arm(rig.now)


def test_disarming_brakes_first():
    rig = Rig().stream(2.0)
    assert rig.bridge.moving
    rig.bridge.stop(rig.now, clock=lambda: 0.0, sleep=lambda s: None)
    assert not rig.bridge.moving
    rig.bridge.disarm(rig.now)
    assert rig.bridge.state is State.DISARMED and not rig.motors.torque
    rig.stays_within_limits()


BAD = [
    ({'times': [0.0, 0.1], 'positions': [[0, np.nan], [0, 0]]}, 'finite'),
    ({'times': [0.0, 0.1], 'positions': [[0, np.inf], [0, 0]]}, 'finite'),
    ({'times': [0.0, 0.1], 'positions': [[1e300, 0], [0, 0]]}, 'large'),
    ({'times': [0.1, 0.0], 'positions': [[0, 0], [0, 0]]}, 'increase'),
    ({'times': [0.1, 0.1], 'positions': [[0, 0], [0, 0]]}, 'increase'),
    ({'times': [0.1], 'positions': [[0, 0, 0]]}, 'shape'),
    ({'times': [], 'positions': np.zeros((0, 2))}, 'fit'),
    ({'times': [0.1], 'positions': [[0, 0]], 'names': ('hip', 'elbow')}, 'unknown joint elbow'),
    ({'times': [0.1], 'positions': [[0, 0]], 'names': ('hip', 'hip')}, 'twice'),
    ({'times': [0.1], 'positions': [[0]], 'names': ('hip',)}, 'no values for joint knee'),
    ({'times': [0.1], 'positions': [[0, 0]], 'velocities': np.full((1, 2), np.nan)}, 'finite'),
    ({'times': [0.1, 0.2], 'positions': [[0, 0], [0, 0]], 'delay': 5.0}, 'future'),
    ({'times': [0.1, 0.2], 'positions': [[0, 0], [0, 0]], 'delay': -5.0}, 'ago'),
    ({'times': [0.1, 0.2], 'positions': [[0, 0], [0, 0]], 'delay': math.nan}, 'future'),
]


@pytest.mark.parametrize('bad, words', BAD)
def test_bad_trajectories_are_refused_counted_and_change_nothing(bad, words):
    calm, rig = Rig().stream(1.0), Rig().stream(1.0)
    with pytest.raises(MotionError, match=words):
        rig.send(**bad)
    assert rig.bridge.counts['rejected'] == 1 and sum(rig.bridge.rejections.values()) == 1
    np.testing.assert_array_equal(rig.run(0.2).path, calm.run(0.2).path)


def test_a_jump_while_streaming_is_refused():
    rig = Rig().stream(1.5)
    with pytest.raises(MotionError, match='would jump'):
        rig.send([0.0, 0.1], rig.bridge.command + np.array([[0.5, 0], [0.5, 0]]))
    assert rig.bridge.rejections == {'discontinuity': 1}


def test_targets_that_jump_end_in_a_hold():
    rig = Rig().stream(2.0)
    now = rig.bridge.command
    rig.send([0.0, 0.1, 0.101, 0.6], np.array([now, now, now + [0.7, 0.0], now + [0.7, 0.0]]))
    rig.run(0.4)
    assert rig.bridge.state is State.HOLDING and 'hip jumps' in rig.bridge.reason
    rig.stays_within_limits()


def fast_wave(rig, frequency, amplitude):
    """A window of a motion that may ask for more than the joints can do."""
    times = np.linspace(0, 0.4, 20)
    angle = frequency * (rig.now + times)[:, None] + [0.0, 1.0]
    rig.send(times, amplitude * np.sin(angle), amplitude * frequency * np.cos(angle))
    return amplitude * np.sin(frequency * rig.now + np.array([0.0, 1.0]))


@given(frequency=st.floats(5.0, 20.0), amplitude=st.floats(0.3, 0.95), phase=st.floats(0.0, 6.0))
@settings(derandomize=True, max_examples=8, deadline=None, phases=[Phase.generate])
def test_a_motion_beyond_the_limits_is_followed_as_far_as_they_allow(frequency, amplitude, phase):
    """It never falls out of STREAMING, and as soon as the motion is one that the joints can do, the lag is gone."""
    rig = Rig()
    rig.now += phase
    rig.bridge.ticked = rig.now
    seen, lag, lags = set(), [], []
    for k in range(round(6 * RATE)):
        if k % 4 == 0:
            target = fast_wave(rig, frequency, amplitude)
            lag.append(np.abs(target - rig.bridge.command).max())
        rig.run(1 / RATE)
        seen.add(rig.bridge.state)
        lags.append(rig.bridge.lag.max())
    assert seen <= {State.RAMPING, State.STREAMING} and rig.bridge.counts['rejected'] == 0
    assert max(lag) <= 2 * amplitude + 0.1
    if amplitude * frequency > 3.3:
        assert rig.bridge.counts['clamped'] > 0 and max(lags) > 0
    speeds = np.abs(np.diff(rig.path[-400:], axis=0)) * RATE
    assert np.ptp(rig.path[-400:], axis=0).max() > 0.25 * min(amplitude, 20.0 / frequency**2)   # it does move
    assert speeds.max() <= 3.0 + 1e-9
    rig.send([2.0], [[0.0, 0.0]])       # a calm end
    rig.run(2.5)
    assert rig.bridge.state is State.READY and rig.bridge.lag.max() == 0
    np.testing.assert_allclose(rig.bridge.command, 0.0, atol=1e-9)
    rig.stays_within_limits()


def test_a_motion_that_leaves_a_joint_behind_for_too_long_ends_in_a_hold():
    """Above 0.3 rad behind for all of the time allowed: a ramp up to the end at ten times the speed limit."""
    rig = Rig(saturation_time=0.2).stream(2.0)
    now = rig.bridge.command.copy()
    rig.send([0.0, 0.06, 2.0], np.array([now, np.sign(now) * -0.95, np.sign(now) * -0.95]))
    rig.run(0.5)
    assert rig.bridge.state is State.HOLDING and 'asks for more than its limits' in rig.bridge.reason
    rig.stays_within_limits()


@given(seed=st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=30, deadline=None)
def test_the_target_never_swings_beyond_posture_and_motion(seed):
    """From a hold into any motion inside the position limits, whatever its speed: the target stays inside as well."""
    rng = np.random.default_rng(seed)
    rig = Rig()
    frequency, amplitude = rng.uniform(1.0, 25.0), rng.uniform(0.1, 0.95)
    targets = []
    rig.bridge.trace = lambda now, state, target, command, measured, playing: targets.append(target.copy())
    for _ in range(4):
        for k in range(round(rng.uniform(0.1, 1.5) * RATE)):
            if k % 4 == 0:
                fast_wave(rig, frequency, amplitude)
            rig.run(1 / RATE)
        rig.run(rng.uniform(0.6, 1.0))      # a pause: hold, and ramp in again
    assert rig.bridge.state is State.HOLDING
    # windows of one motion, cut into cubics and coasting to rest: a little beyond it at most
    assert np.abs(targets).max() <= max(amplitude + min(0.05 * amplitude * frequency, 0.3), 0.2) + 0.02
    rig.stays_within_limits()


def test_some_of_the_joints_where_allowed():
    rig = Rig(partial_joints=True)
    rig.send([1.0], [[0.5]], names=('knee',))
    rig.run(1.5)
    np.testing.assert_allclose(rig.bridge.command, [START[0], 0.5], atol=1e-6)


def test_joints_come_in_any_order():
    rig = Rig()
    rig.send([1.0], [[0.5, 0.3]], names=('knee', 'hip'))
    rig.run(1.5)
    np.testing.assert_allclose(rig.bridge.command, [0.3, 0.5], atol=1e-9)


def test_trajectories_that_start_in_the_future_wait_and_then_play():
    rig = Rig()
    rig.send([0.5], [[0.4, 0.4]], delay=0.5)
    rig.send([0.5], [[0.2, 0.2]], delay=0.5)       # replaces the one above
    rig.run(0.45)
    np.testing.assert_allclose(rig.bridge.command, START, atol=1e-12)
    rig.run(1.0)
    np.testing.assert_allclose(rig.bridge.command, [0.2, 0.2], atol=1e-9)
    for k in range(16):
        rig.send([0.5], [[0.2, 0.2]], delay=0.1 + 0.01 * k)
    with pytest.raises(MotionError, match='already wait'):
        rig.send([0.5], [[0.2, 0.2]], delay=1.0)


@given(seed=st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=40, deadline=None)
def test_random_streams_with_random_events_never_leave_the_limits(seed):
    rng = np.random.default_rng(seed)
    rig = Rig(input_timeout=float(rng.choice([0.0, 0.1])), hold_timeout=0.3,
              hold_policy=str(rng.choice(['hold', 'fault'])))
    for _ in range(60):
        k = int(rng.integers(1, 8))
        times = np.cumsum(rng.exponential(0.1, k))
        positions = rng.normal(0, rng.choice([0.1, 1.0, 50.0]), (k, 2))
        if rng.random() < 0.2:
            positions[rng.integers(k), 0] = rng.choice([np.nan, np.inf, 1e12])
        velocities = rng.normal(0, rng.choice([0.1, 10.0, 1e6]), (k, 2)) if rng.random() < 0.5 else None
        with contextlib.suppress(MotionError):
            rig.send(times, positions, velocities, delay=float(rng.choice([0.0, 0.0, -0.05, 0.1])))
        event = rng.random()
        if event < 0.03:
            rig.bridge.estop(rig.now)
        elif event < 0.2:
            with contextlib.suppress(UsageError):
                rig.bridge.reset(rig.now)
        rig.run(float(rng.exponential(0.05)))
    rig.stays_within_limits()


def test_the_state_diagram_shows_every_edge():
    text = mermaid()
    assert all(event.name.lower() in text for event in Event)
    assert all(f'{state.name} --> {target.name}' in text for (state, _), target in EDGES.items())
    reachable = {State.DISARMED}
    for _ in State:
        reachable |= {target for (state, _), target in EDGES.items() if state in reachable}
    assert reachable == set(State)


def test_zz_every_edge_of_the_state_table_is_taken():
    """What the tests above leave out, by the same doors; then all edges have been seen."""
    def faulty(rig):
        rig.motors.fault = BackendFault('gone')
        rig.run(0.05)
        assert rig.bridge.state is State.FAULT
        rig.motors.fault = None
    in_state = {
        State.READY: Rig, State.RAMPING: lambda: Rig().stream(0.1), State.STREAMING: lambda: Rig().stream(2.0),
        State.HOLDING: lambda: Rig(input_timeout=0.1).stream(2.0).run(0.5),
        State.RELAXED: lambda: Rig(input_timeout=0.1, hold_policy='relax', hold_timeout=0.1).stream(2.0).run(0.5),
        State.ESTOP: lambda: Rig().run(0.1), State.FAULT: lambda: Rig().run(0.1)}
    for state, make in in_state.items():
        for event in (Event.ESTOP, Event.FAULT, Event.DISARM):
            rig = make()
            if state is State.ESTOP:
                rig.bridge.estop(rig.now)
            elif state is State.FAULT:
                faulty(rig)
            assert rig.bridge.state is state
            if event is Event.ESTOP:
                rig.bridge.estop(rig.now)
            elif event is Event.FAULT:
                faulty(rig)
            else:
                rig.bridge.disarm(rig.now)
    rig = Rig(ramp_time=2.0).stream(0.5)
    rig.run(1.0)
    assert rig.bridge.state is State.HOLDING
    rig = Rig(ramp_time=2.0).stream(0.2)
    now = rig.bridge.command
    with contextlib.suppress(MotionError):
        rig.bridge._playback.hold(now)
    rig.send([0.0, 0.1, 0.101, 0.6], np.array([now, now, now + [0.9, 0.0], now + [0.9, 0.0]]))
    rig.run(0.4)
    missing = [f'{state.name} --{event.name}' for state, event in EDGES if (state, event) not in Rig.taken]
    assert not missing, missing
