"""The Dynamixel back end against the simulated bus: every setting, every way to fail, each with its own message."""
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from style_core.errors import UsageError
from style_servo.backend import BackendFault
from style_servo.chain import Chain, Joint
from style_servo.control_table import control_table, model_named
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend

PERIOD = 0.01
MODEL = 'XM430-W350'


def joints(n, model=MODEL, **changes):
    return [Joint(f'joint_{k}', -2.0, 2.0, 3.0, 20.0, id=k, model=model, **changes) for k in range(1, n + 1)]


def backend_for(simulator, chain_joints, **settings):
    return DynamixelBackend(Chain(tuple(chain_joints)), patient(simulator, **settings), PERIOD)


def patient(simulator, **settings):
    """Settings for a busy machine, where a reply can wait for the simulator's turn."""
    return BusSettings(simulator.link, reply_timeout=0.02, **settings)


@pytest.fixture
def connected(simulate):
    simulator = simulate('--servos', f'1-4:{MODEL}')
    backend = backend_for(simulator, joints(4), watchdog=1.0)
    backend.connect()
    yield backend, simulator
    backend.close()


def run(backend, command, seconds):
    """Command a posture for a while, and until an answer comes; returns the last measured positions."""
    end = time.monotonic() + seconds
    while time.monotonic() < end or not backend.measurement.fresh:
        backend.exchange(command, np.zeros(len(command)))
        time.sleep(PERIOD / 2)
    return backend.measurement.position


@pytest.mark.parametrize('fast_read', [True, False])
def test_a_mixed_chain_is_configured_driven_and_released(simulate, fast_read):
    simulator = simulate('--servos', '1:XM430-W350,2:XL430-W250,3:XL330-M288,4:MX-28')
    chain = [Joint('a', -2.0, 2.0, 3.0, 20.0, id=1, model='XM430-W350-R', sign=-1),
             Joint('b', -1.0, 1.5, 3.0, 20.0, id=2, model='XL430-W250', offset=0.4),
             Joint('c', -2.0, 2.0, 3.0, 20.0, id=3, model='XL330-M288', position_p_gain=900),
             Joint('d', -2.0, 2.0, 3.0, 20.0, id=4, model='MX-28')]
    backend = backend_for(simulator, chain, fast_read=fast_read)
    backend.connect()
    assert not any(servo['torque'] for servo in simulator.tell('state')['servos'])
    backend.enable()
    np.testing.assert_allclose(backend.measurement.position, [0, -0.4, 0, 0], atol=0.002)
    command = np.array([0.5, 0.7, -0.3, 1.0])
    measured = run(backend, command, 0.7)
    np.testing.assert_allclose(measured, command, atol=0.004)
    servos = simulator.tell('state')['servos']
    middle = 2048 * 2 * np.pi / 4096
    np.testing.assert_allclose([servo['position'] - middle for servo in servos], [-0.5, 1.1, -0.3, 1.0], atol=0.004)
    assert all(servo['torque'] and servo['watchdog'] == 5 for servo in servos)
    np.testing.assert_allclose(backend.measurement.velocity, 0, atol=0.05)
    backend.close()
    assert not any(servo['torque'] for servo in simulator.tell('state')['servos'])


@pytest.mark.parametrize('model', ['PH42-020-S300', 'PM54-060-S250', 'H54-200-S500-RA'])
def test_the_p_series_with_its_large_position_values(simulate, model):
    unit = control_table(model_named(model)).position_unit
    tricky = -131073 * unit         # FF FF FD FF on the line
    simulator = simulate('--servos', f'1-2:{model}', '--start', f'{tricky:.12f}')
    chain = [Joint('a', -2.0, 2.0, 2.5, 20.0, id=1, model=model, sign=-1),
             Joint('b', -2.0, 2.0, 2.5, 20.0, id=2, model=model, offset=0.3)]
    backend = backend_for(simulator, chain, watchdog=1.0)
    backend.connect()
    np.testing.assert_allclose(backend.measurement.position, [-tricky, tricky - 0.3], atol=2 * unit)
    backend.enable()
    np.testing.assert_allclose(run(backend, np.array([0.5, 0.7]), 1.5), [0.5, 0.7], atol=0.004)
    np.testing.assert_allclose(run(backend, np.array([-tricky, 0.7]), 1.5), [-tricky, 0.7], atol=0.004)
    assert simulator.servo(1)['goal'] == -131073 and simulator.servo(2)['goal'] > 0
    assert simulator.servo(1)['torque']
    backend.close()


