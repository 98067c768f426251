"""Walk through the control table of a simulated servo, register by register, with the manufacturer's packet handler.

What should come is taken from the e-manual's tables (control_ranges.py): error 4 for what is out of range, 5 for part
of an item, 6 for what is beyond a limit register, 7 for what is read-only, undefined, or EEPROM while torque is on.
"""
from dataclasses import dataclass, field

from dynamixel_sdk import COMM_SUCCESS
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from style_servo.control_ranges import rules
from style_servo.control_table import model_named
from style_servo.packets import Parser
from style_servo.simulated_bus import SimulatedBus

__all__ = ['SdkLine', 'Line', 'walk']

DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 4, 5, 6, 7
POSITION_MODE, EXTENDED_MODE = 3, 4


class SdkLine:
    """The port that the SDK asks for, with a simulated bus at its end and no time in between."""

    def __init__(self, bus):
        self.bus, self.baudrate, self.is_using, self.ser = bus, 1000000, False, None
        self.now = 0.0
        self._parser, self._bytes = Parser(), bytearray()

    def clearPort(self):
        """Forget what came."""
        self._bytes.clear()

    def writePort(self, packet):
        """Send; whatever the servos answer is there at once."""
        self.now += 0.001
        for one in self._parser.feed(bytes(packet)):
            for reply in self.bus.handle(*one, self.now):
                self._bytes += reply.data
        return len(packet)

    def readPort(self, length):
        """What came."""
        data = bytes(self._bytes[:length])
        del self._bytes[:length]
        return data

    def setPacketTimeout(self, length):
        """No time passes."""

    setPacketTimeoutMillis = setPacketTimeout

    def isPacketTimeout(self):
        """Nothing comes later than at once."""
        return not self._bytes


@dataclass
class Line:
    """One register: where it lies, what the e-manual says, and what was tried.

    ``tried`` holds what, the error expected and the error that came (0: none).
    """

    name: str
    address: int
    size: int
    access: str
    range: str
    initial: str
    tried: list = field(default_factory=list)

    @property
    def wrong(self):
        """What came out otherwise than it should."""
        return [one for one in self.tried if one[1] != one[2]]


