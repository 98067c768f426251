"""A chain on a line that spoils replies, written from the manufacturer's description of Protocol 2.0 alone.

It shares no code with the package: framing, checksum, byte stuffing and memory follow the e-manual ("Protocol 2.0",
"CRC calculation", "XM430-W350"). Time is simulated, so a hundred thousand exchanges take seconds. Every reply carries,
as its position, the number of the request that it answers: whoever shows a number from another packet is found out.
"""
import heapq
import random

HEADER = b'\xff\xff\xfd\x00'
PING, READ, WRITE, REBOOT, STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
BROADCAST = 0xFE
INDIRECT_ADDRESS, INDIRECT_DATA, CELLS = 168, 224, 28
GOAL, POSITION, TORQUE, WATCHDOG = 116, 132, 64, 98
KINDS = ('late', 'later', 'doubled', 'truncated', 'foreign', 'garbled', 'missing', 'noise', 'slow')


def _table():
    rows = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1
        rows.append(crc & 0xFFFF)
    return rows


_CRC = _table()


def checksum(data, crc=0):
    """The e-manual's CRC-16 (IBM, polynomial 0x8005)."""
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ _CRC[crc >> 8 ^ byte]
    return crc


def packet(servo_id, body):
    """Header, ID, length, stuffed body, checksum."""
    body = body.replace(b'\xff\xff\xfd', b'\xff\xff\xfd\xfd')
    head = HEADER + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, 'little') + body
    return head + checksum(head).to_bytes(2, 'little')


def word(data, k):
    return data[k] | data[k + 1] << 8


class FaultyServo:
    """Memory of an XM430 as far as a client needs it."""

    def __init__(self, servo_id, model=1020, firmware=48):
        self.id = servo_id
        self.memory = memory = bytearray(1024)
        memory[0:2] = model.to_bytes(2, 'little')
        memory[6], memory[7], memory[11], memory[68] = firmware, servo_id, 3, 2
        memory[31], memory[32:36] = 80, (160).to_bytes(2, 'little') + (95).to_bytes(2, 'little')
        memory[38:40], memory[44:48] = (1193).to_bytes(2, 'little'), (350).to_bytes(4, 'little')
        memory[48:52] = (4095).to_bytes(4, 'little')
        memory[144:147] = (120).to_bytes(2, 'little') + b'\x1e'
        self.position = 2048
        for k in range(CELLS):
            at = INDIRECT_ADDRESS + 2 * k
            memory[at:at + 2] = (INDIRECT_DATA + k).to_bytes(2, 'little')

    def read(self, address, length):
        memory = self.memory
        memory[POSITION:POSITION + 4] = (self.position & 0xFFFFFFFF).to_bytes(4, 'little')
        return bytes(memory[self._cell(address + k)] for k in range(length))

    def write(self, address, data):
        for k, byte in enumerate(data):
            self.memory[self._cell(address + k)] = byte

    def _cell(self, address):
        if INDIRECT_DATA <= address < INDIRECT_DATA + CELLS:
            return word(self.memory, INDIRECT_ADDRESS + 2 * (address - INDIRECT_DATA))
        return address


