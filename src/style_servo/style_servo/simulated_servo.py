"""One simulated Dynamixel: its memory, what may be written, and what each item does."""
import math

from style_servo.control_table import BAUD_RATES, control_table
from style_servo.packets import Error
from style_servo.simulated_motion import OVERLOAD_AFTER_S

__all__ = ['SimulatedServo', 'HARDWARE_ERRORS']

#: Bits of Hardware Error Status.
HARDWARE_ERRORS = {'voltage': 0x01, 'overheating': 0x04, 'encoder': 0x08, 'shock': 0x10, 'overload': 0x20}

# factory settings of the X series where nothing more special is known
_FACTORY = {'Firmware Version': 48, 'ID': 1, 'Baud Rate': 1, 'Return Delay Time': 250, 'Operating Mode': 3,
            'Secondary(Shadow) ID': 255, 'Protocol Type': 2, 'Moving Threshold': 10, 'Temperature Limit': 80,
            'Max Voltage Limit': 160, 'Min Voltage Limit': 95, 'PWM Limit': 885, 'Current Limit': 1193,
            'Acceleration Limit': 32767, 'Velocity Limit': 200, 'Max Position Limit': 4095, 'Shutdown': 52,
            'Status Return Level': 2, 'Velocity I Gain': 1920, 'Velocity P Gain': 100, 'Position P Gain': 800,
            'Goal PWM': 885, 'Present Input Voltage': 120}
_SPECIAL = {
    'XL430': {'Temperature Limit': 72, 'Max Voltage Limit': 140, 'Min Voltage Limit': 60, 'Velocity Limit': 265},
    'XL330': {'Temperature Limit': 70, 'Max Voltage Limit': 70, 'Min Voltage Limit': 35, 'Current Limit': 1750,
              'Velocity Limit': 445, 'Shutdown': 53, 'Present Input Voltage': 50},
    'XC330': {'Temperature Limit': 70, 'Max Voltage Limit': 160, 'Min Voltage Limit': 35, 'Current Limit': 910,
              'Velocity Limit': 445, 'Shutdown': 53},
    'XM540': {'Current Limit': 2047, 'Velocity Limit': 128},
    'XH540': {'Current Limit': 2047, 'Velocity Limit': 128},
    'XH430': {'Current Limit': 648, 'Velocity Limit': 280},
    'PH54': {'Max Position Limit': 501433, 'Min Position Limit': -501433, 'Velocity Limit': 2900},
    'PH42': {'Max Position Limit': 303454, 'Min Position Limit': -303454, 'Velocity Limit': 2920},
    # rounded: enough to be driven
    'PM54': {'Max Position Limit': 251173, 'Min Position Limit': -251173, 'Velocity Limit': 2800},
    'PM42': {'Max Position Limit': 262931, 'Min Position Limit': -262931, 'Velocity Limit': 2600},
    'H54': {'Max Position Limit': 501433, 'Min Position Limit': -501433, 'Velocity Limit': 2900},
    'H42': {'Max Position Limit': 303454, 'Min Position Limit': -303454, 'Velocity Limit': 2600},
    'M54': {'Max Position Limit': 250961, 'Min Position Limit': -250961, 'Velocity Limit': 2800},
    'M42': {'Max Position Limit': 262931, 'Min Position Limit': -262931, 'Velocity Limit': 2600},
}
_READ_ONLY = {'Model Number', 'Model Information', 'Firmware Version', 'Registered Instruction', 'Realtime Tick',
              'Hardware Error Status', 'Moving', 'Moving Status', 'Velocity Trajectory', 'Position Trajectory',
              'Backup Ready', 'Controller State', 'Error Code'}
_SIGNED = {'Homing Offset', 'Goal PWM', 'Goal Current', 'Goal Velocity', 'Goal Position', 'Max Position Limit',
           'Min Position Limit', 'Bus Watchdog'}
