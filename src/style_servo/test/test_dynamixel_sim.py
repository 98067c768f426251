"""The simulated bus, judged by the unmodified dynamixel-sdk."""
import os
import termios
import time

import pytest
from dynamixel_easy_sdk import Connector, OperatingMode
from dynamixel_sdk import (
    BROADCAST_ID,
    COMM_RX_CORRUPT,
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    GroupBulkRead,
    GroupBulkWrite,
    GroupSyncRead,
    GroupSyncWrite,
    PacketHandler,
    PortHandler,
)

from style_core.errors import UsageError
from style_servo.dynamixel_sim import main, parse_servos, tell

TORQUE, LED, LEVEL, ERROR, WATCHDOG, GOAL, POSITION, MOVING = 64, 65, 68, 70, 98, 116, 132, 122
PROFILE_A, PROFILE_V, MODE, GOAL_V, VELOCITY = 108, 112, 11, 104, 128
SUCCESS = (COMM_SUCCESS, 0)


class PatientPort(PortHandler):
    """The SDK's port, with time for a simulator that shares the processor with other tests."""

    def setPacketTimeout(self, packet_length):
        super().setPacketTimeout(packet_length)
        self.packet_timeout = max(self.packet_timeout, 200)


class Client:
    """The SDK's calls with one port."""

    def __init__(self, link, baud=1000000):
        self.port = PatientPort(link)
        assert self.port.setBaudRate(baud)
        self.packets = PacketHandler(2.0)

    def __getattr__(self, name):
        call = getattr(self.packets, name)
        return lambda *arguments: call(self.port, *arguments)

    def wait(self, servo_id, address, value, seconds=4.0):
        end = time.monotonic() + seconds
        while self.read4ByteTxRx(servo_id, address)[0] != value:
            assert time.monotonic() < end
            time.sleep(0.01)


def signed(value):
    return value - 2**32 if value >= 2**31 else value


@pytest.fixture
def chain(simulate):
    simulator = simulate('--servos', '1-3:XM430-W350,7:XL430-W250,9:XM540-W270')
    client = Client(simulator.link)
    yield client, simulator
    client.port.closePort()


def test_ping(chain):
    client, _ = chain
    assert client.ping(1) == (1020, *SUCCESS)
    assert client.ping(7) == (1060, *SUCCESS)
    assert client.ping(50)[1] == COMM_RX_TIMEOUT
    found, result = client.broadcastPing()
    assert result == COMM_SUCCESS
    assert {k: v[0] for k, v in found.items()} == {1: 1020, 2: 1020, 3: 1020, 7: 1060, 9: 1120}


def test_read_and_write_of_every_width(chain):
    client, _ = chain
    assert client.write1ByteTxRx(1, LED, 1) == SUCCESS
    assert client.read1ByteTxRx(1, LED) == (1, *SUCCESS)
    assert client.write2ByteTxRx(1, 84, 640) == SUCCESS
    assert client.read2ByteTxRx(1, 84) == (640, *SUCCESS)
    assert client.write4ByteTxRx(1, PROFILE_V, 123) == SUCCESS
    assert client.read4ByteTxRx(1, PROFILE_V) == (123, *SUCCESS)
    data, *result = client.readTxRx(1, 0, 147)
    assert tuple(result) == SUCCESS and len(data) == 147 and data[7] == 1
    assert client.write1ByteTxOnly(1, LED, 0) == COMM_SUCCESS
    time.sleep(0.02)        # its answer passes unread
    assert client.read1ByteTxRx(1, LED)[0] == 0


def test_refusals_carry_the_protocols_error_numbers(chain):
    client, _ = chain
    assert client.write1ByteTxRx(1, 6, 5)[1] == 7                        # firmware version: read only
    assert client.write1ByteTxRx(1, 1000, 5)[1] == 7                     # beyond the table
    assert client.write4ByteTxRx(1, GOAL, 5000)[1] == 6                  # beyond the position limit
    assert client.write2ByteTxRx(1, GOAL, 100)[1] == 5                   # half an item
    assert client.write1ByteTxRx(1, 7, 253)[1] == 4                      # no such ID
    assert client.write1ByteTxRx(1, TORQUE, 1) == SUCCESS
    assert client.write1ByteTxRx(1, MODE, 1)[1] == 7                     # EEPROM while torque is on
    packet = [0] * 10
    packet[4:8] = [1, 3, 0, 0x77]
    assert client.txRxPacket(packet)[1:] == (COMM_SUCCESS, 2)            # no such instruction


