"""One simulated Dynamixel: its memory, what may be written, and what each item does."""
import math

from style_servo.control_ranges import rules
from style_servo.control_table import BAUD_RATES, control_table
from style_servo.packets import Error, Instruction
from style_servo.simulated_motion import OVERLOAD_AFTER_S

__all__ = ['SimulatedServo', 'HARDWARE_ERRORS']

#: Bits of Hardware Error Status.
HARDWARE_ERRORS = {'voltage': 0x01, 'overheating': 0x04, 'encoder': 0x08, 'shock': 0x10, 'overload': 0x20}

FIRMWARE = {'XL330': 52, 'XC330': 52}       # of a new servo; others FIRMWARE_ELSE
FIRMWARE_ELSE = 48
WATCHDOG_FIRMWARE, FAST_FIRMWARE = 38, 45       # the first that know Bus Watchdog, and Fast Sync Read
VOLTAGE = {'XL330': 50, 'XH430-V': 240, 'XH540-V': 240}     # of the supply, 0.1 V; others 12 V, P series 24 V
_GOALS = {'Goal PWM', 'Goal Current', 'Goal Velocity', 'Goal Position'}
# asked for at every packet: kept as attributes beside the memory
_CACHED = {'ID': 'id', 'Baud Rate': 'baud', 'Status Return Level': 'level', 'Bus Watchdog': 'watchdog',
           'Hardware Error Status': 'errors', 'Temperature Limit': 'hottest', 'Homing Offset': 'homing',
           'Secondary(Shadow) ID': 'shadow_id', 'Return Delay Time': 'return_delay', 'Torque Enable': 'torque',
           'Operating Mode': 'mode', 'Firmware Version': 'firmware', 'Min Position Limit': 'low',
           'Max Position Limit': 'high', 'Current Limit': 'most_current'}
# what the motion decides: value of the item for servo, motion, index and time
_LIVE = {
    'Present Position': lambda s, m, i, now: s.counts(m.position.item(i)),
    'Present Velocity': lambda s, m, i, now: round(s.speed_counts(m.velocity.item(i))),
    'Position Trajectory': lambda s, m, i, now: s.counts(m.profile_position.item(i)),
    'Velocity Trajectory': lambda s, m, i, now: round(s.speed_counts(m.profile_velocity.item(i))),
    'Present Load': lambda s, m, i, now: round(1000 * s.sign * m.load.item(i)),
    'Present Current': lambda s, m, i, now: round(s.sign * m.load.item(i) * s.most_current),
    'Present PWM': lambda s, m, i, now: round(885 * s.sign * m.load.item(i)),
    'Present Temperature': lambda s, m, i, now: round(m.temperature.item(i)),
    'Moving': lambda s, m, i, now: abs(s.speed_counts(m.velocity.item(i))) > s.get('Moving Threshold'),
    'Moving Status': lambda s, m, i, now: (
        0x01 * bool(abs(m.goal.item(i) - m.position.item(i)) < 10 * s.table.position_unit)
        | 0x02 * bool(abs(m.profile_velocity.item(i)) > 1e-6)),
    'Realtime Tick': lambda s, m, i, now: int(1000 * (now - s.power_up)) % 32768}
VELOCITY_MODE, POSITION_MODE = 1, 3
TORQUE_ON_BY_GOAL = 0x08        # of Drive Mode
HOMING_LIMIT = 1024             # position values; beyond, Position Control Mode ignores the Homing Offset
MOST_TURNS = 1048575            # position values, in the modes with many turns
REBOOT_S = 0.2