_GOALS = {'Goal PWM', 'Goal Current', 'Goal Velocity', 'Goal Position'}
# asked for at every packet: kept as attributes beside the memory
_CACHED = {'ID': 'id', 'Baud Rate': 'baud', 'Status Return Level': 'level', 'Bus Watchdog': 'watchdog',
           'Hardware Error Status': 'errors', 'Temperature Limit': 'hottest', 'Homing Offset': 'homing',
           'Secondary(Shadow) ID': 'shadow_id', 'Return Delay Time': 'return_delay', 'Torque Enable': 'torque',
           'Operating Mode': 'mode', 'Min Position Limit': 'low', 'Max Position Limit': 'high',
           'Current Limit': 'most_current'}
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
        self.table = table = control_table(model_number)
        if 'Indirect Data 1' not in table:
            raise ValueError(f'{table.model} has an older kind of control table that is not simulated')
        self._motion, self._i = motion, index
        self._size = max(item.address + item.size for item in table.items.values()) + 64
        self._memory = bytearray(self._size)
        self._at = {item.address: item for item in table.items.values() if not item.name.startswith('Indirect')}
        self._indirect = self._indirect_map()
        self._address_cells = {cell + k for cell in self._indirect.values() for k in (0, 1)}
        self._eeprom_end = min(table['Torque Enable'].address, table['Indirect Address 1'].address
                               if table['Indirect Address 1'].address < table['Torque Enable'].address else 10**6)
        self._owner = [None] * self._size
        for item in self._at.values():
            self._owner[item.address:item.address + item.size] = [item] * item.size
        self.registered = None
        self.awake_at = -math.inf
        self.power_up = self._last_heard = 0.0
        self._factory = dict(_FACTORY)
        for prefix, values in _SPECIAL.items():
            if table.model.startswith(prefix):
                self._factory.update(values)
        self._factory.update({'Model Number': model_number})
        self.sign = 1
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

    # --- memory -------------------------------------------------------------------------------------------------

    def get(self, name):
        """Value of an item by name."""
        item = self.table[name]
        return int.from_bytes(self._memory[item.address:item.address + item.size], 'little', signed=name in _SIGNED)

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
        self._clear_ram()

    def _clear_ram(self):
        """What power-up does: EEPROM stays, RAM starts at its initial values, torque off."""
        for item in self._at.values():
            if item.address >= self._eeprom_end:
                self.set(item.name, self._factory.get(item.name, 0))
        for cell, address in self._indirect.items():
            self._memory[address:address + 2] = cell.to_bytes(2, 'little')
            self._memory[cell] = 0
        self._plans.clear()
        for name, limit in (('Goal PWM', 'PWM Limit'), ('Goal Current', 'Current Limit')):
            if name in self.table:
                self.set(name, self.get(limit))
        motion, i = self._motion, self._i
        motion.torque[i] = motion.halted[i] = False
        motion.speed[i] = motion.acceleration[i] = math.inf
        motion.overloaded[i] = 0.0
        motion.velocity_mode[i] = self.mode == VELOCITY_MODE
        motion.stop_profile(i)
        self.set('Goal Position', self.counts(motion.position[i]))
        self.registered = None

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
        return round(self.sign * radians / self.table.position_unit) + self.homing

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
        if length == 0 or address + length > self._size:
            return Error.ACCESS, b''
        plan = self._plans.get((address, length))
        if plan is None:
            plan = self._plans[address, length] = self._plan(address, length)
        names, runs = plan
        self._refresh(names, now)
        return 0, b''.join([bytes(self._memory[first:last]) for first, last in runs])

    def write(self, address, data):
        """Write; returns 0 or a protocol error. Nothing is written when any item refuses."""
        if not data or address + len(data) > self._size:
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
            elif self._is_indirect_address(cell):
                direct.append((cell, data[k:k + 1]))
                k += 1
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

    def _is_indirect_address(self, cell):
        return cell in self._address_cells

    def _refusal(self, item, part):
        """Why a value may not be written: 0 or a protocol error."""
        name = item.name
        if name in _READ_ONLY or name.startswith(('Present', 'Error Code')):
            return Error.ACCESS
        if item.address < self._eeprom_end and self.torque:
            return Error.ACCESS
        value = int.from_bytes(part, 'little', signed=name in _SIGNED)
        if name in _GOALS and self.watchdog == -1:
            return Error.DATA_RANGE
        if name == 'Torque Enable' and value and self.alert and (
                'Shutdown' not in self.table or self.get('Shutdown') & self.get('Hardware Error Status')):
            return Error.RESULT_FAIL
        if name == 'Bus Watchdog':
            return 0 if 0 <= value <= 127 else Error.DATA_RANGE
        limits = self._range(name)
        if limits and not limits[0] <= value <= limits[1]:
            return Error.DATA_LIMIT if name in _GOALS else Error.DATA_RANGE
        return 0

    def _range(self, name):
        if name == 'Goal Position':
            if self.mode == POSITION_MODE:
                return self.low, self.high
            return -1048575, 1048575
        symmetric = {'Goal Velocity': 'Velocity Limit', 'Goal Current': 'Current Limit', 'Goal PWM': 'PWM Limit'}
        if name in symmetric and symmetric[name] in self.table:
            limit = self.get(symmetric[name])
            return -limit, limit
        if name in ('Min Position Limit', 'Max Position Limit') and self.table.zero:
            return 0, 4095
        return {'ID': (0, 252), 'Baud Rate': (0, len(BAUD_RATES) - 1), 'Return Delay Time': (0, 254),
                'Status Return Level': (0, 2), 'Torque Enable': (0, 1), 'Profile Velocity': (0, 32767),
                'Profile Acceleration': (0, 32767), 'Temperature Limit': (0, 100)}.get(name) or (
            {'Operating Mode': (0, 16)}.get(name) if self.table.zero else None)

    def _apply(self, name):
        """Effect of a write on the motion."""
        motion, i, table = self._motion, self._i, self.table
        value = self.get(name)
        if name == 'Torque Enable':
            if value and not motion.torque[i]:
                # the stored goal stays: a client that does not write it first makes the horn move
                motion.stop_profile(i)
                self._apply('Goal Position')
            motion.torque[i] = bool(value)
        elif name == 'Goal Position':
            motion.goal[i] = self.sign * (value - self.homing) * table.position_unit
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
        motion.position[i] = math.remainder(motion.position[i] - math.pi, 2 * math.pi) + math.pi
        motion.stop_profile(i)
        return True