def test_motion_follows_the_profile(chain):
    client, simulator = chain
    client.write4ByteTxRx(1, PROFILE_V, 100)       # 2.4 rad/s
    client.write4ByteTxRx(1, PROFILE_A, 20)        # 7.5 rad/s^2
    client.write4ByteTxRx(1, GOAL, 3000)
    time.sleep(0.1)
    assert client.read4ByteTxRx(1, POSITION)[0] == 2048      # no torque, no motion
    client.write1ByteTxRx(1, TORQUE, 1)
    client.write4ByteTxRx(1, GOAL, 3000)
    fastest, start = 0, time.monotonic()
    while time.monotonic() - start < 1.5:
        fastest = max(fastest, signed(client.read4ByteTxRx(1, VELOCITY)[0]))
    assert 85 <= fastest <= 110
    assert abs(client.read4ByteTxRx(1, POSITION)[0] - 3000) <= 1
    assert client.read1ByteTxRx(1, MOVING)[0] == 0
    assert abs(simulator.servo(1)['velocity']) < 0.01


def test_velocity_mode(chain):
    client, _ = chain
    client.write1ByteTxRx(2, MODE, 1)
    client.write1ByteTxRx(2, TORQUE, 1)
    assert client.write4ByteTxRx(2, GOAL_V, 2**32 - 50) == SUCCESS
    assert client.write4ByteTxRx(2, GOAL_V, 250)[1] == 6
    time.sleep(0.4)
    assert abs(signed(client.read4ByteTxRx(2, VELOCITY)[0]) + 50) <= 3


def test_registered_writes_wait_for_the_action(chain):
    client, _ = chain
    for servo_id in (1, 2):
        assert client.regWriteTxRx(servo_id, LED, 1, [1]) == SUCCESS
        assert client.read1ByteTxRx(servo_id, 69)[0] == 1
        assert client.read1ByteTxRx(servo_id, LED)[0] == 0
    assert client.regWriteTxOnly(3, LED, 1, [1]) == COMM_SUCCESS
    assert client.action(BROADCAST_ID) == COMM_SUCCESS
    assert [client.read1ByteTxRx(k, LED)[0] for k in (1, 2, 3)] == [1, 1, 1]
    assert client.read1ByteTxRx(1, 69)[0] == 0


@pytest.mark.parametrize('fast', [False, True])
def test_sync_write_and_sync_read(chain, fast):
    client, _ = chain
    write = GroupSyncWrite(client.port, client.packets, PROFILE_A, 8)
    read = GroupSyncRead(client.port, client.packets, PROFILE_A, 8)
    for k in (1, 2, 3, 7, 9):
        assert write.addParam(k, [k, 0, 0, 0, 10 * k, 0, 0, 0])
        assert read.addParam(k)
    assert write.txPacket() == COMM_SUCCESS
    assert (read.fastSyncRead() if fast else read.txRxPacket()) == COMM_SUCCESS
    for k in (1, 2, 3, 7, 9):
        assert read.isAvailable(k, PROFILE_A, 4)
        assert (read.getData(k, PROFILE_A, 4), read.getData(k, PROFILE_V, 4)) == (k, 10 * k)


@pytest.mark.parametrize('fast', [False, True])
def test_bulk_write_and_bulk_read(chain, fast):
    client, _ = chain
    write = GroupBulkWrite(client.port, client.packets)
    assert write.addParam(1, LED, 1, [1])
    assert write.addParam(2, PROFILE_V, 4, [77, 0, 0, 0])
    assert write.addParam(7, 84, 2, [0x21, 0x03])
    assert write.txPacket() == COMM_SUCCESS
    read = GroupBulkRead(client.port, client.packets)
    for servo_id, address, length in ((1, LED, 1), (2, PROFILE_V, 4), (7, 84, 2)):
        assert read.addParam(servo_id, address, length)
    assert (read.fastBulkRead() if fast else read.txRxPacket()) == COMM_SUCCESS
    assert (read.getData(1, LED, 1), read.getData(2, PROFILE_V, 4), read.getData(7, 84, 2)) == (1, 77, 0x321)


