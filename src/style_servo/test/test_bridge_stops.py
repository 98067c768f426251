"""The bridge stopped: emergency stop, faults, resets, and what a stopped joint presses with."""
import contextlib

import numpy as np
import pytest
from bridge_rig import RATE, START, Rig
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import MotionError, UsageError
from style_servo.backend import BackendFault
from style_servo.states import State

STOPPED = (State.DISARMED, State.ESTOP, State.FAULT)


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
    rig.bridge.pressed = lambda now: 'by hand'
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.reset(rig.now)
    rig.bridge.pressed = lambda now: ''
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
    rig.bridge.pressed = lambda now: 'by hand'
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.arm(rig.now)


# --- the emergency stop is a state ------------------------------------------------------------------------------


class Pressed:
    """A button."""

    def __init__(self, rig):
        self.reason = ''
        rig.bridge.pressed = lambda now: self.reason


@pytest.mark.parametrize('action', ['brake', 'torque_off'])
@pytest.mark.parametrize('seconds', [0.0, 0.1, 2.0, 2.6])
def test_a_pressed_button_stops_with_the_next_command_without_any_event(action, seconds):
    """Ready, ramping, streaming, holding: the bridge asks before every command."""
    rig = Rig(estop_action=action, input_timeout=0.1)
    button = Pressed(rig)
    rig.stream(min(seconds, 2.0)).run(max(seconds - 2.0, 0.0))
    speed = np.abs(rig.bridge.command_velocity)
    button.reason = 'pressed'
    rig.run(1 / RATE)
    assert rig.bridge.state is State.ESTOP and rig.bridge.reason == 'pressed'
    assert rig.motors.torque is (action == 'brake')
    np.testing.assert_allclose(np.abs(rig.bridge.command_velocity), np.maximum(speed - 20.0 / RATE, 0), atol=1e-6)
    button.reason = ''
    rig.run(0.5)
    assert rig.bridge.state is State.ESTOP      # latched
    assert not rig.bridge.moving


def test_a_button_pressed_while_torque_comes_on_leaves_it_off():
    rig = Rig(armed=False)
    button = Pressed(rig)
    rig.motors.enabling = lambda: setattr(button, 'reason', 'pressed')
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.arm(rig.now)
    assert rig.bridge.state is State.DISARMED and not rig.motors.torque
    with pytest.raises(UsageError, match='still pressed'):
        rig.bridge.arm(rig.now)


@pytest.mark.parametrize('action', ['brake', 'torque_off'])
def test_a_button_pressed_during_a_reset_stops_before_the_next_command(action):
    rig = Rig(estop_action=action).stream(2.0)
    button = Pressed(rig)
    rig.bridge.estop(rig.now)
    rig.run(0.5)
    rig.motors.enabling = lambda: setattr(button, 'reason', 'pressed')
    rig.bridge.reset(rig.now)
    with contextlib.suppress(MotionError):
        rig.wave()
    at = rig.bridge.command.copy()
    rig.run(0.5)
    assert rig.bridge.state is State.ESTOP and rig.motors.torque is (action == 'brake')
    np.testing.assert_array_equal(rig.bridge.command, at)


def test_a_button_pressed_while_the_bridge_is_deactivated_counts():
    rig = Rig(estop_action='torque_off').stream(2.0)
    button = Pressed(rig)
    clock = iter(np.arange(1000) * 0.005)
    rig.bridge.stop(0.0, clock=lambda: next(clock), sleep=lambda s: setattr(button, 'reason', 'pressed'))
    assert not rig.motors.torque and rig.bridge.moving      # torque went off at once, in the middle of braking


