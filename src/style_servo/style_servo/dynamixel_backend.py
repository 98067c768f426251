"""Dynamixel servos on one bus, Protocol 2.0: goals out and readings in, every cycle."""
import logging
import math
from dataclasses import dataclass

import numpy as np

from style_core.errors import UsageError
from style_servo.backend import BackendFault
from style_servo.bus_backend import BusBackend
from style_servo.dynamixel_client import DynamixelClient
from style_servo.dynamixel_servo import BLOCK_FORMAT, DynamixelServo, hardware_errors, listed
from style_servo.dynamixel_setup import DynamixelSetup
from style_servo.serial_port import SerialPort
from style_servo.servo_health import ServoHealth

__all__ = ['DynamixelBackend', 'DynamixelBus', 'BusSettings']

log = logging.getLogger(__name__)

FAST_FIRMWARE = 45      # of the X series; the first that knows Fast Sync Read
WRITES = 5              # of the first goals, which get no replies
POSTURE_TOLERANCE = 0.05        # rad that a joint may stand outside its limits when torque comes on


@dataclass(frozen=True)
class BusSettings:
    """How to talk to the chain.

    Attributes
    ----------
    port : str
        Device, for example ``/dev/ttyUSB0``.
    baud : int
        Bits a second.
    fast_read : bool
        One Fast Sync Read instead of one status packet a servo (firmware 45 or newer on the X series).
    reply_timeout : float
        Wait for replies beyond the time their bits take, s.
    watchdog : float
        The servos stop when they hear nothing for this long, s (rounded up to 20 ms).
    error_run : int
        So many cycles in a row without an answer are a fault.
    profile_velocity_scale : float
        The servos' own speed limit, in units of the joint's velocity limit.
    reboot : bool
        Reboot servos that stand in a hardware error while connecting.
    """

    port: str
    baud: int = 1000000
    fast_read: bool = True
    reply_timeout: float = 0.004
    watchdog: float = 0.1
    error_run: int = 10
    profile_velocity_scale: float = 1.1
    reboot: bool = False


class DynamixelBackend(BusBackend):
    """Drive the servos of a chain.

    Parameters
    ----------
    chain : Chain
        Every joint with ``id`` and ``model``.
    settings : BusSettings
    period : float
        Of the commands, s.
    open_port : callable, optional
        (name, baud) -> port.
    """

    def __init__(self, chain, settings, period, open_port=SerialPort):
        super().__init__(DynamixelBus(chain, settings, period, open_port, self._count), settings.error_run, period)
        self.statistics['stray replies'] = 0

    def _count(self, strays):
        self.statistics['stray replies'] = strays