class SimulatedServo:
    """Memory and behaviour of one servo.

    Parameters
    ----------
    servo_id : int
    model_number : int
    motion : Motion
    index : int
        Of this servo in ``motion``.
    baud : int, optional
        Bits a second it is set to; the factory's 57600 if not given.
    """

    def __init__(self, servo_id, model_number, motion, index, baud=57600):
        model = control_table(model_number).model
        firmware = _of_model(FIRMWARE, model, FIRMWARE_ELSE)
        self.table = table = control_table(model_number, firmware)
        self.rules = rules(model_number, firmware)
        if 'Indirect Data 1' not in table or not self.rules:
            raise ValueError(f'{table.model} has an older kind of control table that is not simulated')
        self._motion, self._i = motion, index
        self._size = 1 + max(item.address + item.size for item in table.items.values()) + 128
        self._memory = bytearray(self._size)
        self._at = {item.address: item for item in table.items.values() if not item.name.startswith('Indirect')}
        self._indirect = self._indirect_map()
        self._address_cells = {cell + k for cell in self._indirect.values() for k in (0, 1)}
        self._eeprom_end = table['Torque Enable'].address
        self._owner = [None] * self._size
        for item in self._at.values():
            self._owner[item.address:item.address + item.size] = [item] * item.size
        self.registered = None
        self.awake_at = -math.inf
        self.power_up = self._last_heard = 0.0
        self._factory = {name: rule.initial for name, rule in self.rules.items() if rule.initial is not None}
        self._factory.update({
            'Model Number': model_number, 'Firmware Version': firmware,
            'Present Input Voltage': _of_model(VOLTAGE, model, 120 if table.zero else 240)})
        self.sign, self._shift = 1, 0
        self._plans = {}
        for attribute in _CACHED.values():
            setattr(self, attribute, 0)
        self.hottest, self.level = math.inf, 2
        self._reset(keep=())
        self.set('ID', servo_id)
        if baud not in BAUD_RATES:
            raise ValueError(f'{baud} baud is not one of {BAUD_RATES}')
        self.set('Baud Rate', BAUD_RATES.index(baud))

    def _indirect_map(self):
        """Address of each indirect data byte -> address of the item that says what it shows."""
        table = self.table
        first, data = table['Indirect Address 1'].address, table['Indirect Data 1'].address
        cells = {data + k: first + 2 * k for k in range(min((data - first) // 2, 128))}
        first, data = table['Indirect Address Read'].address, table['Indirect Data Read'].address
        if data - first == 56 and first not in cells.values():      # the second block of the larger X tables
            cells.update({data + k: first + 2 * k for k in range(28)})
        return {cell: address for cell, address in cells.items() if cell < self._size}

    def _signed(self, name):
        rule = self.rules.get(name)
        return rule is not None and rule.signed

    # --- memory -------------------------------------------------------------------------------------------------

    def get(self, name):
        """Value of an item by name."""
        item = self.table[name]
        return int.from_bytes(self._memory[item.address:item.address + item.size], 'little', signed=self._signed(name))

    def set(self, name, value):
        """Set an item by name without any check, if the model has it."""
        item = self.table.items.get(name)
        if item is not None:
            self._memory[item.address:item.address + item.size] = (int(value) & (1 << 8 * item.size) - 1).to_bytes(
                item.size, 'little')
            self._remember(name)

    def _remember(self, name):
        """Keep the attributes beside the memory up to date."""
        if name in _CACHED:
            value = self.get(name)
            setattr(self, _CACHED[name], BAUD_RATES[value] if name == 'Baud Rate' else value)
        elif name == 'Drive Mode':
            self.sign = -1 if self.get(name) & 1 else 1

    def _reset(self, keep):
        """Factory reset of everything except the items in ``keep``."""
        kept = {name: self.get(name) for name in keep}
        self._memory = bytearray(self._size)
        for name, value in {**dict.fromkeys(_CACHED, 0), **self._factory, **kept}.items():
            self.set(name, value)
        self._forget_indirect(0)
        self._clear_ram()

    def _forget_indirect(self, first):
        """Indirect addresses from ``first`` on show their own data again."""
        for cell, address in self._indirect.items():
            if address >= first:
                self._memory[address:address + 2] = cell.to_bytes(2, 'little')
            self._memory[cell] = 0
        self._plans.clear()

    def _clear_ram(self):
        """What power-up does: EEPROM stays, RAM starts at its initial values, torque off."""
        for item in self._at.values():
            if item.address >= self._eeprom_end:
                self.set(item.name, self._factory.get(item.name, 0))
        self._forget_indirect(self._eeprom_end)
        for name, limit in (('Goal PWM', 'PWM Limit'), ('Goal Current', 'Current Limit')):
            if name in self.table:
                self.set(name, self.get(limit))
        motion, i = self._motion, self._i
        motion.torque[i] = motion.halted[i] = False
        motion.speed[i] = motion.acceleration[i] = math.inf
        motion.overloaded[i] = 0.0
        motion.velocity_mode[i] = self.mode == VELOCITY_MODE
        motion.stop_profile(i)
        self._count_within_a_turn()
        self.set('Goal Position', self.counts(motion.position[i]))
        self.registered = None

    def _count_within_a_turn(self):
        """What the encoder knows after power-up, and what counts when torque comes on in Position Control Mode."""
        turn = round(2 * math.pi / self.table.position_unit)
        half = 0 if self.table.zero else turn // 2      # the P series counts from the middle
        raw = round(self.sign * self._motion.position[self._i] / self.table.position_unit)
        self._shift = -turn * ((raw + half) // turn)

    def knows(self, instruction):
        """Whether its firmware knows an instruction."""
        return (instruction not in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ) or not self.table.zero
                or self.firmware >= FAST_FIRMWARE)

    @property
    def _offset(self):
        """Position values between what the encoder counts and what is shown."""
        ignored = self.table.zero and self.mode == POSITION_MODE and abs(self.homing) > HOMING_LIMIT
        return self._shift + (0 if ignored else self.homing)

    def reboot(self, now):
        """Power-up: silent for a moment, RAM at its initial values."""
        self._clear_ram()
        self.power_up = now
        self.awake_at = now + REBOOT_S

    def factory_reset(self, option, now):
        """0xFF everything, 0x01 all but the ID, 0x02 all but ID and baud rate; False for another option."""
        keep = {0xFF: (), 0x01: ('ID',), 0x02: ('ID', 'Baud Rate')}.get(option)
        if keep is None:
            return False
        self._reset(keep)
        self.reboot(now)
        return True

    # --- time ---------------------------------------------------------------------------------------------------

    def heard(self, now):
        """An instruction packet for this servo arrived."""
        self._last_heard = now

    def watch(self, now):
        """What time alone brings: Bus Watchdog, shutdown by overload or heat."""
        motion, i = self._motion, self._i
        if self.watchdog > 0 and motion.torque[i] and now - self._last_heard > 0.020 * self.watchdog:
            self.set('Bus Watchdog', -1)
            self.set('Profile Velocity', 0)
            self.set('Profile Acceleration', 0)
            motion.speed[i] = motion.acceleration[i] = math.inf
            motion.stop_profile(i)
            motion.halted[i] = True
        if motion.overloaded[i] > OVERLOAD_AFTER_S:
            self.fail('overload')
        if motion.temperature[i] > self.hottest:
            self.fail('overheating')

    def fail(self, kind):
        """Raise a hardware error; torque goes off where Shutdown says so."""
        if 'Hardware Error Status' not in self.table:
            return
        self.set('Hardware Error Status', self.get('Hardware Error Status') | HARDWARE_ERRORS[kind])
        if 'Shutdown' not in self.table or self.get('Shutdown') & HARDWARE_ERRORS[kind]:
            self.set('Torque Enable', 0)
            self._motion.torque[self._i] = False

    @property
    def alert(self):
        """The alert bit of every status packet while a hardware error stands."""
        return Error.ALERT if self.errors else 0

    def counts(self, radians):
        """Position value shown for a horn angle."""
        return round(self.sign * radians / self.table.position_unit) + self._offset

    def _refresh(self, names, now):
        """Bring what the motion decides up to date, as far as it is asked for."""
        for name in names:
            item = self.table[name]
            value = int(_LIVE[name](self, self._motion, self._i, now)) & (1 << 8 * item.size) - 1
            self._memory[item.address:item.address + item.size] = value.to_bytes(item.size, 'little')

    def speed_counts(self, speed):
        """Velocity value shown for a speed in rad/s, not rounded."""
        return self.sign * speed / self.table.velocity_unit

    def _plan(self, address, length):
        """Which live items a read shows, and which runs of memory it copies."""
        cells = [address + k for k in range(length)]
        for k, cell in enumerate(cells):
            where = self._indirect.get(cell)
            if where is not None:
                cells[k] = self._memory[where] | self._memory[where + 1] << 8
        cells = [cell if cell < self._size else self._size - 1 for cell in cells]
        names = {self._owner[cell].name for cell in cells if self._owner[cell] is not None}
        runs = []
        for cell in cells:
            if runs and runs[-1][1] == cell:
                runs[-1][1] = cell + 1
            else:
                runs.append([cell, cell + 1])
        return [name for name in _LIVE if name in names], runs

    # --- instructions -------------------------------------------------------------------------------------------

    def read(self, address, length, now):
        """``(error, bytes)``: the error is 0 or a protocol error, then the bytes are empty."""
        if length == 0 or not self._defined(address) or address + length > self._size:
            return Error.ACCESS, b''
        plan = self._plans.get((address, length))
        if plan is None:
            plan = self._plans[address, length] = self._plan(address, length)
        names, runs = plan
        self._refresh(names, now)
        return 0, b''.join([bytes(self._memory[first:last]) for first, last in runs])

    def _defined(self, address):
        """Whether something lies at an address. Gaps within a longer read show 0: the e-manual is silent there."""
        if address >= self._size:
            return False
        item = self._owner[address]
        if item is None:
            return address in self._indirect or address in self._address_cells
        return item.name != 'Bus Watchdog' or not self.table.zero or self.firmware >= WATCHDOG_FIRMWARE

    def write(self, address, data):
        """Write; returns 0 or a protocol error. Nothing is written when any item refuses."""
        if not data or address + len(data) > self._size or not self._defined(address):
            return Error.ACCESS
        item = self._owner[address]
        if item is not None and item.address == address and item.size == len(data):     # the usual case
            error = self._refusal(item, data)
            if not error:
                self._memory[address:address + item.size] = data
                self._remember(item.name)
                self._apply(item.name)
            return error
        direct, cells = [], {}
        k = 0
        while k < len(data):
            cell = address + k
            where = self._indirect.get(cell)
            if where is not None:
                cells[self._memory[where] | self._memory[where + 1] << 8] = data[k]
                k += 1
            elif cell in self._address_cells:
                error = self._refuse_address(cell, data[k:k + 2])
                if error:
                    return error
                direct.append((cell, data[k:k + 2]))
                k += 2
            else:
                item = self._owner[cell]
                if item is None:
                    return Error.ACCESS
                if item.address != cell or len(data) - k < item.size:
                    return Error.DATA_LENGTH
                direct.append((cell, data[k:k + item.size]))
                k += item.size
        for cell in sorted(cells):      # bytes that reach their items through the indirect cells
            if cell in self._indirect:
                direct.append((cell, bytes((cells[cell],))))
                continue
            item = self._owner[cell] if cell < self._size else None
            if item is None or (item.address == cell and any(cell + j not in cells for j in range(item.size))):
                return Error.DATA_LENGTH
            if item.address == cell:
                direct.append((cell, bytes(cells[cell + j] for j in range(item.size))))
        for cell, part in direct:
            item = self._owner[cell]
            error = self._refusal(item, part) if item is not None else 0
            if error:
                return error
        for cell, part in direct:
            self._memory[cell:cell + len(part)] = part
            if self._owner[cell] is not None:
                self._remember(self._owner[cell].name)
                self._apply(self._owner[cell].name)
            else:
                self._plans.clear()     # an indirect address may have changed
        return 0

    def _refuse_address(self, cell, part):
        """Why an indirect address may not be written."""
        if cell not in self._indirect.values() or len(part) < 2:
            return Error.DATA_LENGTH
        if cell < self._eeprom_end and self.torque:
            return Error.ACCESS
        return 0 if self.rules['Indirect Address'].allows(int.from_bytes(part, 'little')) else Error.DATA_RANGE

    def _refusal(self, item, part):
        """Why a value may not be written: 0 or a protocol error."""
        name = item.name
        rule = self.rules.get(name)
        if rule is None or not rule.writable:
            return Error.ACCESS
        if item.address < self._eeprom_end and self.torque:
            return Error.ACCESS
        value = int.from_bytes(part, 'little', signed=rule.signed)
        if name in _GOALS and self.watchdog == -1:
            return Error.DATA_RANGE
        if not rule.allows(value):
            return Error.DATA_RANGE
        if name == 'Torque Enable' and value and self.alert and (
                'Shutdown' not in self.table or self.get('Shutdown') & self.get('Hardware Error Status')):
            return Error.RESULT_FAIL
        if name == 'Goal Position':
            if self.mode == POSITION_MODE:
                return 0 if self.low <= value <= self.high else Error.DATA_LIMIT
            return 0 if not self.table.zero or abs(value) <= MOST_TURNS else Error.DATA_RANGE
        if rule.limit is not None:
            most = self.get(rule.limit)
            return 0 if (-most if rule.signed else 0) <= value <= most else Error.DATA_LIMIT
        return 0

    def _apply(self, name):
        """Effect of a write on the motion."""
        motion, i, table = self._motion, self._i, self.table
        value = self.get(name)
        if name == 'Torque Enable':
            comes_on = value and not motion.torque[i]
            motion.torque[i] = bool(value)
            if comes_on:
                if self.mode == POSITION_MODE:
                    self._count_within_a_turn()
                # the stored goal stays: a client that does not write it first makes the horn move
                motion.stop_profile(i)
                self._apply('Goal Position')
        elif name == 'Goal Position':
            if self.get('Drive Mode') & TORQUE_ON_BY_GOAL and not motion.torque[i]:
                self.set('Torque Enable', 1)
                self._apply('Torque Enable')
                self.set('Goal Position', value)
            motion.goal[i] = self.sign * (value - self._offset) * table.position_unit
        elif name == 'Goal Velocity':
            motion.goal_velocity[i] = self.sign * value * table.velocity_unit
        elif name == 'Profile Velocity':
            motion.speed[i] = value * table.velocity_unit if value else math.inf
        elif name == 'Profile Acceleration':
            motion.acceleration[i] = value * table.acceleration_unit if value else math.inf
        elif name == 'Operating Mode':
            motion.velocity_mode[i] = value == VELOCITY_MODE
        elif name == 'Bus Watchdog' and value == 0:
            motion.halted[i] = False

    def clear_turns(self):
        """Clear instruction: show the position within one turn again; False while moving."""
        motion, i = self._motion, self._i
        if abs(motion.velocity[i]) > 0.05:
            return False
        self._count_within_a_turn()
        self.set('Goal Position', self.counts(motion.position[i]))
        motion.stop_profile(i)
        return True


def _of_model(values, model, otherwise):
    """Value of the longest beginning of a model's name."""
    fitting = [prefix for prefix in values if model.startswith(prefix)]
    return values[max(fitting, key=len)] if fitting else otherwise
