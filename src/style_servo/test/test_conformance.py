"""The simulated servos against the manufacturer's e-manual: every register of every model whose page was read."""
import pytest
from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from style_servo.conformance import SdkLine, walk
from style_servo.control_ranges import PAGES, rules
from style_servo.control_table import control_table, model_named
from style_servo.packets import Parser, StatusScanner, packet, status
from style_servo.simulated_bus import SimulatedBus

XM430 = model_named('XM430-W350')
DRIVE, MODE, HOMING, TORQUE, GOAL, POSITION, WATCHDOG = 10, 11, 20, 64, 116, 132, 98
UNIT = 2 * 3.141592653589793 / 4096


class Client:
    """The SDK's packet handler at a simulated bus without a port in between."""

    def __init__(self, n=1, model=XM430, start=2048):
        self.bus = SimulatedBus([(k + 1, model, start * UNIT) for k in range(n)])
        self.line, self.sdk = SdkLine(self.bus), Protocol2PacketHandler()

    def write(self, address, value, size=1, servo_id=1):
        data = list((value & (1 << 8 * size) - 1).to_bytes(size, 'little'))
        result, error = self.sdk.writeTxRx(self.line, servo_id, address, size, data)
        assert result == COMM_SUCCESS
        return error

    def read(self, address, size=4, servo_id=1):
        data, result, error = self.sdk.readTxRx(self.line, servo_id, address, size)
        assert result == COMM_SUCCESS
        return error or int.from_bytes(bytes(data), 'little', signed=True)

    def turn(self, counts, servo_id=1):
        """Turn a limp horn by hand."""
        self.bus.motion.position[servo_id - 1] = counts * UNIT

    def run(self, seconds):
        self.line.now += seconds
        self.bus.advance(self.line.now)


@pytest.mark.parametrize('model', PAGES)
def test_every_register(model):
    lines = walk(model)
    assert {line.name: line.wrong for line in lines if line.wrong} == {}
    number = model_named(model)
    items = control_table(number, 255).items
    assert {name for name in items if not name.startswith('Indirect')} <= {line.name for line in lines}
    assert sum(len(line.tried) for line in lines) > 700


def test_the_table_covers_what_the_issue_of_ranges_is_about():
    found = rules(XM430)
    assert found['Operating Mode'].values == (0, 1, 3, 4, 5, 16)
    assert (found['PWM Limit'].high, found['Current Limit'].high, found['Velocity Limit'].high) == (885, 1193, 1023)
    assert (found['Homing Offset'].low, found['Position P Gain'].high) == (-1044479, 16383)
    assert (found['Indirect Address'].low, found['Indirect Address'].high) == (64, 661)


@pytest.mark.parametrize('model, milliampere', [
    ('XL330-M288', 1.0), ('XC330-T288', 1.0), ('XL430-W250', None), ('XC430-W150', None), ('XM430-W350', 2.69),
    ('XH430-W350', 2.69), ('XH430-V350', 1.34), ('XH430-V210', 1.34), ('XM540-W270', 2.69), ('XH540-V150', 2.69),
    ('XW540-T260', 2.69), ('MX-28', None), ('MX-106', 3.36), ('PH42-020-S300', 1.0), ('PM54-060-S250', 1.0),
    ('PH54-200-S500', 1.0)])
def test_the_unit_of_current(model, milliampere):
    unit = control_table(model_named(model)).current_unit
    assert unit == (None if milliampere is None else pytest.approx(milliampere / 1000))


def test_the_e_manuals_packets():
    """Bytes printed on the page "Protocol 2.0"."""
    instructions = {'ping': ('FFFFFD00010300 01', '194E'), 'read': ('FFFFFD00010700 0284000400', '1D15'),
                    'write': ('FFFFFD00010900 03740000020000', 'CA89'),
                    'reg write': ('FFFFFD00010900 046800C8000000', 'AE8E'), 'action': ('FFFFFD00010300 05', '02CE'),
                    'factory reset': ('FFFFFD00010400 0601', 'A1E6'), 'reboot': ('FFFFFD00010300 08', '2F4E'),
                    'clear': ('FFFFFD00010800 100144584C22', 'B1DC'),
                    'sync read': ('FFFFFD00FE0900 82840004000102', 'CEFA'),
                    'sync write': ('FFFFFD00FE1100 837400040001960000000 2AA000000', '8287'),
                    'bulk read': ('FFFFFD00FE0D00 92019000020002920001 00', '1A05'),
                    'bulk write': ('FFFFFD00FE1000 93012000 0200A000021F00010050', 'B768')}
    for name, (text, crc) in instructions.items():
        line = bytes.fromhex(text.replace(' ', '') + crc)
        assert packet(line[4], line[7:-2]) == line, name
        assert Parser().feed(line) == [(line[4], line[7], line[8:-2], True)], name
    replies = {'ping': ('FFFFFD00010700 5500060426', '655D'), 'read': ('FFFFFD00010800 5500A6000000', '8CC0'),
               'write': ('FFFFFD00010400 5500', 'A10C'), 'sync read 2': ('FFFFFD00020800 55001F080000', 'BABE'),
               'bulk read 1': ('FFFFFD00010600 55007700', 'C369'), 'bulk read 2': ('FFFFFD00020500 550024', '8BA9')}
    for name, (text, crc) in replies.items():
        line = bytes.fromhex(text.replace(' ', '') + crc)
        assert status(line[4], line[8], line[9:-2]) == line, name
        assert StatusScanner().feed(line) == [(line[4], line[7:-2], False)], name