def test_settings_are_written_and_spare_the_eeprom(connected):
    backend, simulator = connected
    servo, read = backend.bus.servos[0], backend.bus.setup.read
    unit = control_table(model_named(MODEL))
    assert read(servo, 'Profile Velocity') * unit.velocity_unit >= 3.0
    assert read(servo, 'Profile Acceleration') * unit.acceleration_unit >= 20.0
    low, high = read(servo, 'Min Position Limit'), read(servo, 'Max Position Limit')
    assert (low - 2048) * unit.position_unit >= -2.0 and (high - 2048) * unit.position_unit <= 2.0
    before = simulator.tell('state')['instructions']['WRITE']
    backend.connect()
    again = simulator.tell('state')['instructions']['WRITE'] - before
    # the second time only torque, the indirect addresses and the watchdog are written
    assert again <= 4 * (2 + 2 + 15)


def test_voltage_temperature_and_effort_arrive(connected):
    backend, _ = connected
    backend.enable()
    run(backend, np.full(4, 0.3), 1.6)
    assert np.all(np.abs(backend.measurement.temperature - 30) < 10)
    np.testing.assert_allclose(backend.measurement.voltage, 12.0)
    assert np.all(np.isfinite(backend.measurement.effort))


def test_a_hand_turned_horn_does_not_jump_when_torque_comes_on(connected):
    backend, simulator = connected
    simulator.tell('place', id=2, radians=3.1416 + 1.0)
    backend.observe()
    backend.enable()
    assert abs(simulator.servo(2)['position'] - 3.1416 - 1.0) < 0.005


def test_single_errors_are_counted_and_tolerated(connected):
    backend, simulator = connected
    backend.enable()
    for fault in ('drop', 'corrupt', 'delay'):
        simulator.tell(fault, id=2, **({'seconds': 0.05} if fault == 'delay' else {}))
        backend.exchange(np.zeros(4), np.zeros(4))
        run(backend, np.zeros(4), 0.05)
        assert backend.measurement.fresh
    before = backend.statistics['read errors']
    assert before >= 3
    simulator.tell('corrupt', probability=0.05, count=-1)
    run(backend, np.full(4, 0.2), 1.0)
    assert backend.statistics['read errors'] > before


@pytest.mark.parametrize('fast_read', [True, False])
def test_late_replies_on_a_real_port(simulate, fast_read):
    """Replies that come during later requests: no exception, and never the number of another packet."""
    simulator = simulate('--servos', f'1-4:{MODEL}')
    backend = backend_for(simulator, joints(4), watchdog=1.0, fast_read=fast_read, error_run=1000)
    backend.connect()
    backend.enable()
    simulator.tell('delay', id=2, seconds=0.03, count=-1, probability=0.3)
    run(backend, np.full(4, 0.3), 2.0)
    simulator.tell('clear')
    assert backend.statistics['read errors'] > 10 and backend.statistics['stray replies'] > 10
    np.testing.assert_allclose(run(backend, np.full(4, 0.3), 0.3), 0.3, atol=0.01)
    backend.close()


def fails(backend, *words, seconds=2.0):
    with pytest.raises(BackendFault) as error:
        run(backend, np.zeros(4), seconds)
    for word in words:
        assert word in str(error.value), str(error.value)
    return error.value


def test_a_silent_servo_is_named(connected):
    backend, simulator = connected
    backend.enable()
    simulator.tell('silent', id=3)
    error = fails(backend, 'joint_3 (ID 3', 'no longer answers', '10 cycles')
    assert not error.connection_lost
    # the others still hear commands: their watchdogs have not run out
    assert not simulator.servo(1)['halted']