def test_trajectories_sent_while_stopped_are_refused_counted_and_never_played_later():
    rig = Rig().stream(2.0)
    rig.send([0.5], [[0.4, 0.4]], delay=0.3)        # waits for its start
    button = Pressed(rig)
    button.reason = 'pressed'
    rig.run(0.1)
    for delay in (0.0, 0.5, 1.5):
        with pytest.raises(MotionError, match='ESTOP: call reset first'):
            rig.send([0.5], [[0.4, 0.4]], delay=delay)
    assert rig.bridge.rejections == {'wrong state': 3} and rig.bridge.counts['rejected'] == 3
    button.reason = ''
    rig.run(0.5)
    rig.bridge.reset(rig.now)
    at = rig.bridge.command.copy()
    rig.run(2.0)
    np.testing.assert_array_equal(rig.bridge.command, at)


@given(seed=st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=60, deadline=None)
def test_nothing_arms_or_moves_while_pressed_whatever_happens_in_which_order(seed):
    rng = np.random.default_rng(seed)
    rig = Rig(estop_action=str(rng.choice(['brake', 'torque_off'])), hold_timeout=0.2,
              hold_policy=str(rng.choice(['hold', 'relax', 'fault'])), input_timeout=0.1)
    button, bridge = Pressed(rig), rig.bridge

    def press():
        button.reason = 'pressed'

    def arm():
        torque, pressed = rig.motors.torque, bool(button.reason)
        rig.motors.enabling = press if rng.random() < 0.3 else lambda: None
        with contextlib.suppress(UsageError, BackendFault):
            bridge.arm(rig.now) if bridge.state is State.DISARMED else bridge.reset(rig.now)
            assert not pressed
        assert not pressed or rig.motors.torque is torque

    def disarm():
        bridge.stop(rig.now, clock=lambda: 0.0, sleep=lambda s: None)
        bridge.disarm(rig.now)
        assert not rig.motors.torque

    def move():
        with contextlib.suppress(MotionError):
            rig.wave() if rng.random() < 0.7 else rig.send([0.3], [[0.4, 0.4]], delay=float(rng.choice([0.0, 0.2])))

    def fail():
        rig.motors.fault = BackendFault('gone') if rng.random() < 0.5 else None
    for _ in range(80):
        rng.choice([press, lambda: setattr(button, 'reason', ''), arm, arm, disarm, move, move, move, fail])()
        for _ in range(int(rng.integers(1, 12))):
            if rng.random() < 0.1:
                press()
            before, ready = np.abs(bridge.command_velocity), bridge.state not in STOPPED
            rig.run(1 / RATE)
            if button.reason:
                assert bridge.state in STOPPED and (not ready or bridge.state in (State.ESTOP, State.FAULT))
                assert np.all(np.abs(bridge.command_velocity) <= np.maximum(before - 20.0 / RATE, 0) + 1e-9)


# --- what a stopped joint presses with ---------------------------------------------------------------------------


def test_after_does_not_follow_the_joint_holds_where_it_is_blocked():
    rig = Rig()
    rig.motors.stuck = 0.1
    rig.send([1.0], [[0.9, 0.0]])
    rig.run(1.5)
    assert rig.bridge.state is State.FAULT and 'hip does not follow' in rig.bridge.reason
    assert abs(rig.bridge.command[0] - 0.1) < 1e-9 and not rig.bridge.moving
    rig.stays_within_limits()
    rig.motors.stuck = None         # and nothing springs when it is free
    at = rig.bridge.command.copy()
    rig.run(1.0)
    np.testing.assert_array_equal(rig.bridge.command, at)