class _Walk:
    def __init__(self, model):
        number = model_named(model)
        self.bus = SimulatedBus([(1, number, 3.0 if not model.startswith(('P', 'H', 'M5', 'M4')) else 0.0)])
        self.servo = self.bus.servos[0]
        self.line, self.sdk = SdkLine(self.bus), Protocol2PacketHandler()
        self.table, self.rules = self.servo.table, rules(number, self.servo.firmware)

    def write(self, address, value, size):
        data = list((value & (1 << 8 * size) - 1).to_bytes(size, 'little'))
        result, error = self.sdk.writeTxRx(self.line, 1, address, size, data)
        assert result == COMM_SUCCESS, (address, value)
        return error & 0x7F

    def read(self, address, size):
        data, result, error = self.sdk.readTxRx(self.line, 1, address, size)
        assert result == COMM_SUCCESS, address
        return bytes(data), error & 0x7F

    def put(self, name, value):
        self.servo.set(name, value)

    def register(self, item, rule):
        unbounded = rule.low is None and rule.values is None
        text = ('by ' + rule.limit if rule.limit else '' if unbounded else
                f'{rule.low} to {rule.high}' if rule.values is None else ', '.join(map(str, rule.values)))
        line = Line(item.name, item.address, item.size, 'RW' if rule.writable else 'R', text,
                    '' if rule.initial is None else str(rule.initial))
        data, error = self.read(item.address, item.size)
        line.tried.append(('read', 0, error))
        found = int.from_bytes(data, 'little', signed=rule.signed)
        # the simulator gives its servos their ID and speed
        if rule.initial is not None and item.name not in ('ID', 'Baud Rate'):
            line.tried.append(('initial value', rule.initial, found))
        if not rule.writable:
            line.tried.append(('write', ACCESS, self.write(item.address, 0, item.size)))
            return line
        if item.size > 1:
            line.tried.append(('half of it', DATA_LENGTH, self.write(item.address, 0, item.size // 2)))
        if item.address < self.table['Torque Enable'].address:
            self.put('Torque Enable', 1)
            line.tried.append(('while torque is on', ACCESS, self.write(item.address, found, item.size)))
            self.put('Torque Enable', 0)
        if item.name not in ('ID', 'Baud Rate', 'Status Return Level', 'Torque Enable'):
            self.values(line, item, rule)
        else:       # right values of these change whom one talks to
            self.value(line, item, rule, rule.high + 1, DATA_RANGE)
        return line

    def value(self, line, item, rule, value, expected):
        low = -(1 << 8 * item.size - 1) if rule.signed else 0
        if low <= value < low + (1 << 8 * item.size):
            line.tried.append((str(value), expected, self.write(item.address, value, item.size)))

    def values(self, line, item, rule):
        before = self.servo.get(item.name)
        if rule.limit is not None:
            most = self.servo.get(rule.limit)
            for value, expected in ((most, 0), (most + 1, DATA_LIMIT), (-most, 0), (-most - 1, DATA_LIMIT)):
                if value >= 0 or rule.signed:
                    self.value(line, item, rule, value, expected)
        elif rule.values is not None:
            for value in range(min(1 << 8 * item.size, 64)):
                self.value(line, item, rule, value, 0 if value in rule.values else DATA_RANGE)
        elif rule.low is not None:
            for value, expected in _edges(rule):
                self.value(line, item, rule, value, expected)
        elif item.name == 'Goal Position':
            low, high = self.servo.get('Min Position Limit'), self.servo.get('Max Position Limit')
            for value, expected in ((low, 0), (high, 0), (low - 1, DATA_LIMIT), (high + 1, DATA_LIMIT)):
                self.value(line, item, rule, value, expected)
        self.put(item.name, before)

    def indirect(self):
        """Every indirect address and the byte behind it."""
        rule, servo = self.rules['Indirect Address'], self.servo
        cells = sorted(servo._indirect.items(), key=lambda pair: pair[1])
        addresses = Line('Indirect Address 1 to ' + str(len(cells)), cells[0][1], 2, 'RW', f'{rule.low} to {rule.high}',
                         f'{cells[0][0]} and so on')
        data = Line('Indirect Data 1 to ' + str(len(cells)), cells[0][0], 1, 'RW', '0 to 255', '0')
        name = next(name for name in ('LED', 'LED Red', 'Bus Watchdog') if name in self.table)
        item = self.table[name]
        for cell, address in cells:
            for value, expected in _edges(rule):
                addresses.tried.append((f'{value} at {address}', expected, self.write(address, value, 2)))
            addresses.tried.append((f'half of {address}', DATA_LENGTH, self.write(address, 0, 1)))
            self.write(address, item.address, 2)
            data.tried.append((f'{name} through {cell}', 0, self.write(cell, 1, 1)))
            data.tried.append((f'{name} through {cell}, read', 1, self.read(item.address, 1)[0][0]))
            self.write(cell, 0, 1)
            self.write(address, cell, 2)
        return [addresses, data]

    def undefined(self):
        """Every address at which nothing lies."""
        line = Line('undefined addresses', 0, 1, '-', '', '')
        taken = {item.address + k for item in self.table.items.values() for k in range(item.size)
                 if not item.name.startswith('Indirect')}
        taken |= set(self.servo._indirect) | {a + k for a in self.servo._indirect.values() for k in (0, 1)}
        for address in sorted(set(range(max(taken) + 40)) - taken):
            line.tried.append((f'read {address}', ACCESS, self.read(address, 1)[1]))
            line.tried.append((f'write {address}', ACCESS, self.write(address, 0, 1)))
        return line


def _edges(rule):
    return (rule.low, 0), (rule.high, 0), (rule.low - 1, DATA_RANGE), (rule.high + 1, DATA_RANGE)


def walk(model):
    """All registers of a model, and what came when they were read and written.

    Returns
    -------
    list of Line
    """
    walking = _Walk(model)
    items = sorted(walking.table.items.values(), key=lambda item: item.address)
    lines = [walking.register(item, walking.rules[item.name]) for item in items if item.name in walking.rules]
    return lines + walking.indirect() + [walking.undefined()]
