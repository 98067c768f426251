"""Dynamixel Protocol 2.0 packets: CRC, byte stuffing, parsing and building, for the bridge and the simulated bus."""

from style_core.wire.crc16 import crc16

__all__ = ['BROADCAST', 'crc16', 'stuff', 'unstuff', 'packet', 'status', 'Parser', 'StatusScanner', 'Instruction',
           'Error', 'ERROR_WORDS']

HEADER = b'\xff\xff\xfd'
BROADCAST = 0xFE
STATUS = 0x55
MAX_LENGTH = 4096
MAX_STATUS = 2048       # of the bytes of any reply that is ever asked for


class Instruction:
    """Instruction bytes."""

    PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 1, 2, 3, 4, 5, 6, 8, 16
    SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
    BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A


class Error:
    """Values of a status packet's error byte (lower seven bits) and its alert bit."""

    RESULT_FAIL, INSTRUCTION, CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = 1, 2, 3, 4, 5, 6, 7
    ALERT = 0x80


#: What a status packet's error number says.
ERROR_WORDS = {Error.RESULT_FAIL: 'it could not do it', Error.INSTRUCTION: 'it does not know the instruction',
               Error.CRC: 'the instruction came damaged', Error.DATA_RANGE: 'the value is out of range',
               Error.DATA_LENGTH: 'the data is too short for the item', Error.DATA_LIMIT: 'the value is beyond a limit',
               Error.ACCESS: 'there is no such item, or it cannot be accessed'}


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


class StatusScanner:
    """Find whole status packets in a stream that may hold anything.

    Nothing is believed but a packet whose checksum is right: neither a length (a damaged one would swallow what
    follows) nor a header (a packet that was cut off is followed by the next one).
    """

    def __init__(self):
        self._buffer = bytearray()
        self._old = 0

    def mark(self):
        """What has come so far is old: a packet that has begun already cannot answer what is sent next."""
        self._old = len(self._buffer)

    def feed(self, data):
        """Take bytes; returns ``(servo_id, body, old)`` of every whole packet.

        ``body`` is all between length and checksum as it was on the line: status byte, error, parameters. ``old`` says
        whether the packet began before the last :meth:`mark`.
        """
        buffer = self._buffer
        buffer += data
        found, at, keep, after = [], 0, None, 0
        while True:
            at = buffer.find(b'\xff\xff\xfd\x00', at)
            if at < 0:
                break
            if len(buffer) < at + 7:
                keep = at if keep is None else keep
                break
            length = buffer[at + 5] | buffer[at + 6] << 8
            end = at + 7 + length
            if not 4 <= length <= MAX_STATUS:
                at += 1
            elif end > len(buffer):
                keep = at if keep is None else keep     # perhaps more of it comes; look for whole ones behind it
                at += 1
            elif crc16(memoryview(buffer)[at:end - 2]) == buffer[end - 2] | buffer[end - 1] << 8:
                found.append((buffer[at + 4], bytes(buffer[at + 7:end - 2]), at < self._old))
                # one that was cut off may end with what begins the next
                at = after = self._old if at < self._old < end else end
                keep = None
            else:
                at += 1
        # a header may just have begun
        done = keep if keep is not None else max(after, len(buffer) - 6)
        del buffer[:done]
        self._old = max(0, self._old - done)
        return found