@given(seed=st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=60, deadline=None)
def test_a_stopped_joint_never_goes_on_pressing_with_more_than_it_may(seed):
    """Walls come up at any time and push the joints anywhere; the commands stay continuous and within the limits."""
    rng = np.random.default_rng(seed)
    press = float(rng.uniform(0.01, 0.2))
    rig = Rig(hold_error=press, input_timeout=0.1, fault_action='brake', following_time=0.1,
              hold_policy=str(rng.choice(['hold', 'fault'])), hold_timeout=0.3)
    rig.stream(float(rng.uniform(0.0, 2.0)))
    for _ in range(4):
        middle, width = rng.uniform(-0.9, 0.9, 2), rng.uniform(0.0, 1.0, 2)
        rig.motors.wall = np.array([middle - width, middle + width])
        if rng.random() < 0.4:
            rig.bridge.estop(rig.now)
        with contextlib.suppress(MotionError):
            rig.wave()
        rig.run(float(rng.uniform(0.0, 0.5)))
    rig.run(0.1)
    if rig.bridge.state is State.READY:
        rig.bridge.estop(rig.now)
    rig.run(3.0)
    assert rig.bridge.state in (State.HOLDING, State.ESTOP, State.FAULT) and rig.motors.torque
    assert np.all(np.abs(rig.bridge.command - rig.motors.posture) <= press + 1e-9)
    assert not rig.bridge.moving
    rig.stays_within_limits()


def test_a_joint_that_sags_by_less_does_not_creep():
    rig = Rig(hold_error=0.1)
    rig.bridge.estop(rig.now)
    rig.motors.wall = np.array([START - 0.09, START - 0.09])
    rig.run(60.0)
    np.testing.assert_allclose(rig.bridge.command, START, atol=1e-12)


def test_braking_comes_before_giving_way():
    """A joint lags behind a fast command: the command brakes to a stand, and waits for the joint."""
    rig = Rig(hold_error=0.05, following_time=0.3).stream(2.0)
    rig.motors.wall = np.array([rig.motors.posture - 0.2, rig.motors.posture - 0.2])
    rig.bridge.estop(rig.now)
    before = np.sign(rig.bridge.command_velocity)
    while rig.bridge.moving:
        rig.run(1 / RATE)
        assert np.all(rig.bridge.command_velocity * before >= 0)
    stood = rig.bridge.command.copy()
    rig.run(0.25)
    np.testing.assert_array_equal(rig.bridge.command, stood)
    rig.run(1.0)
    np.testing.assert_allclose(rig.bridge.command - rig.motors.posture, 0.05, atol=1e-9)
    rig.stays_within_limits()


def test_nothing_gives_way_to_a_measurement_that_is_not_fresh():
    rig = Rig()
    rig.bridge.estop(rig.now)
    rig.motors.wall = np.array([START - 0.5, START - 0.5])
    rig.motors.answers = False
    rig.run(2.0)
    np.testing.assert_allclose(rig.bridge.command, START, atol=1e-12)


# --- errors of the program ------------------------------------------------------------------------------------


def test_an_error_in_the_back_end_is_a_fault_and_no_end():
    rig = Rig().stream(2.0)
    rig.motors.fault = ValueError('could not broadcast')
    rig.run(0.2)
    assert rig.bridge.state is State.FAULT and 'could not broadcast' in rig.bridge.reason
    assert rig.bridge.counts['internal errors'] == 40
    rig.motors.fault = None
    rig.run(0.2)        # goes on braking and holding
    rig.bridge.reset(rig.now)
    assert rig.bridge.state is State.READY and rig.motors.connected == 2    # everything checked anew
    rig.stays_within_limits()


def test_an_error_in_the_reference_brakes_within_the_limits():
    rig = Rig().stream(2.0)
    rig.bridge._playback.sample = None      # not callable
    rig.run(0.5)
    assert rig.bridge.state is State.FAULT and 'TypeError' in rig.bridge.reason and not rig.bridge.moving
    rig.stays_within_limits()


def test_who_looks_on_keeps_no_command_from_being_sent():
    rig = Rig().stream(1.0)
    sent = len(rig.motors.sent)

    def trace(*row):
        raise OSError('no space')
    rig.bridge.trace = trace
    rig.stream(1.0)
    assert len(rig.motors.sent) == sent + 200 and rig.bridge.state is State.STREAMING
    assert rig.bridge.counts['internal errors'] == 1
