"""The simulated bus, judged by rustypot: a client and register tables that neither we nor the manufacturer wrote."""
import math

import pytest

from style_servo.control_ranges import rules
from style_servo.control_table import control_table, model_named

# not skipped on import: where launch_testing collects, that would skip every file of the folder
try:
    import rustypot
except ImportError:
    rustypot = None
pytestmark = pytest.mark.skipif(rustypot is None, reason='rustypot is not installed (requirements/ros_prefix.txt)')

# rustypot's name -> the manufacturer's, where capitals alone do not tell
NAMES = {'id': 'ID', 'led': 'LED', 'secondary_id': 'Secondary(Shadow) ID', 'pwm_limit': 'PWM Limit',
         'goal_pwm': 'Goal PWM', 'present_pwm': 'Present PWM', 'pwm_slope': 'PWM Slope',
         'feedforward_2nd_gain': 'Feedforward 2nd Gain',
         'feedforward_1st_gain': 'Feedforward 1st Gain'}
TIMEOUT = 0.5       # s, for a simulator that shares the processor


def named(register):
    return NAMES.get(register.name) or register.name.replace('_', ' ').title()


@pytest.fixture
def chain(simulate):
    simulator = simulate('--servos', '1-3:XL430-W250')
    client = rustypot.Xl430PyController(simulator.link, 1000000, TIMEOUT)
    yield client, simulator
    client.close()


@pytest.mark.parametrize('controller, model', [('Xl430PyController', 'XL430-W250'), ('Xl330PyController', 'XL330-M288'),
                                               ('Xl430PyController', 'XM430-W350')])
def test_the_tables_agree(controller, model):
    number = model_named(model)
    table, known = control_table(number), rules(number)
    compared = 0
    for register in getattr(rustypot, controller).registers():
        name = named(register)
        if name not in table or (model == 'XM430-W350' and name == 'Present Load'):
            continue
        item = table[name]
        assert (item.address, item.size) == (register.addr, register.size), name
        if name in known and register.access == rustypot.RegisterAccess.Read:
            assert not known[name].writable, name
        compared += 1
    assert compared > 45


def test_finding(chain):
    client, _ = chain
    assert client.ping(2) and not client.ping(9)
    assert client.scan([1, 2, 3, 4]) == {1: 1060, 2: 1060, 3: 1060}
    assert client.broadcast_scan() == {1: 1060, 2: 1060, 3: 1060}


def test_every_register_that_it_knows_can_be_read_and_shows_what_is_new(chain):
    client, _ = chain
    number = model_named('XL430-W250')
    known, table = rules(number), control_table(number)
    read = 0
    for register in client.registers():
        name = named(register)
        if name not in table:
            continue
        value, error = client.read_register_with_error(2, register.name)
        assert error == 0, name
        if name in known and known[name].initial is not None and name not in ('ID', 'Baud Rate'):
            assert value == known[name].initial, name
        read += 1
    assert read > 45


@pytest.mark.parametrize('name, value, error', [
    ('operating_mode', 5, 4), ('operating_mode', 16, 0), ('pwm_limit', 886, 4), ('velocity_limit', 1024, 4),
    ('max_voltage_limit', 141, 4), ('homing_offset', -1044480, 4), ('homing_offset', -1044479, 0),
    ('position_p_gain', 16384, 4), ('position_p_gain', 16383, 0), ('goal_velocity', 300, 6), ('goal_velocity', -265, 0),
    ('goal_position', 4096, 6), ('moving', 1, 7), ('model_number', 1, 7), ('indirect_address_1', 63, 4),
    ('indirect_address_1', 64, 0), ('bus_watchdog', 128, 4)])
def test_what_a_register_answers(chain, name, value, error):
    client, _ = chain
    register = client.register(name)
    data = list((value & (1 << 8 * register.size) - 1).to_bytes(register.size, 'little'))
    assert client.write_raw_data_with_error(1, register.addr, data) == error
    if not error:
        assert client.read_register(1, name) == value


def test_undefined_addresses(chain):
    client, _ = chain
    for address in (14, 66, 99, 147, 253):
        assert client.write_raw_data_with_error(1, address, [0]) == 7
        assert client.read_raw_data_with_error(1, address, 1)[1] == 7


def test_driving_three_servos_with_sync_writes_and_both_kinds_of_sync_read(chain):
    client, simulator = chain
    ids, goals = [1, 2, 3], [1500, 2048, 2700]
    client.sync_write_register(ids, 'torque_enable', [1, 1, 1])
    client.sync_write_register(ids, 'goal_position', goals)
    simulator.until(lambda state: all(abs(servo['position'] - goal * 2 * math.pi / 4096) < 0.003
                                      and abs(servo['velocity']) < 0.001
                                      for servo, goal in zip(state['servos'], goals)), 5.0)
    slow = client.sync_read_register_with_error(ids, 'present_position')
    client.set_fast_sync_read(True)
    fast = client.sync_read_register_with_error(ids, 'present_position')
    for (position, error), (again, none), goal in zip(slow, fast, goals):
        assert error == none == 0 and abs(position - goal) <= 2 and abs(again - goal) <= 2
    client.set_fast_sync_read(False)
    client.write_indirect_address_1(1, 65)
    client.write_indirect_data_1(1, 1)
    assert client.read_register(1, 'led') == 1