def test_a_dead_bus_is_told_from_a_silent_servo(connected):
    backend, simulator = connected
    backend.enable()
    simulator.tell('silent')
    assert fails(backend, 'no servo answers any more').connection_lost


def test_unplugging(connected):
    backend, simulator = connected
    backend.enable()
    simulator.tell('unplug')
    assert fails(backend, 'is gone', 'unplugged').connection_lost
    assert fails(backend, 'not open').connection_lost
    assert backend.disable() is False
    simulator.tell('plug')
    backend.connect()
    backend.enable()
    run(backend, np.zeros(4), 0.1)
    assert backend.measurement.fresh


def test_a_rebooted_servo(connected):
    backend, simulator = connected
    backend.enable()
    run(backend, np.zeros(4), 0.05)
    simulator.tell('reboot', id=4)
    backend._error_run = 1000      # it is silent while it starts
    fails(backend, 'joint_4 (ID 4', 'rebooted')


@pytest.mark.parametrize('kind, words', [('overload', 'overload'), ('overheating', 'overheating'),
                                         ('voltage', 'input voltage')])
def test_hardware_errors(connected, kind, words):
    backend, simulator = connected
    backend.enable()
    simulator.tell('fail', id=2, kind=kind)
    fails(backend, 'joint_2', words)
    with pytest.raises(BackendFault, match=f'stands in a hardware error: {words}'):
        backend.connect()
    backend.bus.settings = patient(simulator, reboot=True)
    backend.connect()
    assert any('was rebooted' in note for note in backend.notes)


def test_a_late_bridge_finds_its_servos_stopped(connected):
    backend, simulator = connected
    backend.enable()
    run(backend, np.full(4, 1.0), 0.1)
    simulator.until(lambda state: all(servo['halted'] for servo in state['servos']), 10.0)
    fails(backend, 'Bus Watchdog stopped it')


def test_a_killed_program_leaves_the_servos_to_their_watchdog(simulate):
    """kill -9 while the servos run: they stop within the watchdog's time."""
    simulator = simulate('--servos', f'1-4:{MODEL}')
    code = f"""
import sys, time, numpy as np
sys.path[:0] = {sys.path!r}
from style_servo.chain import Chain, Joint
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
joints = tuple(Joint(f'joint_{{k}}', -2.0, 2.0, 1.0, 20.0, id=k, model='{MODEL}') for k in range(1, 5))
backend = DynamixelBackend(Chain(joints), BusSettings({simulator.link!r}, watchdog=0.06), {PERIOD})
backend.connect(); backend.enable(); print('on', flush=True)
while True:
    backend.exchange(np.full(4, 1.9), np.zeros(4)); time.sleep({PERIOD})
"""
    child = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b'on\n'
    simulator.until(lambda s: all(servo['velocity'] > 0.5 for servo in s['servos']))
    child.kill()
    child.wait()
    child.stdout.close()
    killed = time.monotonic()
    state = simulator.until(lambda s: all(servo['halted'] for servo in s['servos']))
    assert time.monotonic() - killed < 0.5
    time.sleep(0.1)
    rest = simulator.tell('state')['servos']
    assert all(abs(servo['velocity']) < 0.01 and servo['watchdog'] == -1 for servo in rest)
    assert all(abs(a['position'] - b['position']) < 0.05 for a, b in zip(rest, state['servos']))


# --- what can be wrong at the start --------------------------------------------------------------------------------


def refuses(backend, *words):
    with pytest.raises((BackendFault, UsageError)) as error:
        backend.connect()
    for word in words:
        assert word in str(error.value), str(error.value)


def test_a_wrong_model(simulate):
    simulator = simulate('--servos', '1:XM430-W350,2:XL430-W250')
    refuses(backend_for(simulator, joints(2)), 'ID 2 is a XL430-W250 (model number 1060)', 'joint_2', 'XM430-W350')


def test_two_servos_with_one_id(simulate):
    simulator = simulate('--servos', '1:XM430-W350,2:XM430-W350,2:XM430-W350')
    refuses(backend_for(simulator, joints(2)), 'joint_2 (ID 2', 'two servos share that ID')