class DynamixelBus:
    """See Bus, and DynamixelBackend for the parameters; ``count`` is told the number of stray replies."""

    def __init__(self, chain, settings, period, open_port, count):
        if any(joint.id is None for joint in chain.joints):
            raise UsageError('every joint of a Dynamixel chain needs id and model')
        self.servos = [DynamixelServo(joint) for joint in chain.joints]
        self.settings, self.names, self.port_name = settings, chain.names, settings.port
        self._period, self._open_port, self._count = period, open_port, count
        n = len(self.servos)
        unit = np.array([servo.table.position_unit for servo in self.servos])
        sign = chain.array('sign')
        self._zero = np.array([servo.table.zero for servo in self.servos]) + chain.array('offset') / unit
        self._per_rad = sign / unit
        self._low = np.array([servo.low for servo in self.servos])
        self._high = np.array([servo.high for servo in self.servos])
        self._speed_unit = sign * np.array([servo.table.velocity_unit for servo in self.servos])
        # of a load in 0.1 % where the model does not measure current
        self._effort_unit = sign * np.array([servo.table.current_unit or 0.001 for servo in self.servos])
        self._watchdog = max(1, min(127, math.ceil(settings.watchdog / 0.020 - 1e-9)))
        self._health = ServoHealth(self.servos, period)
        self._port = self.client = None
        self._torque = False
        self._torque_on, self._watchdogs, self._counts = np.zeros((3, n), dtype=int)
        self._make_groups()

    def _make_groups(self):
        goals, reads = {}, {}
        for i, servo in enumerate(self.servos):
            goals.setdefault(servo.table['Goal Position'].address, []).append(i)
            reads.setdefault(servo.table['Indirect Data 1'].address, []).append(i)
        # the packet's parameters, of which only the goals change: ID and goal of every servo
        row = np.dtype([('id', 'u1'), ('goal', '<i4')])
        self._goal_groups = [(address, indices, np.array([(self.servos[i].id, 0) for i in indices], row))
                             for address, indices in goals.items()]
        self._read_groups = []
        for address, indices in reads.items():
            # positions beyond 16 bits may need byte stuffing, of which nobody says how a Fast Sync Read treats it
            fast = self.settings.fast_read and all(self.servos[i].table.zero for i in indices)
            spare = min(self.servos[i].spare_cells for i in indices)
            self._read_groups.append((address, indices, [self.servos[i].id for i in indices], spare, fast))

    # --- connecting ---------------------------------------------------------------------------------------------

    def open(self):
        """Take the port."""
        self._port = self._open_port(self.settings.port, self.settings.baud)
        self.client = DynamixelClient(self._port, self.settings.baud, self.settings.reply_timeout)
        self.setup = DynamixelSetup(self.client, self.servos, self.settings, self._period, self.sleep)

    def set_up(self, notes, facts):
        """Find, check and configure every servo."""
        latency = self._port.latency_timer()
        if latency is not None and latency > 1:
            notes.append(f'port {self.port_name}: the adapter waits up to {latency} ms before it hands over replies; '
                         'set its latency timer to 1 ms (docs/dynamixel_wiring.md)')
        self.setup.run(notes, facts)
        self._make_groups()     # firmware decides where things lie
        self._health.take_limits()

    def sleep(self, seconds):
        """Wait."""
        self._port.sleep(seconds)

    def close(self):
        """Let go of the port."""
        port, self._port, self._torque = self._port, None, False
        if port is not None:
            port.close()

    # --- every cycle --------------------------------------------------------------------------------------------

    def write(self, position):
        """Send goals, inside the limits."""
        self._write_goals(np.minimum(np.maximum(np.rint(self._zero + position * self._per_rad), self._low), self._high))

    def _write_goals(self, counts):
        if not np.isfinite(counts).all():       # no limiter lets this happen
            raise ValueError(f'goals {counts}')
        for address, indices, rows in self._goal_groups:
            rows['goal'] = counts[indices]
            self.client.sync_write(address, 4, rows.tobytes())

    def read(self, measurement):
        """Read every servo; raises when one says that it no longer follows."""
        whole = []
        for address, indices, ids, spare, fast in self._read_groups:
            replies = self.client.sync_read(ids, address, BLOCK_FORMAT.itemsize, spare, fast)
            self._count(self.client.strays)
            if len(replies) < len(ids) or any(reply.error for reply in replies.values()):
                return False
            raw = np.frombuffer(b''.join([replies[servo_id].data for servo_id in ids]), BLOCK_FORMAT)
            whole.append((indices, raw))
        for indices, raw in whole:
            torque, error, watchdog = raw['torque'], raw['error'], raw['watchdog']
            for k in np.flatnonzero((error != 0) | (watchdog < 0) | (self._torque & (torque == 0))):
                self._explain(self.servos[indices[k]], torque[k], int(error[k]), watchdog[k])
        for indices, raw in whole:
            self._torque_on[indices], self._watchdogs[indices] = raw['torque'], raw['watchdog']
            self._counts[indices] = raw['position']
            measurement.effort[indices] = raw['current'] * self._effort_unit[indices]
            measurement.velocity[indices] = raw['velocity'] * self._speed_unit[indices]
            measurement.position[indices] = (raw['position'] - self._zero[indices]) / self._per_rad[indices]
        self._health.feel(measurement.effort)
        return True

    def _explain(self, servo, torque, error, watchdog):
        if error:
            raise BackendFault(f'{servo} reports a hardware error: {hardware_errors(error)}'
                               + ('' if torque else '; it has switched its torque off'))
        if watchdog < 0:
            raise BackendFault(f'{servo}: its Bus Watchdog stopped it, as it heard nothing for '
                               f'{self.settings.watchdog * 1000:.0f} ms: the bridge was late or packets got lost')
        raise BackendFault(f'{servo} lost its torque although nobody switched it off: it has rebooted; look for a dip '
                           'of the supply voltage or a loose cable')

    def read_slowly(self, i, measurement):
        """Voltage and temperature of one servo."""
        table = self.servos[i].table
        voltage, temperature = table['Present Input Voltage'], table['Present Temperature']
        reply = self.client.glance(self.servos[i].id, voltage.address, temperature.address + 1 - voltage.address)
        if reply is None or reply.error:
            return False
        measurement.voltage[i] = 0.1 * (reply.data[0] | reply.data[1] << 8)
        measurement.temperature[i] = reply.data[-1]
        return True

    def warnings(self, measurement):
        """What is about to make a servo shut down."""
        return self._health.warnings(measurement)

    # --- silence ------------------------------------------------------------------------------------------------

    def explain_silence(self, what):
        """Say which servos are missing, or what else is wrong. Quick: the Bus Watchdogs of the others run on."""
        # two questions of different lengths: a late reply to the first is not taken for that to the second
        lost = [servo for servo in self.servos if all(
            self.client.glance(servo.id, servo.table['ID'].address, length) is None for length in (1, 2))]
        if len(lost) == len(self.servos):
            # patiently, so that a slow adapter is not taken for servos that are gone
            if all(self.client.ping(servo.id) is None for servo in self.servos[:2]):
                return BackendFault(f'{what}: no servo answers any more; check power and cable', True)
            lost = []
        if lost:
            verb = 'no longer answers' if len(lost) == 1 else 'no longer answer'
            return BackendFault(f'{what}: {listed(lost)} {verb}, the others do')
        return BackendFault(f'{what}, but every servo answers alone: {self._why_not_together()}')

    def _why_not_together(self):
        delay, timeout = self.client.delay, self.settings.reply_timeout
        if delay is not None and delay > timeout:
            return (f'replies come {1000 * delay:.0f} ms later than their bits need, and reply_timeout is '
                    f'{1000 * timeout:g} ms. USB adapters keep replies for 16 ms unless their latency timer is set to '
                    '1 ms (docs/dynamixel_wiring.md); or raise reply_timeout')
        for address, indices, ids, spare, fast in self._read_groups:
            if not fast:
                continue
            length = BLOCK_FORMAT.itemsize
            slow = [self.client.sync_read(ids, address, length, spare) for _ in range(3)]
            old = [self.servos[i] for i in indices if self.servos[i].firmware < FAST_FIRMWARE]
            if old:
                versions = ', '.join(f'{servo} has firmware {servo.firmware}' for servo in old)
                return (f'Fast Sync Read needs firmware {FAST_FIRMWARE}, and {versions}: update it, or set fast_read '
                        'to false')
            if any(len(replies) == len(ids) for replies in slow):
                versions = ', '.join(sorted({str(self.servos[i].firmware) for i in indices}))
                return f'they answer a Sync Read but no Fast Sync Read (firmware {versions}): set fast_read to false'
        return ('noise on the line, or the replies take longer than the cycle allows (baud rate, latency timer, '
                'reply_timeout)')

    # --- torque -------------------------------------------------------------------------------------------------

    def ready(self, position):
        """Goals to where the joints stand, verified; refused where a servo would not stay there."""
        for servo, counts in zip(self.servos, self._counts):
            if not servo.turn[0] <= counts <= servo.turn[1]:
                raise BackendFault(
                    f'{servo} stands at position value {counts}, outside its turn of {servo.turn[0]} to '
                    f'{servo.turn[1]}: when torque comes on it counts anew, and the goal would be a turn away. Turn it '
                    'back within its turn by hand, or mend its offset')
        goals = np.minimum(np.maximum(self._counts, self._low), self._high)
        outside = np.abs(goals - self._counts) / np.abs(self._per_rad)
        if outside.max() > POSTURE_TOLERANCE:
            i = int(np.argmax(outside))
            raise BackendFault(f'{self.servos[i]} stands {outside[i]:.3f} rad outside its limits: move it inside by '
                               'hand')
        # everything goes to all servos in one packet each: a servo that only hears others being spoken to runs into
        # its watchdog
        self._write_all('Bus Watchdog', 0)
        for _ in range(WRITES):
            self._write_goals(goals)
            wrong = [(servo, goal, found) for servo, goal in zip(self.servos, goals)
                     if (found := self.setup.read(servo, 'Goal Position', signed=True)) != goal]
            if not wrong:
                return
        servo, goal, found = wrong[0]
        raise BackendFault(f'{servo}: its goal is {found} after writing {goal}')

    def torque_on(self):
        """Torque and watchdog on for all."""
        self._write_all('Torque Enable', 1)
        self._write_all('Bus Watchdog', self._watchdog)

    def verify_torque(self):
        """All hold, all watch."""
        for servo, torque, watchdog in zip(self.servos, self._torque_on, self._watchdogs):
            if torque != 1 or watchdog != self._watchdog:
                raise BackendFault(f'{servo}: after switching on, Torque Enable is {torque} and Bus Watchdog '
                                   f'{watchdog} instead of 1 and {self._watchdog}')
        self._torque = True

    def release(self):
        """Torque off for all at once."""
        self._torque = False
        self._write_all('Torque Enable', 0)

    def confirm_release(self):
        """Torque off one by one; reasons where that was not confirmed."""
        failed = []
        for servo in self.servos:
            if len(failed) == 2:
                break       # nobody there; every further one would cost its time-out
            try:
                self.setup.torque_off(servo)
            except BackendFault as error:
                failed.append(str(error))
        return failed

    def _write_all(self, name, value):
        """One item of every servo in one packet (one a group of equal addresses), without answers."""
        groups = {}
        for servo in self.servos:
            groups.setdefault(servo.table[name], []).append(servo)
        for item, servos in groups.items():
            data = value.to_bytes(item.size, 'little')
            self.client.sync_write(item.address, item.size, b''.join(bytes((servo.id,)) + data for servo in servos))
