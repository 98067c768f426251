"""One joint's Dynamixel: its control table, conversion between joint angle and position value, words for its faults."""
import math

import numpy as np

from style_core.errors import UsageError
from style_servo.control_table import control_table, model_named

__all__ = ['DynamixelServo', 'hardware_errors', 'listed', 'BLOCK', 'BLOCK_FORMAT', 'POSITION_MODE']

POSITION_MODE = 3
_HARDWARE = {0x01: 'input voltage', 0x04: 'overheating', 0x08: 'encoder', 0x10: 'electrical shock', 0x20: 'overload'}
# Read every cycle through the indirect data block, in this order: a small number stands between any two that may be
# negative, so that no reply holds the pattern FF FF FD, of which nobody says how a Fast Sync Read treats it.
BLOCK = (('Present Position', 4), ('Torque Enable', 1), ('Present Velocity', 4), ('Hardware Error Status', 1),
         ('Present Current', 2), ('Bus Watchdog', 1))
BLOCK_FORMAT = np.dtype([('position', '<i4'), ('torque', 'u1'), ('velocity', '<i4'), ('error', 'u1'),
                         ('current', '<i2'), ('watchdog', 'i1')])


def hardware_errors(bits):
    """Names of the bits of Hardware Error Status."""
    return ', '.join(name for bit, name in _HARDWARE.items() if bits & bit) or f'code {bits}'


def listed(servos):
    """Servos by name, in one line."""
    return ', '.join(str(servo) for servo in servos)


class DynamixelServo:
    """A joint's servo.

    Parameters
    ----------
    joint : Joint

    Attributes
    ----------
    low, high : int
        Position values of the joint's limits, rounded towards the inside.
    turn : tuple of int
        Position values that the servo shows within one turn; it falls back into them when torque comes on.
    firmware : int or None
        As the servo answers to a ping; None before.
    limits : dict
        Values of the registers at which it shuts down, once they have been read.
    """

    def __init__(self, joint):
        self.joint = joint
        self.id = joint.id
        self.model_number = model_named(joint.model)
        self.table = table = control_table(self.model_number)
        self.firmware, self.limits = None, {}
        self._check_table()
        ends = sorted((self.counts(joint.lower), self.counts(joint.upper)))
        # towards the inside: a rounded command must not leave the limits
        self.low, self.high = math.ceil(ends[0] - 1e-9), math.floor(ends[1] + 1e-9)
        half = round(math.pi / table.position_unit)
        self.turn = (table.zero - half, table.zero + half - 1)
        if not (self.low >= self.turn[0] and self.high <= self.turn[1]):
            raise UsageError(f'joint {joint.name}: limits {joint.lower:.3f} to {joint.upper:.3f} rad become the '
                             f'position values {self.low} to {self.high}, but {table.model} has {self.turn[0]} to '
                             f'{self.turn[1]}: mend offset, sign or limits')

    def _check_table(self):
        joint, table = self.joint, self.table
        for needed in ('Indirect Data 1', 'Bus Watchdog', 'Goal Position', 'Profile Velocity', 'Drive Mode'):
            if needed not in table:
                raise UsageError(f'joint {joint.name}: {table.model} has no {needed}, which the bridge needs')
        if table['Bus Watchdog'].size != 1:
            raise UsageError(f'joint {joint.name}: the control table of {table.model} is not supported yet')

    def meet(self, firmware):
        """Take the firmware version that it answers with, and the control table that goes with it."""
        self.firmware = firmware
        self.table = control_table(self.model_number, firmware)
        self._check_table()

    def __str__(self):
        return f'joint {self.joint.name} (ID {self.id}, {self.table.model})'

    def counts(self, angle):
        """Position value, not rounded, of a joint angle in rad."""
        return self.table.zero + (self.joint.offset + self.joint.sign * angle) / self.table.position_unit

    def angle(self, counts):
        """Joint angle in rad of a position value."""
        return ((counts - self.table.zero) * self.table.position_unit - self.joint.offset) * self.joint.sign

    @property
    def load_item(self):
        """Name of the item with the motor's effort."""
        return 'Present Current' if 'Present Current' in self.table else 'Present Load'

    def block_cells(self):
        """Addresses of the bytes of BLOCK."""
        names = ((self.load_item if name == 'Present Current' else name, size) for name, size in BLOCK)
        return [self.table[name].address + k for name, size in names for k in range(size)]

    @property
    def spare_cells(self):
        """Indirect data bytes behind the block, which may be read as well."""
        table = self.table
        cells = (table['Indirect Data 1'].address - table['Indirect Address 1'].address) // 2
        return min(15, max(0, cells - BLOCK_FORMAT.itemsize))