def test_two_servos_with_one_id_and_no_other(simulate):
    simulator = simulate('--servos', '2:XM430-W350,2:XM430-W350')
    refuses(backend_for(simulator, joints(2)[1:]), 'joint_2 (ID 2', 'garbled;', 'two servos share that ID')


def test_a_missing_servo(simulate):
    simulator = simulate('--servos', '1:XM430-W350')
    refuses(backend_for(simulator, joints(2)), 'joint_2 (ID 2', 'no answer, while others do')


def test_a_wrong_baud_rate(simulate):
    simulator = simulate('--servos', '1:XM430-W350', '--baud', '57600')
    refuses(backend_for(simulator, joints(1)), 'no servo answers', '1000000 baud', 'power')
    refuses(backend_for(simulator, joints(1), baud=12345), '12345 baud')


def test_no_such_port(tmp_path):
    backend = DynamixelBackend(Chain(tuple(joints(1))), BusSettings(str(tmp_path / 'ttyUSB0')), PERIOD)
    refuses(backend, 'no such device')


def test_a_file_is_not_a_port(tmp_path):
    (tmp_path / 'file').write_text('')
    refuses(DynamixelBackend(Chain(tuple(joints(1))), BusSettings(str(tmp_path / 'file')), PERIOD), 'not a serial port')


def test_a_port_in_use(connected):
    _, simulator = connected
    refuses(backend_for(simulator, joints(4)), 'another program uses it')


def test_a_read_only_port(tmp_path):
    """On a file system that is mounted read-only, in a mount namespace of its own."""
    port = tmp_path / 'port'
    mounted = f'mount -t tmpfs none {tmp_path} && touch {port} && mount -o remount,ro {tmp_path}'
    if subprocess.run(['unshare', '-rm', 'sh', '-c', mounted], capture_output=True, timeout=30).returncode:
        pytest.skip('no mount namespaces here')
    code = f"""
from style_servo.chain import Chain, Joint
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
try:
    DynamixelBackend(Chain((Joint('a', -2.0, 2.0, 1.0, 20.0, id=1, model='{MODEL}'),)), BusSettings('{port}'),
                     {PERIOD}).connect()
except Exception as error:
    print(type(error).__name__, error)
"""
    answer = subprocess.run(['unshare', '-rm', 'sh', '-c', f'{mounted} && exec "$0" -c "$1"', sys.executable, code],
                            capture_output=True, text=True, timeout=30)
    assert 'BackendFault' in answer.stdout and 'it is read-only' in answer.stdout, answer


def test_a_port_without_permission(simulate):
    simulator = simulate('--servos', '1:XM430-W350')
    os.chmod(os.path.realpath(simulator.link), 0o444)
    code = f"""
import os, sys
sys.path[:0] = {sys.path!r}
from style_servo.chain import Chain, Joint
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
backend = DynamixelBackend(Chain((Joint('a', -2.0, 2.0, 1.0, 20.0, id=1, model='{MODEL}'),)),
                           BusSettings(os.path.realpath({simulator.link!r})), {PERIOD})
if os.getuid() == 0:
    os.setgid(65534); os.setuid(65534)      # root may write anything: become nobody
try:
    backend.connect()
except Exception as error:
    print(type(error).__name__, error)
"""
    answer = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=30)
    assert 'BackendFault' in answer.stdout and 'no permission to read and write' in answer.stdout, answer


@pytest.mark.parametrize('joint, words', [
    (Joint('a', -4.0, 4.0, 1.0, 1.0, id=1, model=MODEL), '0 to 4095'),
    (Joint('a', -1.0, 1.0, 1.0, 1.0, id=1, model='XL320'), 'Indirect Data'),
    (Joint('a', -1.0, 1.0, 1.0, 1.0, id=1, model='XYZ'), 'unknown Dynamixel model'),
    (Joint('a', -1.0, 1.0, 1.0, 1.0), 'needs id and model')])
def test_impossible_chains_are_refused_before_anything_is_opened(joint, words):
    with pytest.raises(UsageError, match=words):
        DynamixelBackend(Chain((joint,)), BusSettings('/dev/null'), PERIOD)
