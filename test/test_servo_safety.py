"""Safety over real middleware with the simulated bus: hostile input, killed processes, emergency stop."""
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from servo_rig import DEEP, ServoRig, sender_program
from std_msgs.msg import Bool

from style_servo.control_table import control_table, model_named
from style_servo.hostile import KINDS, hostile_fields, legal_fields
from style_servo.record import read_record, violations
from style_servo.recorder import runs_of
from style_servo.states import State

HOSTILE = 1500      # benchmarks/experiments/servo_safety.py sends 100,000


@pytest.fixture
def rig(tmp_path, request):
    options = getattr(request, 'param', {})
    rig = ServoRig(str(tmp_path), **options)
    yield rig
    rig.close()


def judged(rig):
    """The flight record, after the bridge has ended; no command may be outside a limit."""
    record = read_record(rig.record)
    counts = violations(record)
    assert {name: count for name, count in counts.items() if name != 'commands' and count} == {}, counts
    return record


@pytest.mark.parametrize('rig', [DEEP], indirect=True, ids=[''])
def test_hostile_trajectories_move_nothing_outside_the_limits(rig):
    rig.up()
    rng = np.random.default_rng(0)
    kinds = list(KINDS)
    for k in range(HOSTILE):
        now = time.monotonic()
        legal = k % 3 == 0
        rig.send(legal_fields(rig.chain, now) if legal else
                 hostile_fields(rig.chain, now, kinds[int(rng.integers(len(kinds)))], rng))
        if k % 500 == 250:       # a flood of 10 kHz
            fields = legal_fields(rig.chain, now)
            for _ in range(300):
                rig.send(fields)
                time.sleep(1e-4)
        rig.spin(0.003)
    rig.stream_until(State.STREAMING)        # alive and well afterwards
    rig.until(lambda: rig.states[-1].accepted + rig.states[-1].rejected >= HOSTILE, 60)
    assert rig.states[-1].accepted > HOSTILE / 5 and rig.states[-1].rejected > HOSTILE / 4
    rig.close()
    record = judged(rig)
    assert np.ptp(record.command, axis=0).min() > 0.2        # it did move
    # and what arrived at the servos: position values inside the limits
    wire = Path(rig.wire).read_text().splitlines()
    goals = [json.loads(line)[1] for line in wire]
    assert len(goals) > HOSTILE / 10
    for joint in rig.chain.joints:
        unit = control_table(model_named(joint.model)).position_unit
        values = np.array([goal[str(joint.id)] for goal in goals if str(joint.id) in goal])
        angles = joint.sign * ((values - 2048) * unit - joint.offset)
        assert angles.min() >= joint.lower - 1e-9 and angles.max() <= joint.upper + 1e-9


@pytest.mark.parametrize('rig', [{'input_timeout': 3.0}], indirect=True, ids=[''])
def test_a_motion_faster_than_the_joints_is_followed_without_falling_out_of_step(rig):
    """Twice the speed that the limits allow: clamped, lagging, never HOLDING; then a calm end is reached exactly."""
    rig.up()
    chain = rig.chain
    middle, span = (chain.array('upper') + chain.array('lower')) / 2, chain.array('upper') - chain.array('lower')
    amplitude = 0.3 * span
    frequency = 2.0 * chain.array('velocity') / amplitude

    def window():
        times = np.linspace(0.0, 0.5, 40)
        angle = frequency * (time.monotonic() + times)[:, None] + np.arange(len(middle))
        rig.send({'names': list(chain.names), 'times': times, 'positions': middle + amplitude * np.sin(angle),
                  'velocities': amplitude * frequency * np.cos(angle), 'stamp': 1e-6})      # late messages are no jumps
    rig.until(lambda: rig.state is State.STREAMING, 20, window)
    end = time.monotonic() + 3.0
    rig.until(lambda: time.monotonic() > end, 20, window)
    rig.until(lambda: any('asks for more' in message.status[0].message for message in rig.diagnostics), 10, window)
    assert rig.states[-1].clamped > 100
    rig.send({'names': list(chain.names), 'times': np.array([2.0]), 'positions': middle[None], 'velocities': None,
              'stamp': 0.0})
    rig.wait_for(State.READY)
    assert max(abs(a - b) for a, b in zip(rig.states[-1].commanded, middle)) < 1e-6
    rig.close()
    record = judged(rig)
    assert State.HOLDING not in record.state, rig.log()
    assert np.ptp(record.command, axis=0).min() > 0.1, np.ptp(record.command, axis=0)
    # targets before the limiter: never far outside the motion's own range and the posture at the beginning
    outside = np.maximum(record.target - np.maximum(middle + amplitude, record.command[0]),
                         np.minimum(middle - amplitude, record.command[0]) - record.target)
    assert outside.max() < 0.25, outside.max(axis=0)