def test_a_missing_servo_ends_a_sync_read(chain):
    client, _ = chain
    for fast in (False, True):
        read = GroupSyncRead(client.port, client.packets, POSITION, 4)
        for k in (1, 50, 3):
            read.addParam(k)
        assert (read.fastSyncRead() if fast else read.txRxPacket()) != COMM_SUCCESS
        assert not read.isAvailable(3, POSITION, 4)


def test_indirect_addresses_show_and_set_other_items(chain):
    client, _ = chain
    for k, address in enumerate([TORQUE, ERROR, *range(126, 136)]):
        assert client.write2ByteTxRx(1, 168 + 2 * k, address) == SUCCESS
    client.write1ByteTxRx(1, TORQUE, 1)
    data, *result = client.readTxRx(1, 224, 12)
    assert tuple(result) == SUCCESS and data[0] == 1
    assert data[8:12] == client.readTxRx(1, POSITION, 4)[0]
    assert client.write1ByteTxRx(1, 224, 0) == SUCCESS
    assert client.read1ByteTxRx(1, TORQUE)[0] == 0
    assert client.write1ByteTxRx(1, 225, 0)[1] == 7      # hardware error status is read-only here as well


def test_status_return_level(chain):
    client, _ = chain
    assert client.write1ByteTxRx(1, LEVEL, 1) == SUCCESS
    assert client.write1ByteTxRx(1, LED, 1)[0] == COMM_RX_TIMEOUT
    assert client.read1ByteTxRx(1, LED) == (1, *SUCCESS)
    client.write1ByteTxOnly(1, LEVEL, 0)
    assert client.read1ByteTxRx(1, LED)[1] == COMM_RX_TIMEOUT
    assert client.ping(1) == (1020, *SUCCESS)


def test_id_change_and_shadow_id(chain):
    client, _ = chain
    assert client.write1ByteTxRx(1, 7, 30) == SUCCESS
    assert client.ping(1)[1] == COMM_RX_TIMEOUT and client.ping(30) == (1020, *SUCCESS)
    client.write1ByteTxRx(2, 12, 40)
    client.write1ByteTxRx(3, 12, 40)
    assert client.write1ByteTxRx(40, LED, 1)[0] == COMM_RX_TIMEOUT       # obeyed, never answered
    assert [client.read1ByteTxRx(k, LED)[0] for k in (2, 3)] == [1, 1]


def test_reboot_and_factory_reset(chain):
    client, _ = chain
    client.write1ByteTxRx(1, TORQUE, 1)
    assert client.reboot(1) == SUCCESS
    assert client.ping(1)[1] == COMM_RX_TIMEOUT      # still starting
    time.sleep(0.25)
    assert client.read1ByteTxRx(1, TORQUE) == (0, *SUCCESS)
    client.write4ByteTxRx(2, 48, 3000)
    assert client.factoryReset(2, 0x02) == SUCCESS
    time.sleep(0.25)
    assert client.read4ByteTxRx(2, 48) == (4095, *SUCCESS)
    assert client.factoryReset(3, 0xFF) == SUCCESS
    time.sleep(0.25)
    assert client.ping(3)[1] == COMM_RX_TIMEOUT
    client.port.setBaudRate(57600)                   # the factory's speed, and its ID
    assert client.ping(1) == (1020, *SUCCESS)


def test_clear_multi_turn(chain):
    client, simulator = chain
    client.write1ByteTxRx(1, MODE, 4)
    simulator.tell('place', id=1, radians=3 * 6.283185307 + 1.0)
    assert client.read4ByteTxRx(1, POSITION)[0] == 3 * 4096 + 652
    assert client.clearMultiTurn(1) == SUCCESS
    assert client.read4ByteTxRx(1, POSITION)[0] == 652


