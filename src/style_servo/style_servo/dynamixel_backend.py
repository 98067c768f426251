"""Dynamixel servos on one bus through dynamixel-sdk, Protocol 2.0."""
import contextlib
import errno
import fcntl
import logging
import math
import os
import select
import struct
import termios
import time
from dataclasses import dataclass

import numpy as np
from dynamixel_sdk import (
    COMM_RX_CORRUPT,
    COMM_SUCCESS,
    GroupSyncRead,
    GroupSyncWrite,
    PortHandler,
)
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from style_core.errors import UsageError
from style_core.wire.crc16 import crc16
from style_servo.backend import BackendFault, Measurement
from style_servo.control_table import control_table, model_named, models

__all__ = ['DynamixelBackend', 'BusSettings']

log = logging.getLogger(__name__)

POSITION_MODE = 3
TIME_PROFILE = 0x04         # bit of Drive Mode
ALERT = 0x80                # bit of a status packet's error
TRIES = 5
# the one position value whose bytes (FF FF FD FF) look like the start of a packet; the SDK sends it without stuffing
UNSENDABLE = -131073
LINGER_S = 0.02       # after a failed question, so that a late answer is not taken for that of the next
_GONE = (OSError, termios.error, TypeError)     # serial.SerialException is an OSError; TypeError: closed underneath
_HARDWARE = {0x01: 'input voltage', 0x04: 'overheating', 0x08: 'encoder', 0x10: 'electrical shock', 0x20: 'overload'}
# read every cycle through the indirect data block, in this order
_FAST = (('Torque Enable', 1), ('Hardware Error Status', 1), ('Bus Watchdog', 1), ('Present Current', 2),
         ('Present Velocity', 4), ('Present Position', 4))
_FAST_FORMAT = np.dtype([('torque', 'u1'), ('error', 'u1'), ('watchdog', 'i1'), ('current', '<i2'),
                         ('velocity', '<i4'), ('position', '<i4')])


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


def _signed(value, size):
    return value - (1 << 8 * size) if value >= 1 << 8 * size - 1 else value


def hardware_errors(bits):
    """Names of the bits of Hardware Error Status."""
    return ', '.join(name for bit, name in _HARDWARE.items() if bits & bit) or f'code {bits}'


class _Port(PortHandler):
    """The SDK's port, which sleeps until something arrives where the SDK asks over and over.

    The SDK waits some 34 ms for the answer of a single servo; ``reply_timeout`` (s), where that is longer.
    """

    def __init__(self, name, reply_timeout):
        super().__init__(name)
        self._reply_timeout = reply_timeout

    def setPacketTimeout(self, packet_length):
        """As long as the SDK says, and not shorter than set."""
        super().setPacketTimeout(packet_length)
        self.packet_timeout = max(self.packet_timeout, 1000 * self._reply_timeout)

    def readPort(self, length):
        """Up to ``length`` bytes, as soon as there are any or the packet's time is over."""
        left = self.packet_timeout - self.getTimeSinceStart()
        if length and left > 0:
            select.select([self.ser.fileno()], [], [], left / 1000)
        return self.ser.read(length)


class _Packets(Protocol2PacketHandler):
    """The SDK's packets; it makes the table of the checksum anew for each, a quarter of a cycle's processor time."""

    def updateCRC(self, crc_accum, data_blk_ptr, data_blk_size):
        """Checksum of the first bytes of a packet."""
        return crc16(bytes(data_blk_ptr[:data_blk_size]), crc_accum)


class _Servo:
    """A joint's servo: its table and the conversion between joint angle and position value."""

    def __init__(self, joint):
        self.joint = joint
        self.id = joint.id
        self.model_number = model_named(joint.model)
        self.table = table = control_table(self.model_number)
        for needed in ('Indirect Data 1', 'Bus Watchdog', 'Goal Position', 'Profile Velocity', 'Drive Mode'):
            if needed not in table:
                raise UsageError(f'joint {joint.name}: {table.model} has no {needed}, which the bridge needs')
        if table['Bus Watchdog'].size != 1:
            raise UsageError(f'joint {joint.name}: the control table of {table.model} is not supported yet')
        ends = sorted((self.counts(joint.lower), self.counts(joint.upper)))
        # towards the inside: a rounded command must not leave the limits
        self.low, self.high = math.ceil(ends[0] - 1e-9), math.floor(ends[1] + 1e-9)
        if table.zero and not (self.low >= 0 and self.high <= 4095):
            raise UsageError(f'joint {joint.name}: limits {joint.lower:.3f} to {joint.upper:.3f} rad become the '
                             f'position values {self.low} to {self.high}, but {table.model} has 0 to 4095: '
                             'mend offset, sign or limits')

    def __str__(self):
        return f'joint {self.joint.name} (ID {self.id}, {self.table.model})'

    def counts(self, angle):
        """Position value, not rounded, of a joint angle in rad."""
        return self.table.zero + (self.joint.offset + self.joint.sign * angle) / self.table.position_unit

    @property
    def load_item(self):
        """Name of the item with the motor's effort."""
        return 'Present Current' if 'Present Current' in self.table else 'Present Load'