@pytest.mark.parametrize('rig', [{'input_timeout': 0.3}], indirect=True, ids=[''])
def test_a_killed_sender_leads_to_a_hold_in_time_and_no_jump_on_its_return(rig):
    rig.up()

    def start():
        return subprocess.Popen([sys.executable, '-c', sender_program(rig.chain_path)])
    sender = start()
    try:
        rig.wait_for(State.STREAMING, 40)
        rig.spin(0.5)
        sender.send_signal(signal.SIGKILL)
        sender.wait()
        killed = time.monotonic()
        rig.wait_for(State.HOLDING)
        assert time.monotonic() - killed < 0.3 + 0.4      # the time-out, and news of the state
        rig.spin(0.5)
        commands = np.array([message.position for message in rig.commands[-20:]])
        assert np.ptp(commands, axis=0).max() == 0
        sender = start()
        rig.wait_for(State.STREAMING, 40)
        rig.spin(0.5)
    finally:
        sender.kill()
        sender.wait()
    rig.close()
    record = judged(rig)
    assert {State.RAMPING, State.STREAMING, State.HOLDING} <= {State(state) for state in record.state}


@pytest.mark.parametrize('rig', [{'watchdog': 0.2}], indirect=True, ids=[''])
def test_a_killed_bridge_leaves_servos_that_stop_and_a_new_one_takes_over_without_a_jump(rig):
    rig.up()
    rig.stream_until(State.STREAMING)
    rig.stream(0.3)
    rig.bridge.kill()
    rig.bridge.wait()
    killed = time.monotonic()
    rig.until(lambda: all(servo['halted'] for servo in rig.tell('state')['servos']))
    assert time.monotonic() - killed < 0.2 + 0.4
    judged(rig)
    crash = {path: path.read_bytes() for path in runs_of(rig.record)[1]}
    rig.spin(0.3)
    before = [servo['position'] for servo in rig.tell('state')['servos']]
    rig.spin(0.3)
    rest = rig.tell('state')['servos']
    assert all(abs(servo['position'] - was) < 1e-3 for servo, was in zip(rest, before))
    rig.states.clear()
    rig.bridge = rig.start_bridge()
    rig.up()
    np.testing.assert_allclose([servo['position'] for servo in rig.tell('state')['servos']], before, atol=0.02)
    rig.stream_until(State.STREAMING)
    # its record is another one
    assert {path: path.read_bytes() for path in runs_of(rig.record)[1]} == crash and 2 in runs_of(rig.record)


@pytest.mark.parametrize('by', ['service', 'topic'])
def test_an_emergency_stop_brakes_within_one_cycle(rig, by):
    rig.up()
    rig.stream_until(State.STREAMING)
    rig.stream(0.5)
    if by == 'service':
        assert rig.trigger('estop').success
    else:
        rig.estop.publish(Bool(data=True))
    rig.wait_for(State.ESTOP)
    rig.stream(0.3)          # nothing is taken now
    assert rig.state is State.ESTOP
    if by == 'topic':
        answer = rig.trigger('reset')
        assert not answer.success and 'still pressed' in answer.message
        rig.estop.publish(Bool(data=False))
        rig.until(lambda: not rig.states[-1].estop_held)
    assert rig.trigger('reset').success
    rig.stream_until(State.STREAMING)
    rig.close()
    record = judged(rig)
    # every joint slows down from the very first command in ESTOP, as hard as its limit allows
    first = int(np.argmax(record.state == State.ESTOP))
    period = record.limits['period']
    before, after = np.diff(record.command[first - 2:first + 1], axis=0) / period
    np.testing.assert_allclose(np.abs(after), np.maximum(np.abs(before) - record.limits['acceleration'] * period, 0),
                               atol=1e-6)


def test_stopping_the_program_brakes_and_switches_torque_off(rig):
    rig.up()
    rig.stream_until(State.STREAMING)
    rig.stream(0.3)
    rig.bridge.send_signal(signal.SIGTERM)
    rig.bridge.wait(20)
    assert not any(servo['torque'] for servo in rig.tell('state')['servos'])
    judged(rig)