class FaultyBus:
    """Port, line and servos in one; what the client's port must offer: ``send``, ``receive``, ``time``, ``sleep``.

    Parameters
    ----------
    ids : sequence of int
    seed : int
    baud : int
    likely : float
        Probability that a reply is spoilt while ``spoiling`` is on.
    """

    def __init__(self, ids, seed=0, baud=1000000, likely=0.4, firmware=48):
        self.servos = {servo_id: FaultyServo(servo_id, firmware=firmware) for servo_id in ids}
        self.random = random.Random(seed)
        self.baud, self.likely = baud, likely
        self.spoiling = False
        self.latency = 0.0          # of the adapter, s: every reply comes so much later
        self.kinds = KINDS
        self.now = 0.0
        self.request = 0            # number of the last request for positions
        self.whole = {}             # servo ID -> its reply to that request came whole and in time
        self.goals = []             # (ID, goal) of every goal written
        self.sent = 0               # bytes that a client sent
        self.intact = 0             # whole packets handed to the client
        self.spoilt = dict.fromkeys(KINDS, 0)
        self._queue, self._serial = [], 0

    # --- the port -----------------------------------------------------------------------------------------------

    def time(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds

    def send(self, data):
        self.sent += len(data)
        self.now += 10 * len(data) / self.baud
        assert data[:4] == HEADER and checksum(data[:-2]) == word(data, len(data) - 2), data
        assert word(data, 5) == len(data) - 7
        body = data[7:-2].replace(b'\xff\xff\xfd\xfd', b'\xff\xff\xfd')
        self._obey(data[4], body[0], body[1:])

    def receive(self, until):
        queue = self._queue
        if queue and queue[0][0] <= max(until, self.now):
            self.now = max(self.now, queue[0][0])
            data = b''
            while queue and queue[0][0] <= self.now:
                _, _, part, intact = heapq.heappop(queue)
                self.intact += intact
                data += part
            return data
        self.now = max(self.now, until)
        return b''

    def close(self):
        pass

    # --- the servos ---------------------------------------------------------------------------------------------

    def _obey(self, servo_id, instruction, parameters):
        servo = self.servos.get(servo_id)
        if instruction == SYNC_WRITE:
            address, length = word(parameters, 0), word(parameters, 2)
            for k in range(4, len(parameters), 1 + length):
                self._write(self.servos[parameters[k]], address, parameters[k + 1:k + 1 + length])
        elif instruction in (SYNC_READ, FAST_SYNC_READ):
            if instruction == FAST_SYNC_READ and any(one.memory[6] < 45 for one in self.servos.values()):
                self.whole = {}
                return      # older firmware does not know it
            self._read_many(parameters, instruction == FAST_SYNC_READ)
        elif servo is not None:
            data = b''
            if instruction == PING:
                data = bytes(servo.memory[0:2]) + bytes(servo.memory[6:7])
            elif instruction == READ:
                data = servo.read(word(parameters, 0), word(parameters, 2))
            elif instruction == WRITE:
                self._write(servo, word(parameters, 0), parameters[2:])
            else:
                raise AssertionError(f'instruction {instruction:#x}')
            self._reply(0.0, (), packet(servo_id, bytes((STATUS, 0)) + data))

    def _write(self, servo, address, data):
        servo.write(address, data)
        if address == GOAL:
            self.goals.append((servo.id, int.from_bytes(data, 'little', signed=True)))

    def _read_many(self, parameters, fast):
        address, length, ids = word(parameters, 0), word(parameters, 2), parameters[4:]
        self.request += 1
        self.whole = dict.fromkeys(ids, False)
        for servo_id in ids:
            self.servos[servo_id].position = self.position_of(self.request, servo_id)
        if not fast:
            start = 0.0
            for servo_id in ids:
                data = packet(servo_id, bytes((STATUS, 0)) + self.servos[servo_id].read(address, length))
                start += self._reply(start, (servo_id,), data)
            return
        total = 3 + len(ids) * (length + 4) - 2
        line = HEADER + bytes((BROADCAST,)) + total.to_bytes(2, 'little') + bytes((STATUS,))
        for servo_id in ids:
            line += bytes((0, servo_id)) + self.servos[servo_id].read(address, length)
            line += checksum(line).to_bytes(2, 'little')
        self._reply(0.0, ids, line)

    @staticmethod
    def position_of(request, servo_id):
        """The position that a servo shows to a request: its number, readable from the count."""
        return 1000 + (97 * request + 31 * servo_id) % 2000

    # --- the line -----------------------------------------------------------------------------------------------

    def _put(self, delay, data, intact=0):
        self._serial += 1
        heapq.heappush(self._queue, (self.now + delay + self.latency, self._serial, data, intact))

    def _reply(self, start, asked, data):
        """Put a reply on the line after ``start`` s, perhaps spoilt; returns the time that it takes, s.

        ``asked`` are the servos whose positions it holds.
        """
        took = 10 * len(data) / self.baud
        after = start + took
        kind = None
        if self.spoiling and self.random.random() < self.likely:
            kind = self.random.choice(self.kinds)
            self.spoilt[kind] += 1
        draw = self.random
        on_time = True
        if kind == 'late':
            on_time = False
            self._put(after + draw.uniform(0.010, 0.030), data, 1)
        elif kind == 'later':
            on_time = False
            self._put(after + draw.uniform(0.030, 0.090), data, 1)
        elif kind == 'slow':
            self._put(after + draw.uniform(0.0, 0.001), data, 1)
        elif kind == 'doubled':
            self._put(after, data, 1)
            self._put(after + draw.uniform(0.0, 0.0005), data, 1)
        elif kind == 'truncated':
            on_time = False
            self._put(after, data[:draw.randrange(len(data))])
        elif kind == 'foreign':
            other = draw.choice((packet(draw.randrange(200, 253), bytes((STATUS, 0)) + draw.randbytes(13)),
                                 packet(draw.choice(list(self.servos)), bytes((STATUS, 0)) + draw.randbytes(3)),
                                 packet(draw.choice(list(self.servos)), bytes((READ,)) + draw.randbytes(4))))
            self._put(after, other, 1)
            self._put(after, data, 1)
        elif kind == 'garbled':
            on_time = False
            # a burst of up to 16 bits, which the checksum always finds
            at = draw.randrange(len(data) - 1)
            burst = (word(data, at) ^ draw.randrange(1, 1 << 16)).to_bytes(2, 'little')
            self._put(after, data[:at] + burst + data[at + 2:])
        elif kind == 'missing':
            on_time = False
        elif kind == 'noise':
            self._put(start, draw.randbytes(draw.randrange(1, 8)).replace(b'\xfd', b'\xfc'))
            self._put(after, data, 1)
        else:
            self._put(after, data, 1)
        self.whole.update(dict.fromkeys(asked, on_time))
        return took
