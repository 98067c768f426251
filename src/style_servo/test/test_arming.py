"""Before torque comes on, and when it does: what is believed, what is refused, and what is said."""
import contextlib
import logging
import os
import termios
import tty

import numpy as np
import pytest
from test_bus_faults import IDS, JOINTS, PERIOD, Port
from test_dynamixel_backend import backend_for, joints, refuses, run

from style_core.stream.health import WARN
from style_servo.backend import BackendFault
from style_servo.bridge import Bridge, BridgeSettings
from style_servo.bridge_health import CycleTimes, health_of_bridge
from style_servo.chain import Chain, Joint
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
from style_servo.serial_port import SerialPort

TURN = 2 * np.pi
MODEL = 'XM430-W350'


def on_line(line, chain_joints=JOINTS, **settings):
    return DynamixelBackend(Chain(tuple(chain_joints)), BusSettings('line', **settings), PERIOD, lambda *_: line)


# --- the port belongs to one ---------------------------------------------------------------------------------------


def test_a_bridge_that_does_not_own_the_port_sends_not_one_byte():
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    name = os.ttyname(slave)
    owner = SerialPort(name, 1000000)
    settings = termios.tcgetattr(slave)
    second = DynamixelBackend(Chain(tuple(joints(4))), BusSettings(name, baud=57600), PERIOD)
    for attempt in (second.connect, second.connect):
        with pytest.raises(BackendFault, match='another program uses it'):
            attempt()
    second.close()
    assert second.disable() is False
    with pytest.raises(BackendFault, match='not open'):
        second.observe()
    with pytest.raises(BackendFault):
        second.exchange(np.zeros(4), np.zeros(4))
    second.close()
    with pytest.raises(BlockingIOError):
        os.read(master, 1)
    assert termios.tcgetattr(slave) == settings       # nor its speed
    owner.send(b'mine')
    assert os.read(master, 100) == b'mine'
    owner.close()
    os.close(master)
    os.close(slave)


def test_a_second_bridge_leaves_the_running_robot_standing(simulate):
    simulator = simulate('--servos', f'1-4:{MODEL}')
    first = backend_for(simulator, joints(4), watchdog=2.5, error_run=1000)
    first.connect()
    first.enable()
    second = backend_for(simulator, joints(4), baud=57600)
    refuses(second, 'another program uses it')
    second.close()
    run(first, np.full(4, 0.1), 0.2)
    assert all(servo['torque'] and not servo['halted'] for servo in simulator.tell('state')['servos'])
    first.close()


def test_a_port_that_fails_to_open_for_another_reason_is_not_written_to_either(tmp_path, monkeypatch):
    sent = []
    monkeypatch.setattr(os, 'write', lambda *arguments: sent.append(arguments))
    (tmp_path / 'file').write_text('')
    backend = DynamixelBackend(Chain(tuple(joints(1))), BusSettings(str(tmp_path / 'file')), PERIOD)
    refuses(backend, 'not a serial port')
    backend.close()
    assert sent == []


# --- what a posture is believed on ---------------------------------------------------------------------------------


@pytest.mark.parametrize('glitch', range(1, 16))
def test_one_glitched_reading_never_becomes_the_goal(glitch):
    line = Port(IDS)
    line.position_of = lambda request, servo_id: 1657 if request == glitch and servo_id == 2 else 2048
    backend = on_line(line)
    backend.connect()
    line.goals.clear()
    backend.enable()
    assert line.goals and all(goal == 2048 for _, goal in line.goals)
    np.testing.assert_allclose(backend.measurement.position, 0.0)


def test_a_joint_that_moves_is_not_switched_on():
    line = Port(IDS)
    line.position_of = lambda request, servo_id: 2000 + (10 * request if servo_id == 3 else 0)
    backend = on_line(line)
    backend.connect()
    with pytest.raises(BackendFault, match='joint_3 does not stand still'):
        backend.enable()
    assert not any(servo.memory[64] for servo in line.servos.values())


@pytest.mark.parametrize('counts, lower', [(-20, -np.pi), (4100, -1.0), (2048 + 4096, -1.0)])
def test_a_joint_beyond_its_turn_is_refused_before_torque(simulate, counts, lower):
    """Torque on takes the servo back into one turn: the goal would be a turn away."""
    simulator = simulate('--servos', f'1-2:{MODEL}')
    chain = [Joint('a', lower, np.pi - 0.01, 3.0, 20.0, id=1, model=MODEL), joints(2)[1]]
    backend = backend_for(simulator, chain)
    backend.connect()
    simulator.tell('place', id=1, radians=(counts + 0.1) * TURN / 4096)
    with pytest.raises(BackendFault, match=rf'joint a .*position value {counts}, outside its turn of 0 to 4095'):
        backend.enable()
    assert not any(servo['torque'] for servo in simulator.tell('state')['servos'])
    backend.close()