def test_action_without_reg_write():
    client = Client()
    packet_ = [0] * 10
    packet_[4:8] = [1, 3, 0, 5]
    client.sdk.txPacket(client.line, packet_)
    reply, result = client.sdk.rxPacket(client.line, False)
    assert (result, reply[8]) == (COMM_SUCCESS, 2)


def test_a_broadcast_factory_reset_of_everything_is_not_executed():
    client = Client(3)
    assert client.write(84, 640, 2, servo_id=2) == 0
    client.sdk.factoryReset(client.line, 0xFE, 0xFF)
    client.run(0.3)
    assert [client.read(7, 1, servo_id) for servo_id in (1, 2, 3)] == [1, 2, 3]
    assert client.read(84, 2, servo_id=2) == 640
    assert client.sdk.factoryReset(client.line, 2, 0x02) == (COMM_SUCCESS, 0)
    client.run(0.3)
    assert client.read(84, 2, servo_id=2) == 800


@pytest.mark.parametrize('by_hand, shown', [(-20, 4076), (4100, 4), (3 * 4096 + 7, 7), (1000, 1000)])
def test_position_control_counts_within_one_turn_from_when_torque_comes_on(by_hand, shown):
    client = Client()
    client.turn(by_hand)
    assert client.read(POSITION) == by_hand
    client.write(TORQUE, 1)     # and the horn begins to move to the stored goal
    assert abs(client.read(POSITION) - shown) < 10
    client.write(TORQUE, 0)
    client.run(0.5)
    client.write(MODE, 4)
    client.turn(by_hand)
    turns = client.read(POSITION)
    client.write(TORQUE, 1)
    assert abs(client.read(POSITION) - turns) < 10       # many turns stay many turns there


def test_power_up_counts_within_one_turn():
    client = Client()
    client.turn(-20)
    client.sdk.reboot(client.line, 1)
    client.run(0.3)
    assert client.read(POSITION) == 4076


def test_a_homing_offset_is_ignored_in_position_control_beyond_a_quarter_turn():
    client = Client(start=2000)
    for offset, shown in ((1024, 3024), (-1024, 976), (1025, 2000), (-1025, 2000)):
        assert client.write(HOMING, offset, 4) == 0
        assert client.read(POSITION) == shown
    client.write(MODE, 4)
    assert client.read(POSITION) == 2000 - 1025


def test_reverse_mode():
    client = Client(start=1500)
    client.write(DRIVE, 1)
    client.sdk.reboot(client.line, 1)
    client.run(0.3)
    assert client.read(POSITION) == 4096 - 1500
    client.write(GOAL, 4096 - 1500, 4)
    client.write(TORQUE, 1)
    client.write(GOAL, 3000, 4)
    client.run(2.0)
    assert abs(client.read(POSITION) - 3000) <= 1
    assert abs(client.bus.motion.position[0] / UNIT - 1096) <= 1


def test_a_goal_switches_torque_on_where_drive_mode_says_so():
    client = Client()
    client.write(GOAL, 2500, 4)
    assert client.read(TORQUE, 1) == 0
    assert client.write(DRIVE, 0x08) == 0
    client.write(GOAL, 2500, 4)
    assert client.read(TORQUE, 1) == 1
    client.run(2.0)
    assert abs(client.read(POSITION) - 2500) <= 1


def test_old_firmware():
    client = Client()
    client.bus.servos[0].set('Firmware Version', 37)
    assert client.sdk.readTxRx(client.line, 1, WATCHDOG, 1)[2] == 7
    assert client.write(WATCHDOG, 5) == 7
    tx = [0] * 15
    tx[4:13] = [0xFE, 8, 0, 0x8A, 132, 0, 4, 0, 1]
    client.sdk.txPacket(client.line, tx)
    assert client.sdk.rxPacket(client.line, True)[1] == COMM_RX_TIMEOUT
    client.bus.servos[0].set('Firmware Version', 45)
    client.line.is_using = False
    client.sdk.txPacket(client.line, tx)
    assert client.sdk.rxPacket(client.line, True)[1] == COMM_SUCCESS


def test_the_330s_moved_their_indirect_data():
    for model in ('XL330-M288', 'XC330-T288'):
        number = model_named(model)
        assert control_table(number, 51)['Indirect Data 1'].address == 224
        assert control_table(number, 52)['Indirect Data 1'].address == 208