class DynamixelBackend:
    """Drive the servos of a chain.

    Parameters
    ----------
    chain : Chain
        Every joint with ``id`` and ``model``.
    settings : BusSettings
    period : float
        Of the commands, s.
    """

    def __init__(self, chain, settings, period):
        if any(joint.id is None for joint in chain.joints):
            raise UsageError('every joint of a Dynamixel chain needs id and model')
        self._servos = [_Servo(joint) for joint in chain.joints]
        self._settings = settings
        self._period = period
        n = len(self._servos)
        self.measurement = Measurement.unknown(n)
        self.statistics = {'cycles': 0, 'read errors': 0, 'write errors': 0, 'slow read errors': 0, 'longest run': 0}
        self.notes = []
        unit = np.array([servo.table.position_unit for servo in self._servos])
        sign = chain.array('sign')
        self._zero = np.array([servo.table.zero for servo in self._servos]) + chain.array('offset') / unit
        self._per_rad = sign / unit
        self._low = np.array([servo.low for servo in self._servos])
        self._high = np.array([servo.high for servo in self._servos])
        self._speed_unit = sign * np.array([servo.table.velocity_unit for servo in self._servos])
        # of a load in 0.1 % where the model does not measure current
        self._effort_unit = sign * np.array([servo.table.current_unit or 0.001 for servo in self._servos])
        self._port = None
        self._packets = _Packets()
        self._run = 0
        self._torque = False
        self._torque_on, self._watchdogs = np.zeros((2, n), dtype=int)
        self._slow_turn = 0
        self._slow_every = max(1, round(1.0 / period / n))

    # --- connecting ---------------------------------------------------------------------------------------------

    def connect(self):
        """Open the port, find every servo, write and verify its settings; torque is off afterwards."""
        self.close()
        self.notes.clear()
        self._open()
        try:
            self._find()
            for servo in self._servos:
                self._configure(servo)
            self._make_groups()
            any(self._read_all() for _ in range(TRIES))
            for _ in self._servos:
                self._read_slowly()
        except _GONE as error:
            raise self._unplugged(error) from None
        except BaseException:
            with contextlib.suppress(*_GONE):
                self._release()
            self._abandon()
            raise

    def _open(self):
        settings = self._settings
        port = _Port(settings.port, settings.reply_timeout)
        where = f'port {settings.port}'
        try:
            if not port.setBaudRate(settings.baud):
                raise BackendFault(f'{where}: {settings.baud} baud is not a speed the SDK can set', True)
        except _GONE as error:
            # pyserial hides the number of some errors in the error that it caught
            numbers = [getattr(one, 'errno', None) or (one.args or (None,))[0]
                       for one in (error, error.__context__) if one is not None]
            number = next((one for one in numbers if isinstance(one, int)), None)
            text = {
                errno.ENOENT: 'there is no such device: is the adapter plugged in, and is the name right?',
                errno.EACCES: 'no permission to read and write it: add yourself to its group (usually dialout) and log '
                              'in again, or install the udev rule in docs/dynamixel_wiring.md',
                errno.EROFS: 'it is read-only: the servos need a port that can be written',
                errno.EPERM: 'no permission to use it as a serial port',
                errno.EBUSY: 'another program uses it',
                errno.ENOTTY: 'it is not a serial port',
                errno.EIO: 'the adapter does not respond: plug it in again',
            }.get(number, str(error))
            raise BackendFault(f'{where}: {text}', True) from None
        self._port = port
        try:
            fcntl.flock(port.ser.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.close()
            raise BackendFault(f'{where}: another program uses it (two masters on one bus garble every packet)',
                               True) from None
        name = os.path.basename(os.path.realpath(settings.port))
        timer = f'/sys/bus/usb-serial/devices/{name}/latency_timer'
        if os.path.exists(timer):
            with open(timer) as file:
                latency = int(file.read())
            if latency > 1:
                self.notes.append(f'{where}: the adapter waits up to {latency} ms before it hands over replies; set '
                                  'its latency timer to 1 ms (docs/dynamixel_wiring.md)')

    def _find(self):
        """Every servo answers a ping, alone and with the right model number."""
        failed = self._ping(self._servos)
        if failed and len(failed) < len(self._servos):
            failed = self._ping(failed)     # a computer that was busy for a moment has missed their answers
        garbled = [servo for servo, results in failed.items() if COMM_RX_CORRUPT in results]
        if garbled:
            raise BackendFault(f'{_list(garbled)}: replies are garbled although others get through; most likely two '
                               'servos share that ID (connect them one at a time and give each its own)')
        if len(failed) == len(self._servos):
            raise BackendFault(f'no servo answers on {self._settings.port} at {self._settings.baud} baud: check the '
                               "motors' power, the cable, and the baud rate the servos are set to")
        if failed:
            raise BackendFault(f'{_list(failed)}: no answer, while others do: check ID, cable and baud rate')

    def _ping(self, servos):
        """Those that do not answer, with what came of each try."""
        failed = {}
        for servo in servos:
            results = []
            for _ in range(TRIES):
                number, result, error = self._packets.ping(self._port, servo.id)
                results.append(result)
                if result == COMM_SUCCESS:
                    break
                time.sleep(LINGER_S)
            if result != COMM_SUCCESS:
                failed[servo] = results
                continue
            if number != servo.model_number:
                found = models().get(number, 'unknown model')
                raise BackendFault(f'ID {servo.id} is a {found} (model number {number}), but joint {servo.joint.name} '
                                   f'should be a {servo.table.model} ({servo.model_number}): wrong ID or chain file')
            if error & ALERT:
                self._mend(servo)
        return failed

    def _mend(self, servo):
        bits = self._read(servo, 'Hardware Error Status')
        if not bits:
            return
        if not self._settings.reboot:
            raise BackendFault(f'{servo} stands in a hardware error: {hardware_errors(bits)}. Find the cause, then '
                               'switch its power off and on, or allow the bridge to reboot it')
        self._packets.reboot(self._port, servo.id)
        self.notes.append(f'{servo} stood in a hardware error ({hardware_errors(bits)}) and was rebooted')
        for _ in range(50):
            time.sleep(0.02)
            if self._packets.ping(self._port, servo.id)[1:] == (COMM_SUCCESS, 0):
                return
        raise BackendFault(f'{servo} still stands in a hardware error after a reboot: {hardware_errors(bits)}')

    def _configure(self, servo):
        """Write what differs, read everything back."""
        joint, table = servo.joint, servo.table
        self._write(servo, 'Torque Enable', 0)
        settings = {
            'Status Return Level': 2, 'Return Delay Time': 0, 'Operating Mode': POSITION_MODE,
            'Drive Mode': self._read(servo, 'Drive Mode') & ~TIME_PROFILE,
            'Min Position Limit': servo.low, 'Max Position Limit': servo.high, 'Bus Watchdog': 0}
        top = self._read(servo, 'Velocity Limit')
        if top * table.velocity_unit < joint.velocity:
            self.notes.append(f'{servo}: its Velocity Limit register allows {top * table.velocity_unit:.2f} rad/s, '
                              f'less than the {joint.velocity:g} of the chain file; it will lag behind fast commands')
        speed = joint.velocity * self._settings.profile_velocity_scale
        wanted = max(1, min(top, math.ceil(speed / table.velocity_unit)))
        settings['Profile Velocity'] = wanted
        # lets the profile reach full speed within the distance of one command: finer than that it would lag
        least = max(joint.acceleration, speed / (2 * self._period))
        settings['Profile Acceleration'] = min(32767, math.ceil(least / table.acceleration_unit))
        if joint.position_p_gain is not None:
            settings['Position P Gain'] = joint.position_p_gain
        for name, value in settings.items():
            value &= (1 << 8 * table[name].size) - 1        # as the bytes read, without a sign
            if self._read(servo, name) != value:        # spares the EEPROM
                self._write(servo, name, value)
            found = self._read(servo, name)
            if found != value:
                raise BackendFault(f'{servo}: {name} is {found} after writing {value}')
        first = table['Indirect Address 1'].address
        cells = [address for name, size in _FAST
                 for address in range(self._item(servo, name).address, self._item(servo, name).address + size)]
        data = struct.pack(f'<{len(cells)}H', *cells)
        self._insist(servo, 'Indirect Addresses',
                     lambda: self._packets.writeTxRx(self._port, servo.id, first, len(data), list(data)))
        found, *_ = self._insist(servo, 'Indirect Addresses',
                                 lambda: self._packets.readTxRx(self._port, servo.id, first, len(data)), len(data))
        if bytes(found) != data:
            raise BackendFault(f'{servo}: the indirect addresses did not take')

    def _item(self, servo, name):
        return servo.table[servo.load_item if name == 'Present Current' else name]

    def _make_groups(self):
        goals, reads = {}, {}
        for i, servo in enumerate(self._servos):
            goals.setdefault(servo.table['Goal Position'].address, []).append(i)
            reads.setdefault(servo.table['Indirect Data 1'].address, []).append(i)
        # the packet's parameters, of which only the goals change: ID and goal of every servo
        row = np.dtype([('id', 'u1'), ('goal', '<i4')])
        self._goal_groups = [(address, indices, np.array([(self._servos[i].id, 0) for i in indices], row))
                             for address, indices in goals.items()]
        self._read_groups = []
        for address, indices in reads.items():
            group = GroupSyncRead(self._port, self._packets, address, _FAST_FORMAT.itemsize)
            # the SDK leaves the stuffing in fast replies, and positions beyond 16 bits may need some
            fast = self._settings.fast_read and all(self._servos[i].table.zero for i in indices)
            for i in indices:
                group.addParam(self._servos[i].id)
            # the instruction's bytes and each servo's share of the replies
            on_line = 22 + len(indices) * (1 + _FAST_FORMAT.itemsize + (4 if fast else 11))
            self._read_groups.append((group, indices, fast, self._patience(on_line)))

    def _patience(self, n_bytes):
        """How long to wait for an exchange of this many bytes, ms."""
        return 1000 * (10 * n_bytes / self._settings.baud + self._settings.reply_timeout)

    # --- single items -------------------------------------------------------------------------------------------

    def _insist(self, servo, what, call, length=0):
        """Call the SDK until it succeeds, a few times; returns what it returned, and raises for a refusal.

        ``length`` is that of the data wanted: a late answer to an older question has another one.
        """
        for tries in range(TRIES):
            answer = call()
            result, error = answer[-2:]
            if result == COMM_SUCCESS and length and not error & ~ALERT and len(answer[0]) != length:
                result = COMM_RX_CORRUPT
            if result == COMM_SUCCESS:
                break
            time.sleep(LINGER_S * 2**tries)
        if tries:       # what answered may have been the late reply to the first try; that to the last comes as late
            time.sleep(LINGER_S * 2**tries)
        if result != COMM_SUCCESS:
            raise BackendFault(f'{servo}: {what}: {self._packets.getTxRxResult(result)}')
        if error & ~ALERT:
            raise BackendFault(f'{servo} refuses {what}: {self._packets.getRxPacketError(error & ~ALERT)}')
        return answer

    def _read(self, servo, name):
        item = servo.table[name]
        data, *_ = self._insist(
            servo, name, lambda: self._packets.readTxRx(self._port, servo.id, item.address, item.size), item.size)
        return int.from_bytes(bytes(data), 'little')

    def _write(self, servo, name, value):
        item = servo.table[name]
        data = list((value & (1 << 8 * item.size) - 1).to_bytes(item.size, 'little'))
        self._insist(servo, name, lambda: self._packets.writeTxRx(self._port, servo.id, item.address, item.size, data))

    def _write_all(self, name, values):
        """One item of every servo in one packet (one a group of equal addresses), without answers."""
        groups = {}
        for servo, value in zip(self._servos, values):
            groups.setdefault(servo.table[name], []).append((servo, value))
        for item, pairs in groups.items():
            group = GroupSyncWrite(self._port, self._packets, item.address, item.size)
            for servo, value in pairs:
                group.addParam(servo.id, list(value.to_bytes(item.size, 'little')))
            group.txPacket()

    # --- every cycle --------------------------------------------------------------------------------------------

    def _goals(self, angles):
        """Position values of joint angles, inside the limits."""
        counts = np.minimum(np.maximum(np.rint(self._zero + angles * self._per_rad), self._low), self._high)
        return np.where(counts == UNSENDABLE, UNSENDABLE + 1, counts)

    def _write_goals(self, counts):
        if not np.isfinite(counts).all():       # no limiter lets this happen
            raise ValueError(f'goals {counts}')
        for address, indices, rows in self._goal_groups:
            rows['goal'] = counts[indices]
            if self._packets.syncWriteTxOnly(self._port, address, 4, list(rows.tobytes()), rows.nbytes) != COMM_SUCCESS:
                self.statistics['write errors'] += 1
                self._port.is_using = False

    def _read_all(self):
        """Read every servo; True if all answered. Raises when a servo says that it no longer follows."""
        measurement = self.measurement
        measurement.fresh = False
        for group, indices, fast, timeout in self._read_groups:
            if fast:
                result = group.fastSyncReadTxPacket()
                self._port.setPacketTimeoutMillis(timeout)
                try:
                    result = result or group.fastSyncReadRxPacket()
                except IndexError:      # the SDK takes a late reply to something else for this one
                    result = COMM_RX_CORRUPT
            else:
                result = group.txPacket()
                self._port.setPacketTimeoutMillis(timeout)
                result = result or group.rxPacket()
            if result != COMM_SUCCESS:
                self._port.is_using = False
                self.statistics['read errors'] += 1
                return False
            raw = np.frombuffer(b''.join([bytes(group.data_dict[self._servos[i].id]) for i in indices]), _FAST_FORMAT)
            torque, error, watchdog = raw['torque'], raw['error'], raw['watchdog']
            for k in np.flatnonzero((error != 0) | (watchdog < 0) | (self._torque & (torque == 0))):
                self._explain(self._servos[indices[k]], torque[k], int(error[k]), watchdog[k])
            self._torque_on[indices], self._watchdogs[indices] = torque, watchdog
            measurement.effort[indices] = raw['current'] * self._effort_unit[indices]
            measurement.velocity[indices] = raw['velocity'] * self._speed_unit[indices]
            measurement.position[indices] = (raw['position'] - self._zero[indices]) / self._per_rad[indices]
        measurement.fresh = True
        return True

    def _explain(self, servo, torque, error, watchdog):
        if error:
            raise BackendFault(f'{servo} reports a hardware error: {hardware_errors(error)}'
                               + ('' if torque else '; it has switched its torque off'))
        if watchdog < 0:
            raise BackendFault(f'{servo}: its Bus Watchdog stopped it, as it heard nothing for '
                               f'{self._settings.watchdog * 1000:.0f} ms: the bridge was late or packets got lost')
        raise BackendFault(f'{servo} lost its torque although nobody switched it off: it has rebooted; look for a dip '
                           'of the supply voltage or a loose cable')

    def exchange(self, position, velocity, coming=None):
        """Send goal positions and read the servos back; see Backend.exchange."""
        self._cycle(self._goals(position))

    def observe(self):
        """Read the servos back; see Backend.observe."""
        self._cycle(None)

    def _cycle(self, counts):
        if self._port is None:
            raise BackendFault(f'port {self._settings.port} is not open', True)
        self.statistics['cycles'] += 1
        try:
            if counts is not None:
                self._write_goals(counts)
            if self._read_all():
                self._run = 0
            else:
                self._run += 1
                self.statistics['longest run'] = max(self.statistics['longest run'], self._run)
                if self._run >= self._settings.error_run:
                    self._give_up()
            if self.statistics['cycles'] % self._slow_every == 0 and not self._run:
                self._read_slowly()
        except _GONE as error:
            raise self._unplugged(error) from None

    def _glance(self, servo, address, length):
        """Read once, without waiting longer than the line needs; None if nothing comes."""
        self._packets.readTx(self._port, servo.id, address, length)
        self._port.setPacketTimeoutMillis(self._patience(length + 25))
        data, result, _ = self._packets.readRx(self._port, servo.id, length)
        self._port.is_using = False
        return data if result == COMM_SUCCESS and len(data) == length else None

    def _read_slowly(self):
        """Voltage and temperature of one servo, the next one at the next call."""
        i = self._slow_turn = (self._slow_turn + 1) % len(self._servos)
        table = self._servos[i].table
        voltage, temperature = table['Present Input Voltage'], table['Present Temperature']
        data = self._glance(self._servos[i], voltage.address, temperature.address + 1 - voltage.address)
        if data is None:
            self.statistics['slow read errors'] += 1
            return
        self.measurement.voltage[i] = 0.1 * (data[0] | data[1] << 8)
        self.measurement.temperature[i] = data[-1]

    def _give_up(self):
        """Say which servos are missing. Quick, so that the Bus Watchdogs of the others do not run out."""
        silent = [servo for servo in self._servos
                  if all(self._glance(servo, servo.table['ID'].address, 1) is None for _ in range(2))]
        run = (f'{self._run} cycles in a row without a complete answer' if self._run else
               'no complete answer while switching on')
        self._run = 0
        if len(silent) == len(self._servos):
            raise BackendFault(f'{run}: no servo answers any more; check power and cable', True)
        if silent:
            verb = 'no longer answers' if len(silent) == 1 else 'no longer answer'
            raise BackendFault(f'{run}: {_list(silent)} {verb}, the others do')
        raise BackendFault(f'{run}, but every servo answers alone: noise on the line, or the replies take longer than '
                           'the cycle allows (baud rate, latency timer)')

    def _unplugged(self, error):
        self._abandon()
        return BackendFault(f'the adapter at {self._settings.port} is gone (unplugged?): {error}. The servos stop by '
                            f'themselves after {self._settings.watchdog * 1000:.0f} ms without packets', True)

    # --- torque -------------------------------------------------------------------------------------------------

    def enable(self):
        """Goals to the present posture, torque on, Bus Watchdog on; each verified."""
        try:
            for _ in range(TRIES):
                if self._read_all():
                    break
            else:
                self._give_up()
            # everything below goes to all servos in one packet each: a servo that only hears others being spoken to
            # runs into its watchdog
            self._write_all('Bus Watchdog', [0] * len(self._servos))
            goals = self._goals(self.measurement.position)
            self._write_goals(goals)
            for servo, goal in zip(self._servos, goals):
                found = _signed(self._read(servo, 'Goal Position'), 4)
                if found != goal:
                    raise BackendFault(f'{servo}: the goal is {found} after writing {goal:.0f}')
            ticks = max(1, min(127, math.ceil(self._settings.watchdog / 0.020 - 1e-9)))
            self._write_all('Torque Enable', [1] * len(self._servos))
            self._write_all('Bus Watchdog', [ticks] * len(self._servos))
            for _ in range(TRIES):
                if self._read_all():
                    break
            else:
                self._give_up()
            for servo, torque, watchdog in zip(self._servos, self._torque_on, self._watchdogs):
                if torque != 1 or watchdog != ticks:
                    raise BackendFault(f'{servo}: after switching on, Torque Enable is {torque} and Bus Watchdog '
                                       f'{watchdog} instead of 1 and {ticks}')
            self._torque = True
            self._run = 0
        except _GONE as error:
            raise self._unplugged(error) from None
        except BaseException:
            self.disable()
            raise

    def _release(self):
        """Torque off for all at once, without waiting for answers."""
        self._torque = False
        self._port.is_using = False
        self._write_all('Torque Enable', [0] * len(self._servos))

    def disable(self):
        """Torque off for every servo that can be reached; returns whether all confirmed it."""
        self._torque = False
        if self._port is None:
            return False
        failed = []
        try:
            self._release()
            for servo in self._servos:
                if len(failed) == 2:
                    break       # nobody there; every further one would cost its time-out
                try:
                    self._write(servo, 'Torque Enable', 0)
                    self._write(servo, 'Bus Watchdog', 0)
                except BackendFault as error:
                    failed.append(error)
                    log.warning('torque may still be on: %s', error)
        except _GONE:
            self._abandon()
            return False
        return not failed

    def _abandon(self):
        port, self._port, self._torque = self._port, None, False
        if port is not None:
            with contextlib.suppress(*_GONE):
                port.closePort()

    def close(self):
        """Torque off and let go of the port."""
        if self._port is not None:
            self.disable()
            self._abandon()


def _list(servos):
    return ', '.join(str(servo) for servo in servos)