def test_a_servo_that_counts_anew_when_torque_comes_on_is_let_go():
    line = Port(IDS)
    line.position_of = lambda request, servo_id: 3000 if servo_id == 2 and line.servos[2].memory[64] else 2048
    backend = on_line(line)
    backend.connect()
    with pytest.raises(BackendFault, match=r'joint_2 stood at .* counts its turn anew'):
        backend.enable()
    assert not any(servo.memory[64] for servo in line.servos.values())


def test_a_joint_outside_its_limits_is_not_pulled_inside():
    line = Port(IDS)
    line.position_of = lambda request, servo_id: 2048 + 1100
    backend = on_line(line)
    backend.connect()
    with pytest.raises(BackendFault, match='rad outside its limits'):
        backend.enable()
    assert not any(servo.memory[64] for servo in line.servos.values())


# --- what turns and shifts a servo's scale -------------------------------------------------------------------------


def test_reverse_and_homing_offset_are_compared_with_the_chain_file(simulate):
    simulator = simulate('--servos', f'1:{MODEL}')
    simulator.tell('set', id=1, item='Drive Mode', value=1)
    refuses(backend_for(simulator, joints(1)), 'joint_1 (ID 1', 'Drive Mode (1)', 'in reverse', 'reverse: false')
    refuses(backend_for(simulator, joints(1, reverse=True, homing_offset=5)), 'Homing Offset is 0', 'homing_offset: 5')
    simulator.tell('set', id=1, item='Drive Mode', value=0)
    refuses(backend_for(simulator, joints(1, reverse=True)), 'the normal way', 'reverse: true')
    simulator.tell('set', id=1, item='Homing Offset', value=-300)
    refuses(backend_for(simulator, joints(1)), 'Homing Offset is -300', 'homing_offset: 0', '0.460 rad')
    backend = backend_for(simulator, joints(1, homing_offset=-300))
    backend.connect()
    fact = backend.facts['joint_1: model, firmware, Drive Mode, Homing Offset']
    assert fact == f'{MODEL}, 48, 0, -300'
    backend.close()
    simulator.tell('set', id=1, item='Homing Offset', value=1500)
    refuses(backend_for(simulator, joints(1, homing_offset=1500)), 'beyond 1024 counts', 'ignores')


def test_a_reversed_servo_turns_its_joint_the_way_the_chain_file_says(simulate):
    simulator = simulate('--servos', f'1:{MODEL}')
    simulator.tell('set', id=1, item='Drive Mode', value=1)
    simulator.tell('reboot', id=1)      # it counts in the new direction from then on
    backend = backend_for(simulator, joints(1, reverse=True, sign=-1), watchdog=2.5, error_run=1000)
    for _ in range(10):
        with contextlib.suppress(BackendFault):     # it is silent while it starts
            backend.connect()
            break
    backend.enable()
    np.testing.assert_allclose(run(backend, np.array([0.5]), 0.7), 0.5, atol=0.005)
    # reverse and sign together: the horn turns as the joint does
    assert abs(simulator.servo(1)['position'] - np.pi - 0.5) < 0.01
    backend.close()


def test_drive_mode_bits_that_are_unsafe(simulate):
    simulator = simulate('--servos', f'1:{MODEL},2:XM540-W270')
    chain = [joints(1)[0], Joint('b', -1.0, 1.0, 1.0, 10.0, id=2, model='XM540-W270')]
    simulator.tell('set', id=1, item='Drive Mode', value=0x0C)
    backend = backend_for(simulator, chain)
    backend.connect()
    assert any('let any goal switch torque on' in note for note in backend.notes)
    assert backend.bus.setup.read(backend.bus.servos[0], 'Drive Mode') == 0
    backend.close()
    simulator.tell('set', id=2, item='Drive Mode', value=0x02)
    refuses(backend_for(simulator, chain), 'joint b', 'slave')


# --- why nothing comes ---------------------------------------------------------------------------------------------


