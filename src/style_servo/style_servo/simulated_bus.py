"""A chain of simulated Dynamixels on one half-duplex bus: instruction packets in, timed status packets out."""
import random
from dataclasses import dataclass

from style_servo.packets import BROADCAST, HEADER, STATUS, Error, Instruction, crc16, status
from style_servo.simulated_motion import Motion
from style_servo.simulated_servo import SimulatedServo

__all__ = ['SimulatedBus', 'Reply']

EVERYTHING = 0xFF       # option of a Factory Reset


@dataclass
class Reply:
    """Bytes that leave the bus ``delay`` seconds after the instruction arrived."""

    delay: float
    data: bytes


class SimulatedBus:
    """All servos of one chain.

    Parameters
    ----------
    servos : iterable of (int, int, float)
        ID, model number and horn angle at start (rad from the servo's position value 0). The same ID twice makes two
        servos that answer at once.
    baud : int
        Bits a second that every servo is set to.
    seed : int
        Of the faults' randomness.
    true_timing : bool
        Let replies take the time that the bits and the servos' return delay need on a real line.

    Attributes
    ----------
    on_goal : callable, optional
        Called with (now, {id: goal position}) after every instruction that wrote goal positions.
    instructions : dict
        Packets understood, by instruction byte.
    excused : float
        S for which the servos did not listen, because this program was not running: their watchdogs do not count it.
    """

    def __init__(self, servos, baud=1000000, seed=0, true_timing=False):
        servos = list(servos)
        self.motion = Motion([start for _, _, start in servos])
        self.servos = [SimulatedServo(servo_id, model, self.motion, i, baud)
                       for i, (servo_id, model, _) in enumerate(servos)]
        self.true_timing = true_timing
        self.on_goal = None
        self.instructions = {}
        self.excused = 0.0
        self._random = random.Random(seed)
        self._faults = {}

    # --- faults -------------------------------------------------------------------------------------------------

    def add_fault(self, kind, servo_id=None, count=1, seconds=0.0, probability=1.0):
        """Spoil the next ``count`` replies of a servo (or of any): 'drop', 'corrupt' or 'delay' by ``seconds``.

        A count of -1 lasts until :meth:`clear_faults`.
        """
        if kind not in ('drop', 'corrupt', 'delay'):
            raise ValueError(f"a reply can be dropped, corrupted or delayed, not {kind!r}")
        self._faults.setdefault(servo_id, []).append([kind, count, seconds, probability])

    def clear_faults(self, servo_id=None):
        """Forget the faults of one servo, or all of them."""
        if servo_id is None:
            self._faults.clear()
        else:
            self._faults.pop(servo_id, None)

    def with_id(self, servo_id):
        """Servos that listen to an ID."""
        return [servo for servo in self.servos if servo.id == servo_id]

    def _spoil(self, servo_id, data):
        """Apply the faults of one reply: (extra delay, bytes or None)."""
        delay = 0.0
        for key in (servo_id, None):
            for fault in self._faults.get(key, ()):
                kind, count, seconds, probability = fault
                if count == 0 or self._random.random() > probability:
                    continue
                fault[1] -= count > 0
                if kind == 'drop':
                    return 0.0, None
                if kind == 'delay':
                    delay += seconds
                elif data:
                    k = self._random.randrange(4, len(data))
                    data = data[:k] + bytes((data[k] ^ 1 << self._random.randrange(8),)) + data[k + 1:]
        return delay, data

    # --- time ---------------------------------------------------------------------------------------------------

    def advance(self, now):
        """Move all servos to time ``now`` (s)."""
        self.motion.advance(now)
        for servo in self.servos:
            servo.watch(now - self.excused)

    # --- instructions -------------------------------------------------------------------------------------------

    def handle(self, servo_id, instruction, parameters, crc_ok, now, baud=None):
        """Carry out one instruction packet; returns the replies in order.

        ``baud`` is the speed at which the packet was sent: servos set to another speed do not understand it.
        """
        self.advance(now)
        listening = [s for s in self.servos
                     if now >= s.awake_at and baud in (None, s.baud)]
        if instruction == STATUS:
            return []
        if not crc_ok:
            return self._together([(servo_id, s, Error.CRC, b'') for s in listening if s.id == servo_id])
        self.instructions[instruction] = self.instructions.get(instruction, 0) + 1
        everyone = servo_id == BROADCAST
        for servo in listening:
            if everyone or servo.id == servo_id:
                servo.heard(now - self.excused)
        if instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ, Instruction.BULK_READ,
                           Instruction.FAST_BULK_READ, Instruction.SYNC_WRITE, Instruction.BULK_WRITE):
            if not everyone:
                return self._together([(servo_id, s, Error.INSTRUCTION, b'') for s in listening
                                       if s.id == servo_id])
            return self._group(instruction, parameters, listening, now)
        goals = {}
        answers = []
        for servo in listening:
            mine = servo.id == servo_id
            shadow = servo.shadow_id == servo_id <= 252
            if not (mine or everyone or shadow):
                continue
            # taken before the instruction changes them
            own_id, level, goal = servo.id, servo.level, servo.get('Goal Position')
            answer = self._single(servo, instruction, parameters, now, everyone)
            if servo.get('Goal Position') != goal:
                goals[own_id] = servo.get('Goal Position')
            needed = {Instruction.PING: 0, Instruction.READ: 1}.get(instruction, 2)
            if answer is not None and level >= needed and (mine or (everyone and instruction == Instruction.PING)):
                answers.append((own_id, servo, *answer))
        if goals and self.on_goal:
            self.on_goal(now, goals)
        if everyone:
            return self._in_turn(sorted(answers, key=lambda answer: answer[0]))
        return self._together(answers)

    def _single(self, servo, instruction, parameters, now, everyone=False):
        """(error, data) of an instruction for one servo, None for one without an answer."""
        if instruction == Instruction.PING:
            return 0, servo.get('Model Number').to_bytes(2, 'little') + bytes((servo.get('Firmware Version'),))
        if instruction == Instruction.READ:
            if len(parameters) != 4:
                return Error.DATA_LENGTH, b''
            return servo.read(_word(parameters, 0), _word(parameters, 2), now)
        if instruction in (Instruction.WRITE, Instruction.REG_WRITE):
            if len(parameters) < 3:
                return Error.DATA_LENGTH, b''
            if instruction == Instruction.WRITE:
                return servo.write(_word(parameters, 0), parameters[2:]), b''
            servo.registered = _word(parameters, 0), parameters[2:]
            servo.set('Registered Instruction', 1)
            return 0, b''
        if instruction == Instruction.ACTION:
            if servo.registered is None:
                return Error.INSTRUCTION, b''
            address, data = servo.registered
            servo.registered = None
            servo.set('Registered Instruction', 0)
            return servo.write(address, data), b''
        if instruction == Instruction.REBOOT:
            servo.reboot(now)
            return 0, b''
        if instruction == Instruction.FACTORY_RESET:
            if len(parameters) != 1:
                return Error.DATA_LENGTH, b''
            if everyone and parameters[0] == EVERYTHING:
                return Error.RESULT_FAIL, b''      # would give all servos of a chain one ID
            return 0 if servo.factory_reset(parameters[0], now) else Error.DATA_RANGE, b''
        if instruction == Instruction.CLEAR:
            if parameters != b'\x01\x44\x58\x4c\x22':
                return Error.DATA_RANGE, b''
            return 0 if servo.clear_turns() else Error.RESULT_FAIL, b''
        return Error.INSTRUCTION, b''

    def _group(self, instruction, parameters, listening, now):
        by_id = {}
        for servo in listening:
            by_id.setdefault(servo.id, []).append(servo)
        if instruction in (Instruction.SYNC_WRITE, Instruction.BULK_WRITE):
            self._group_write(instruction, parameters, by_id, now)
            return []
        if instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
            address, length = _word(parameters, 0), _word(parameters, 2)
            wanted = [(servo_id, address, length) for servo_id in parameters[4:]]
        else:
            wanted = [(parameters[k], _word(parameters, k + 1), _word(parameters, k + 3))
                      for k in range(0, len(parameters) - 4, 5)]
        fast = instruction in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
        answers = []
        for servo_id, address, length in wanted:
            servos = [s for s in by_id.get(servo_id, ()) if s.level >= 1 and s.knows(instruction)]
            if not servos:
                break       # every servo waits for the one before it in the list
            error, data = servos[0].read(address, length, now)
            answers.append((servo_id, servos[0], error, data if data or not fast else bytes(length)))
        if fast:
            return self._fast(answers, [length for _, _, length in wanted])
        return self._in_turn(answers)

    def _group_write(self, instruction, parameters, by_id, now):
        if instruction == Instruction.SYNC_WRITE:
            address, length = _word(parameters, 0), _word(parameters, 2)
            parts = [(parameters[k], address, parameters[k + 1:k + 1 + length])
                     for k in range(4, len(parameters), 1 + length)]
        else:
            parts, k = [], 0
            while k + 5 <= len(parameters):
                length = _word(parameters, k + 3)
                parts.append((parameters[k], _word(parameters, k + 1), parameters[k + 5:k + 5 + length]))
                k += 5 + length
        goals = {}
        for servo_id, address, data in parts:
            for servo in by_id.get(servo_id, ()):
                if servo.write(address, data) == 0 and address == servo.table['Goal Position'].address:
                    goals[servo_id] = servo.get('Goal Position')
        if goals and self.on_goal:
            self.on_goal(now, goals)

    # --- replies ------------------------------------------------------------------------------------------------

    def _delay(self, servo, n_bytes):
        """Time on the line of a reply, s."""
        if not self.true_timing:
            return 0.0
        return 2e-6 * servo.return_delay + 10.0 * n_bytes / servo.baud

    def _in_turn(self, answers):
        """One status packet after the other."""
        replies, clock = [], 0.0
        for servo_id, servo, error, data in answers:
            late, whole = self._spoil(servo_id, status(servo_id, error | servo.alert, data))
            if whole is None:
                continue
            clock += self._delay(servo, len(whole)) + late
            replies.append(Reply(clock, whole))
        return replies

    def _together(self, answers):
        """Status packets of servos that share an ID collide: a dominant 0 wins, bits of both get lost."""
        if len(answers) <= 1:
            return self._in_turn(answers)
        line = b''
        for servo_id, servo, error, data in answers:
            idle = b'\xff' * (self._random.randrange(1, 3) if line else 0)      # never quite at the same moment
            whole = idle + status(servo_id, error | servo.alert, data)
            n = max(len(line), len(whole))
            line = bytes(a & b for a, b in zip(line.ljust(n, b'\xff'), whole.ljust(n, b'\xff')))
        return [Reply(self._delay(answers[0][1], len(line)), line)]

    def _fast(self, answers, lengths):
        """One status packet built by all servos in turn; each adds its part and the CRC of everything so far."""
        total = 1 + sum(length + 4 for length in lengths)
        line = HEADER + bytes((0, BROADCAST, total & 0xFF, total >> 8, STATUS))
        crc = crc16(line)
        clock = 0.0
        for servo_id, servo, error, data in answers:
            part = bytes((error | servo.alert, servo_id)) + data
            crc = crc16(part, crc)
            part += crc.to_bytes(2, 'little')
            crc = crc16(part[-2:], crc)
            late, sent = self._spoil(servo_id, bytes(4) + part)
            if sent is None:
                break
            line += sent[4:]
            clock += late + self._delay(servo, len(part))
        return [Reply(clock, line)] if len(line) > 8 else []


def _word(data, k):
    return data[k] | data[k + 1] << 8 if k + 1 < len(data) else 0