def test_other_baud_rates_are_not_understood(chain):
    client, _ = chain
    client.port.setBaudRate(57600)
    assert client.ping(1)[1] == COMM_RX_TIMEOUT
    client.port.setBaudRate(1000000)
    assert client.ping(1)[1] == COMM_SUCCESS
    assert client.write1ByteTxRx(1, 8, 4)[0] == COMM_SUCCESS
    assert client.ping(1)[1] == COMM_RX_TIMEOUT
    client.port.setBaudRate(2000000)
    assert client.ping(1) == (1020, *SUCCESS)


def test_bus_watchdog_stops_the_servo_and_locks_its_goals(chain):
    client, simulator = chain
    client.write4ByteTxRx(1, PROFILE_V, 20)
    client.write1ByteTxRx(1, TORQUE, 1)
    client.write1ByteTxRx(1, WATCHDOG, 5)      # 100 ms
    client.write4ByteTxRx(1, GOAL, 4000)
    time.sleep(0.3)
    stopped = simulator.until(lambda s: s['servos'][0]['halted'])['servos'][0]
    assert stopped['watchdog'] == -1 and stopped['position'] < 3.14 + 0.2
    assert client.read1ByteTxRx(1, WATCHDOG)[0] == 255
    assert client.write4ByteTxRx(1, GOAL, 2048)[1] == 4      # range error
    assert client.write1ByteTxRx(1, WATCHDOG, 0) == SUCCESS
    assert client.write4ByteTxRx(1, GOAL, 2048) == SUCCESS


def test_hardware_errors_raise_the_alert_bit_and_cut_torque(chain):
    client, simulator = chain
    client.write1ByteTxRx(1, TORQUE, 1)
    simulator.tell('fail', id=1, kind='overload')
    value, result, error = client.read1ByteTxRx(1, ERROR)
    assert (value, result, error) == (0x20, COMM_SUCCESS, 0x80)
    assert client.read1ByteTxRx(1, TORQUE)[0] == 0
    assert client.write1ByteTxRx(1, TORQUE, 1)[1] & 0x7F == 1
    client.reboot(1)
    time.sleep(0.25)
    assert client.read1ByteTxRx(1, ERROR) == (0, *SUCCESS)
    simulator.tell('heat', id=2, celsius=95)
    client.wait(2, ERROR, 4)


def test_a_blocked_horn_becomes_an_overload(chain):
    client, simulator = chain
    client.write1ByteTxRx(1, TORQUE, 1)
    simulator.tell('block', id=1)
    client.write4ByteTxRx(1, GOAL, 3500)
    state = simulator.until(lambda s: s['servos'][0]['hardware_error'] == 0x20)
    assert not state['servos'][0]['torque']


def test_dropped_corrupted_and_late_replies(chain):
    client, simulator = chain
    simulator.tell('drop', id=1)
    assert client.ping(1)[1] == COMM_RX_TIMEOUT
    assert client.ping(1)[1] == COMM_SUCCESS
    simulator.tell('corrupt', id=1, count=-1)
    assert {client.read4ByteTxRx(1, POSITION)[1] for _ in range(12)} <= {COMM_RX_CORRUPT, COMM_RX_TIMEOUT}
    simulator.tell('clear')
    simulator.tell('delay', id=1, seconds=0.3)
    assert client.ping(1)[1] == COMM_RX_TIMEOUT
    assert client.ping(2)[1] == COMM_SUCCESS
    simulator.tell('corrupt', id=2)
    read = GroupSyncRead(client.port, client.packets, POSITION, 4)
    for k in (1, 2, 3):
        read.addParam(k)
    assert read.fastSyncRead() != COMM_SUCCESS
    assert read.fastSyncRead() == COMM_SUCCESS


def test_a_silent_servo(chain):
    client, simulator = chain
    simulator.tell('silent', id=2)
    assert client.ping(2)[1] == COMM_RX_TIMEOUT and client.ping(1)[1] == COMM_SUCCESS
    simulator.tell('silent', id=2, on=False)
    assert client.ping(2)[1] == COMM_SUCCESS


def test_unplugging_and_plugging_in(chain):
    client, simulator = chain
    simulator.tell('unplug')
    with pytest.raises((OSError, termios.error)):       # serial.SerialException is an OSError
        client.ping(1)
    assert not os.path.exists(simulator.link)
    simulator.tell('plug')
    again = Client(simulator.link)
    assert again.ping(1)[1] == COMM_SUCCESS
    again.port.closePort()


