"""One request and the replies that belong to it: Dynamixel Protocol 2.0 from the master's side.

A reply carries an ID and a length, and nothing else that tells what it answers. So a reply is believed only if it began
after its request was sent, comes from a servo that was asked, is a status packet, and has the length asked for; no
request asks for a length that this servo still owes to an earlier request which it left unanswered; and cyclic requests
never ask for the same length twice in a row, as a reply may come twice. Everything else is a stray, counted and
dropped.
"""
import struct
from collections import deque
from dataclasses import dataclass

from style_servo.packets import BROADCAST, HEADER, STATUS, Instruction, StatusScanner, crc16, packet, unstuff

__all__ = ['DynamixelClient', 'Reply', 'FORGET_S', 'PATIENCE_S']

FORGET_S = 0.1          # a reply later than this is never taken for that of the same question asked again
PATIENCE_S = 0.034      # shortest wait for a single servo's reply: adapters may keep it for 16 ms
QUIET_S = 0.001         # of silence before a question to a single servo
_OVERHEAD = 11          # bytes of a status packet besides its parameters


@dataclass(frozen=True)
class Reply:
    """A servo's answer: ``error`` (its number, 0 = none), ``alert`` (a hardware error stands), ``data``."""

    error: int
    alert: bool
    data: bytes


