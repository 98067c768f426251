"""Finding, checking and configuring the Dynamixels of a chain, before torque comes on."""
import math
import struct

from style_servo.backend import BackendFault
from style_servo.control_table import models
from style_servo.dynamixel_client import PATIENCE_S
from style_servo.dynamixel_servo import POSITION_MODE, hardware_errors, listed
from style_servo.packets import ERROR_WORDS, Error

__all__ = ['DynamixelSetup']

TRIES = 5
REVERSE, SLAVE, TIME_PROFILE, GOAL_SWITCHES_ON = 0x01, 0x02, 0x04, 0x08     # bits of Drive Mode
MOST_ACCELERATION = 32767       # counts of Profile Acceleration, where no register limits it
WATCHDOG_FIRMWARE = 38
HOMING_LIMIT = 1024     # counts; beyond, Position Control Mode ignores the Homing Offset


class DynamixelSetup:
    """Patient talk with single servos.

    Parameters
    ----------
    client : DynamixelClient
    servos : list of DynamixelServo
    settings : BusSettings
    period : float
        Of the commands, s.
    sleep : callable
    """

    def __init__(self, client, servos, settings, period, sleep):
        self._client, self._servos, self._settings, self._period = client, servos, settings, period
        self._sleep = sleep

    def run(self, notes, facts):
        """Find every servo, write what differs, read everything back."""
        self._notes, self._facts = notes, facts
        self._find()
        for servo in self._servos:
            self._configure(servo)

    # --- single items -------------------------------------------------------------------------------------------

    def _patiently(self, call):
        """Call with more and more patience (s) until a reply comes; None if none does."""
        for k in range(TRIES):
            reply = call(PATIENCE_S * 2**k)
            if reply is not None:
                return reply
        return None

    def _insist(self, servo, what, call):
        reply = self._patiently(call)
        if reply is None:
            raise BackendFault(f'{servo}: {what}: no reply to {TRIES} requests')
        if reply.error:
            raise BackendFault(f'{servo} refuses {what}: {ERROR_WORDS.get(reply.error, f"error {reply.error}")}')
        return reply

    def read(self, servo, name, signed=False):
        """Value of an item."""
        item = servo.table[name]
        reply = self._insist(servo, name, lambda patience: self._client.read(
            servo.id, item.address, item.size, patience))
        return int.from_bytes(reply.data, 'little', signed=signed)

    def write(self, servo, name, value):
        """Write an item."""
        item = servo.table[name]
        data = (int(value) & (1 << 8 * item.size) - 1).to_bytes(item.size, 'little')
        self._insist(servo, name, lambda patience: self._client.write(
            servo.id, item.address, data, patience))

    # --- finding ------------------------------------------------------------------------------------------------

    def _find(self):
        """Every servo answers a ping, alone and with the right model number."""
        failed, garbled = [], []
        for servo in self._servos:
            strange = self._client.garbled
            reply = self._patiently(lambda patience, servo=servo: self._client.ping(servo.id, patience))
            if reply is None:
                failed.append(servo)
                if self._client.garbled > strange + 1:      # one may be somebody else's late reply
                    garbled.append(servo)
                continue
            self._check_ping(servo, reply)
        if garbled:
            others = ' although others get through' if len(failed) < len(self._servos) else ''
            raise BackendFault(f'{listed(garbled)}: replies are garbled{others}; most likely two servos share that ID '
                               '(connect them one at a time and give each its own)')
        if len(failed) == len(self._servos):
            raise BackendFault(f'no servo answers on {self._settings.port} at {self._settings.baud} baud: check the '
                               "motors' power, the cable, and the baud rate the servos are set to")
        if failed:
            raise BackendFault(f'{listed(failed)}: no answer, while others do: check ID, cable and baud rate')

    def _check_ping(self, servo, reply):
        number = int.from_bytes(reply.data[:2], 'little')
        if number != servo.model_number:
            found = models().get(number, 'unknown model')
            raise BackendFault(f'ID {servo.id} is a {found} (model number {number}), but joint {servo.joint.name} '
                               f'should be a {servo.table.model} ({servo.model_number}): wrong ID or chain file')
        servo.meet(reply.data[2])
        if servo.table.zero and servo.firmware < WATCHDOG_FIRMWARE:
            raise BackendFault(f'{servo} has firmware {servo.firmware}, which has no Bus Watchdog: it would go on '
                               'pushing if this computer stopped. Update it to '
                               f'{WATCHDOG_FIRMWARE} or newer (45 for fast_read)')
        if reply.alert:
            self._mend(servo)

    def _mend(self, servo):
        bits = self.read(servo, 'Hardware Error Status')
        if not bits:
            return
        if not self._settings.reboot:
            raise BackendFault(f'{servo} stands in a hardware error: {hardware_errors(bits)}. Find the cause, then '
                               'switch its power off and on, or allow the bridge to reboot it')
        self._client.reboot(servo.id)
        self._notes.append(f'{servo} stood in a hardware error ({hardware_errors(bits)}) and was rebooted')
        for _ in range(50):
            self._sleep(0.02)
            reply = self._client.ping(servo.id)
            if reply is not None and not reply.error and not reply.alert:
                return
        raise BackendFault(f'{servo} still stands in a hardware error after a reboot: {hardware_errors(bits)}')

    # --- configuring --------------------------------------------------------------------------------------------

    def _configure(self, servo):
        """Write what differs, read everything back."""
        joint, table = servo.joint, servo.table
        self.write(servo, 'Torque Enable', 0)
        mode = self._check_mounting(servo)
        settings = {
            'Status Return Level': 2, 'Return Delay Time': 0, 'Operating Mode': POSITION_MODE, 'Drive Mode': mode,
            'Min Position Limit': servo.low, 'Max Position Limit': servo.high, 'Bus Watchdog': 0}
        top = self.read(servo, 'Velocity Limit')
        if top * table.velocity_unit < joint.velocity:
            self._notes.append(f'{servo}: its Velocity Limit register allows {top * table.velocity_unit:.2f} rad/s, '
                               f'less than the {joint.velocity:g} of the chain file; it will lag behind fast commands')
        speed = joint.velocity * self._settings.profile_velocity_scale
        settings['Profile Velocity'] = max(1, min(top, math.ceil(speed / table.velocity_unit)))
        # lets the profile reach full speed within the distance of one command: finer than that it would lag
        least = max(joint.acceleration, speed / (2 * self._period))
        settings['Profile Acceleration'] = min(self._most_acceleration(servo),
                                               math.ceil(least / table.acceleration_unit))
        if joint.position_p_gain is not None:
            settings['Position P Gain'] = joint.position_p_gain
        for name, value in settings.items():
            value &= (1 << 8 * table[name].size) - 1        # as the bytes read, without a sign
            if self.read(servo, name) == value:        # spares the EEPROM
                continue
            self.write(servo, name, value)
            found = self.read(servo, name)
            if found != value:
                raise BackendFault(f'{servo}: {name} is {found} after writing {value}')
        cells = servo.block_cells()
        data, first = struct.pack(f'<{len(cells)}H', *cells), table['Indirect Address 1'].address
        self._insist(servo, 'Indirect Addresses', lambda patience: self._client.write(servo.id, first, data, patience))
        found = self._insist(servo, 'Indirect Addresses', lambda patience: self._client.read(
            servo.id, first, len(data), patience))
        if found.data != data:
            raise BackendFault(f'{servo}: the indirect addresses did not take')
        servo.limits = {name: self.read(servo, name) for name in (
            'Temperature Limit', 'Max Voltage Limit', 'Min Voltage Limit', 'Current Limit') if name in table}

    def _most_acceleration(self, servo):
        if 'Acceleration Limit' not in servo.table:
            return MOST_ACCELERATION
        most, unit = self.read(servo, 'Acceleration Limit'), servo.table.acceleration_unit
        if most * unit < servo.joint.acceleration:
            self._notes.append(f'{servo}: its Acceleration Limit register allows {most * unit:.1f} rad/s^2, less than '
                               f'the {servo.joint.acceleration:g} of the chain file; it will lag behind quick commands')
        return most

    def _check_mounting(self, servo):
        """Compare what turns and shifts the servo's scale with the chain file; returns the Drive Mode to write."""
        joint = servo.joint
        mode = self.read(servo, 'Drive Mode')
        homing = self.read(servo, 'Homing Offset', signed=True)
        self._facts[f'{joint.name}: model, firmware, Drive Mode, Homing Offset'] = (
            f'{servo.table.model}, {servo.firmware}, {mode}, {homing}')
        if bool(mode & REVERSE) != joint.reverse:
            raise BackendFault(f'{servo}: its Drive Mode ({mode}) says that it turns '
                               f'{"in reverse" if mode & REVERSE else "the normal way"}, the chain file says '
                               f'reverse: {str(joint.reverse).lower()}. Mend the one that is wrong: the joint would '
                               'turn the other way')
        if homing != joint.homing_offset:
            raise BackendFault(f'{servo}: its Homing Offset is {homing}, the chain file says homing_offset: '
                               f'{joint.homing_offset}. Mend the one that is wrong: the joint would stand '
                               f'{abs(homing - joint.homing_offset) * servo.table.position_unit:.3f} rad off')
        if servo.table.zero and abs(homing) > HOMING_LIMIT:
            raise BackendFault(f'{servo}: its Homing Offset {homing} is beyond {HOMING_LIMIT} counts either way, which '
                               'position control ignores: set it to 0 and use the offset of the chain file')
        if mode & SLAVE and servo.table.model.startswith(('X', 'MX-106')):
            raise BackendFault(f'{servo}: its Drive Mode ({mode}) makes it the slave of another servo')
        if mode & GOAL_SWITCHES_ON:
            self._notes.append(f'{servo}: its Drive Mode let any goal switch torque on; that has been cleared')
        return mode & ~(TIME_PROFILE | GOAL_SWITCHES_ON)

    # --- letting go ---------------------------------------------------------------------------------------------

    def torque_off(self, servo):
        """Torque off, confirmed; then the watchdog, which firmware may not have."""
        self.write(servo, 'Torque Enable', 0)
        item = servo.table['Bus Watchdog']
        reply = self._client.write(servo.id, item.address, b'\0')
        return reply is None or reply.error in (0, Error.ACCESS)