def test_two_servos_with_one_id_garble_their_answers(simulate):
    client = Client(simulate('--servos', '1:XM430-W350,1:XM430-W350,2:XM430-W350').link)
    assert all(client.ping(1)[1] in (COMM_RX_CORRUPT, COMM_RX_TIMEOUT) for _ in range(5))
    assert client.ping(2)[1] == COMM_SUCCESS


def test_byte_stuffing_both_ways(simulate):
    """A goal whose bytes look like a header: the P series' goals are large enough."""
    client = Client(simulate('--servos', '1:PH54-200-S500', '--any-baud').link)
    assert client.write1ByteTxRx(1, MODE, 4) == SUCCESS
    awkward = 0xFFFDFFFF                             # FF FF FD FF on the line
    assert client.write4ByteTxRx(1, 564, awkward) == SUCCESS
    assert client.read4ByteTxRx(1, 564) == (awkward, *SUCCESS)


def test_true_timing_takes_the_time_of_the_line(simulate):
    client = Client(simulate('--servos', '1:XM430-W350', '--true-timing', '--baud', '57600').link, 57600)
    start = time.monotonic()
    for _ in range(10):
        assert client.ping(1)[1] == COMM_SUCCESS
    # 10 bytes out and 14 back at 10 bits each, and 0.5 ms return delay
    assert time.monotonic() - start > 10 * (24 * 10 / 57600 + 0.0005) * 0.98


def test_the_easy_sdk_works_unchanged(simulate):
    """Calls nobody here wrote code for: the SDK's own motor objects and group executor."""
    simulator = simulate('--servos', '1-2:XM430-W350,4:XL330-M288')
    connector = Connector(simulator.link, 1000000)
    motors = connector.createAllMotors(0, 20)
    assert [motor.id for motor in motors] == [1, 2, 4]
    for motor in motors:
        motor.setOperatingMode(OperatingMode.EXTENDED_POSITION)
        assert motor.getOperatingMode() == OperatingMode.EXTENDED_POSITION
        motor.setPositionPGain(700)
        motor.setHomingOffset(0)
        motor.enableTorque()
        motor.setGoalPosition(2500)
        motor.LEDOn()
        assert motor.isLEDOn() == 1 and motor.isTorqueOn() == 1
    executor = connector.createGroupExecutor()
    for motor in motors:
        executor.addCmd(motor.stageSetGoalPosition(2300))
    executor.executeWrite()
    simulator.until(lambda s: all(abs(servo['goal'] - 2300) == 0 and abs(servo['velocity']) < 1e-3
                                  and abs(servo['position'] - 2300 * 0.00153398) < 0.01 for servo in s['servos']))
    for motor in motors:
        executor.addCmd(motor.stageGetPresentPosition())
    assert all(abs(position - 2300) <= 2 for position in executor.executeRead())
    motors[0].disableTorque()
    motors[0].changeID(11)
    assert motors[0].ping() == 1020
    motors[0].factoryResetExceptIDAndBaudRate()
    connector.closePort()


def test_wrong_use_of_the_command_is_explained(tmp_path, capsys):
    assert main(['--link', str(tmp_path / 'x'), '--servos', '1:XY999']) == 2
    assert 'unknown Dynamixel model' in capsys.readouterr().err
    assert main(['--link', str(tmp_path / 'x'), '--baud', '12345']) == 2
    assert main(['--link', str(tmp_path / 'x'), '--tell', '{"do": "state"}']) == 2
    assert 'no simulated bus' in capsys.readouterr().err
    with pytest.raises(UsageError, match='0 to 252'):
        parse_servos('1-300:XM430-W350')
    assert main(['--models']) == 0 and 'XM430-W350' in capsys.readouterr().out


def test_wrong_commands_are_answered_with_the_reason(simulate):
    simulator = simulate('--servos', '1:XM430-W350')
    with pytest.raises(UsageError, match='no servo has ID 9'):
        tell(simulator.link, do='silent', id=9)
    with pytest.raises(UsageError, match='unknown command'):
        tell(simulator.link, do='dance')