def test_firmware_without_fast_sync_read_is_named():
    line = Port(IDS, firmware=40)
    backend = on_line(line)
    refuses(backend, 'joint_1 (ID 1, XM430-W350) has firmware 40', 'Fast Sync Read needs firmware 45', 'fast_read')
    patient = on_line(line, fast_read=False)
    line.position_of = lambda request, servo_id: 2048
    patient.connect()
    patient.enable()


@pytest.mark.parametrize('fast_read', [False, True])
def test_the_latency_of_an_adapter_is_named_without_the_systems_help(fast_read):
    line = Port(IDS)
    line.latency = 0.016
    line.position_of = lambda request, servo_id: 2048
    backend = on_line(line, fast_read=fast_read)
    refuses(backend, 'replies come 16 ms later', 'reply_timeout is 4 ms', 'latency timer')
    patient = on_line(line, fast_read=fast_read, reply_timeout=0.02)
    patient.connect()
    patient.enable()


def test_firmware_without_bus_watchdog_is_refused_and_no_torque_is_feared(caplog):
    line = Port(IDS, firmware=37)
    with caplog.at_level(logging.WARNING):
        refuses(on_line(line), 'joint_1 (ID 1, XM430-W350) has firmware 37', 'no Bus Watchdog', '38')
    assert 'torque may still be on' not in caplog.text


def test_torque_that_was_let_go_is_not_feared_for_the_watchdogs_sake(simulate, caplog):
    """Only what Torque Enable says decides."""
    simulator = simulate('--servos', f'1-2:{MODEL}')
    backend = backend_for(simulator, joints(2))
    backend.connect()
    backend.enable()
    simulator.tell('set', id=1, item='Firmware Version', value=37)      # its watchdog register is gone
    with caplog.at_level(logging.WARNING):
        assert backend.disable() is True
    assert 'torque may still be on' not in caplog.text
    backend.close()


@pytest.mark.parametrize('seed', range(10))
def test_no_number_of_another_packet_is_shown_as_a_goal(seed):
    """Replies 30 ms late, as an adapter that stutters hands them over."""
    line = Port(IDS, seed, likely=0.2)
    line.kinds, line.spoiling = ('late', 'later'), True
    line.position_of = lambda request, servo_id: 2048
    backend = on_line(line)
    try:
        backend.connect()
        backend.enable()
    except BackendFault as error:
        assert 'after writing' not in str(error)
    assert set(line.goals) <= {(servo_id, 2048) for servo_id in IDS}


# --- before a servo shuts down -------------------------------------------------------------------------------------


@pytest.mark.parametrize('upset, words', [
    ({'do': 'heat', 'id': 2, 'celsius': 78}, ('joint_2', 'deg C', 'shuts down at 80')),
    ({'do': 'set', 'id': 1, 'item': 'Present Input Voltage', 'value': 98}, ('joint_1', '9.8 V', 'below 9.5')),
    ({'do': 'set', 'id': 1, 'item': 'Present Input Voltage', 'value': 158}, ('joint_1', '15.8 V', 'above 16.0'))])
def test_a_servo_about_to_shut_down_is_told_in_time(simulate, upset, words):
    simulator = simulate('--servos', f'1-2:{MODEL}')
    backend = backend_for(simulator, joints(2), watchdog=2.5, error_run=1000)
    backend.connect()
    backend.enable()
    assert backend.warnings == []
    simulator.tell(**upset)
    end = 300
    while not backend.warnings and end:
        run(backend, np.zeros(2), 0.02)
        end -= 1
    assert all(word in backend.warnings[0] for word in words), backend.warnings
    bridge = Bridge(Chain(tuple(joints(2))), backend, BridgeSettings())
    health = health_of_bridge(bridge, CycleTimes(PERIOD), 0, 0.0)
    assert health.level == WARN and words[0] in health.summary and health.facts['warning 1'] == backend.warnings[0]
    backend.close()


def test_a_servo_that_pushes_hard_is_told_before_it_overloads(simulate):
    simulator = simulate('--servos', f'1-2:{MODEL}')
    backend = backend_for(simulator, joints(2), watchdog=2.5, error_run=1000)
    backend.connect()
    backend.enable()
    backend.bus._health.feel(np.array([0.0, 3.2]))
    for _ in range(1000):
        backend.bus._health.feel(np.array([0.0, 3.2]))      # A; the Current Limit is 1193 times 2.69 mA
    assert len(backend.warnings) == 1 and 'joint_2' in backend.warnings[0] and 'overload' in backend.warnings[0]
    backend.close()