class DynamixelClient:
    """Talk to the servos on a port.

    Parameters
    ----------
    port : SerialPort
        Or anything with its ``send``, ``receive``, ``time`` and ``sleep``.
    baud : int
        Bits a second, for the time that packets take.
    reply_timeout : float
        Wait for replies beyond the time their bits take, s.

    Attributes
    ----------
    strays : int
        Whole packets that came but answered nothing.
    garbled : int
        Questions that something came back to, but not every reply.
    """

    def __init__(self, port, baud, reply_timeout):
        self._port, self._baud, self._timeout = port, baud, reply_timeout
        self._scanner = StatusScanner()
        self._last = {}             # address -> length asked for last
        # (ID, length of the status packet's body) -> until when that reply may come, and whether it was asked again
        self._owed = {}
        self._delays = deque(maxlen=50)
        self.strays = self.garbled = 0

    @property
    def delay(self):
        """How much longer than their bits the recent replies of single servos took: median, s; None if none came."""
        delays = sorted(self._delays)
        return delays[len(delays) // 2] if delays else None

    # --- single servos: patient ---------------------------------------------------------------------------------

    def ping(self, servo_id, patience=PATIENCE_S):
        """Reply with model number (2 bytes) and firmware version, or None."""
        # however late, it says the same
        return self._single(servo_id, bytes((Instruction.PING,)), 3, patience, tolerant=True)

    def read(self, servo_id, address, length, patience=PATIENCE_S):
        """Reply with ``length`` bytes from ``address`` on, or None."""
        return self._single(servo_id, struct.pack('<BHH', Instruction.READ, address, length), length, patience)

    def write(self, servo_id, address, data, patience=PATIENCE_S):
        """Reply to writing, or None."""
        return self._single(servo_id, struct.pack('<BH', Instruction.WRITE, address) + data, 0, patience)

    def reboot(self, servo_id):
        """Reply to a reboot, or None."""
        return self._single(servo_id, bytes((Instruction.REBOOT,)), 0)

    def glance(self, servo_id, address, length):
        """Read once, without waiting longer than in a cycle; None if nothing comes or may be asked for yet."""
        if self._owes(servo_id, length + 2):
            return None
        return self._single(servo_id, struct.pack('<BHH', Instruction.READ, address, length), length,
                            patience=self._timeout, quiet=0.0)

    def _single(self, servo_id, body, length, patience=PATIENCE_S, quiet=QUIET_S, tolerant=False):
        while not tolerant and self._owes(servo_id, length + 2):
            self._drain(0.005)
        self._drain(quiet)
        size = len(body) + 9 + _OVERHEAD + length
        begun = self._port.time()
        answers = self._ask(packet(servo_id, body), {servo_id: length + 2}, 10 * size / self._baud
                            + max(patience, self._timeout), short=True)
        if servo_id not in answers:
            return None
        self._delays.append(self._port.time() - begun - 10 * size / self._baud)
        return _reply(answers[servo_id])

    # --- many servos at once ------------------------------------------------------------------------------------

    def sync_write(self, address, size, parameters):
        """Write to many servos without replies; ``parameters`` holds ID and ``size`` bytes of each."""
        self._drain()
        self._port.send(packet(BROADCAST, struct.pack('<BHH', Instruction.SYNC_WRITE, address, size) + parameters))

    def sync_read(self, ids, address, length, spare, fast=False):
        """The same bytes of many servos in one go.

        Parameters
        ----------
        ids : sequence of int
        address, length : int
        spare : int
            So many bytes more may be asked for, to tell the replies from those still owed.
        fast : bool
            By Fast Sync Read: one status packet that all servos build together.

        Returns
        -------
        dict of int to Reply
            Of the servos that answered; each with ``length`` bytes, or none where its error is not 0.
        """
        self._drain()
        n = len(ids)
        for extra in range(spare + 1):
            asked = length + extra
            expected = {BROADCAST: n * (asked + 4) - 1} if fast else dict.fromkeys(ids, asked + 2)
            if asked != self._last.get(address) and not any(self._owes(*one) for one in expected.items()):
                break
        else:
            return {}       # whatever came could be an old reply
        self._last[address] = asked
        instruction = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
        request = packet(BROADCAST, struct.pack('<BHH', instruction, address, asked) + bytes(ids))
        on_line = len(request) + (8 + n * (asked + 4) if fast else n * (_OVERHEAD + asked))
        answers = self._ask(request, expected, 10 * on_line / self._baud + self._timeout, short=not fast)
        if not fast:
            replies = {servo_id: _reply(body) for servo_id, body in answers.items()}
        else:
            replies = _parts(answers[BROADCAST], ids, asked) if answers else {}
        return {servo_id: Reply(reply.error, reply.alert, reply.data[:length]) for servo_id, reply in replies.items()}

    # --- the line -----------------------------------------------------------------------------------------------

    def _owes(self, servo_id, size):
        return (servo_id, size) in self._owed and self._port.time() < self._owed[servo_id, size][0]

    def _drain(self, quiet=0.0):
        """Take what has come, until nothing does for ``quiet`` s: it answers nothing that will be asked."""
        end = self._port.time() + 0.1       # of a line that babbles for ever
        data = self._port.receive(self._port.time() + quiet)
        while data:
            self.strays += len(self._scanner.feed(data))
            data = self._port.receive(self._port.time() + quiet) if self._port.time() < end else b''
        self._scanner.mark()

    def _ask(self, request, expected, patience, short):
        """Send; collect the bodies (without stuffing) of the replies expected: {ID: length}.

        ``short`` allows a servo to refuse with an error and no data.
        """
        self._drain()
        port, answers = self._port, {}
        port.send(request)
        until = port.time() + patience
        last = heard = False
        while len(answers) < len(expected):
            data = port.receive(until)
            if not data:
                break
            heard = True
            for servo_id, line, old in self._scanner.feed(data):
                body = line if servo_id == BROADCAST else unstuff(line)
                fits = len(body) == expected.get(servo_id) or (
                    short and len(body) == 2 and body[1] & 0x7F and servo_id in expected
                    and not self._owes(servo_id, 2))
                if old or not fits or body[0] != STATUS or servo_id in answers or _cut_off(servo_id, line):
                    self.strays += 1
                else:
                    answers[servo_id] = body
            if port.time() >= until:
                if last:
                    break       # a line that babbles for ever
                last = True     # what came in time is taken, even if this program was late
        self.garbled += heard and len(answers) < len(expected)
        for one in expected.items():
            if one[0] not in answers:
                self._owed[one] = port.time() + FORGET_S, False
            elif not self._owed.pop(one, (0.0, True))[1]:
                # asked again: if this was the late answer, that to the last question is still to come
                self._owed[one] = port.time() + FORGET_S, True
        return answers


def _cut_off(servo_id, line):
    """Whether another packet begins within; a Fast Sync Read's replies are not stuffed, and judged by their parts."""
    return servo_id != BROADCAST and HEADER in line.replace(HEADER + b'\xfd', b'\0')


def _reply(body):
    return Reply(body[1] & 0x7F, bool(body[1] & 0x80), body[2:])


def _parts(body, ids, length):
    """Replies in a Fast Sync Read's status packet: each servo adds error, ID, data and the checksum of all so far."""
    replies, at = {}, 1
    total = len(body) + 2
    crc = crc16(HEADER + bytes((0, BROADCAST, total & 0xFF, total >> 8, STATUS)))
    for k, servo_id in enumerate(ids):
        part = body[at:at + 2 + length]
        crc = crc16(part, crc)
        at += 2 + length
        if part[1] != servo_id:
            return {}
        if k < len(ids) - 1:        # the last one's is that of the whole packet
            if crc != body[at] | body[at + 1] << 8:
                return {}
            crc = crc16(body[at:at + 2], crc)
            at += 2
        replies[servo_id] = Reply(part[0] & 0x7F, bool(part[0] & 0x80), b'' if part[0] & 0x7F else part[2:])
    return replies
