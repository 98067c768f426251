"""Dynamixel Protocol 2.0 packets: CRC, byte stuffing, parsing and building. Used by the simulated bus."""

from style_core.wire.crc16 import crc16

__all__ = ['BROADCAST', 'crc16', 'stuff', 'unstuff', 'packet', 'status', 'Parser', 'Instruction', 'Error']

HEADER = b'\xff\xff\xfd'
BROADCAST = 0xFE
STATUS = 0x55
MAX_LENGTH = 4096


class Instruction:
    """Instruction bytes."""

    PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 1, 2, 3, 4, 5, 6, 8, 16
    SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
    BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A


class Error:
    """Values of a status packet's error byte (lower seven bits) and its alert bit."""

    RESULT_FAIL, INSTRUCTION, CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 1, 2, 3, 4, 5, 6, 7
    ALERT = 0x80


def stuff(body):
    """Insert a byte after every header pattern so that a body never looks like the start of a packet."""
    return body.replace(HEADER, HEADER + b'\xfd')


def unstuff(body):
    """Undo :func:`stuff`."""
    return body.replace(HEADER + b'\xfd', HEADER)


def packet(servo_id, body):
    """A whole packet around ``body`` (instruction or status byte and what follows it)."""
    body = stuff(body)
    length = len(body) + 2
    head = HEADER + bytes((0, servo_id, length & 0xFF, length >> 8)) + body
    return head + crc16(head).to_bytes(2, 'little')


def status(servo_id, error, parameters=b''):
    """A status packet."""
    return packet(servo_id, bytes((STATUS, error)) + parameters)


class Parser:
    """Cut a byte stream into packets.

    ``feed(data)`` returns a list of ``(servo_id, instruction, parameters, crc_ok)``. Garbage before a header is
    skipped. The length field is trusted, as a servo does: a header pattern inside a body that its sender forgot to
    stuff does not start a new packet.
    """

    def __init__(self):
        self._buffer = bytearray()

    def forget(self):
        """Drop an unfinished packet (a servo does so after a pause on the line)."""
        self._buffer.clear()

    def feed(self, data):
        buffer = self._buffer
        buffer += data
        packets = []
        while True:
            at = buffer.find(HEADER)
            while at >= 0 and len(buffer) > at + 3 and buffer[at + 3] != 0:
                at = buffer.find(HEADER, at + 1)
            if at < 0:
                del buffer[:max(0, len(buffer) - 3)]
                return packets
            del buffer[:at]
            if len(buffer) < 7:
                return packets
            length = buffer[5] | buffer[6] << 8
            if not 3 <= length <= MAX_LENGTH:
                del buffer[:3]
                continue
            if len(buffer) < 7 + length:
                return packets
            whole = bytes(buffer[:7 + length])
            del buffer[:7 + length]
            crc_ok = crc16(whole[:-2]) == int.from_bytes(whole[-2:], 'little')
            body = unstuff(whole[7:-2])
            packets.append((whole[4], body[0], body[1:], crc_ok))
