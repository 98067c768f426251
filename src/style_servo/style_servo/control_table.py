"""Dynamixel control tables: addresses from the tables packaged with dynamixel-sdk, plus units and factory values.

The SDK's files hold address, size and name of every item and the scale of position and velocity. What they do not hold
(units of acceleration and current, factory settings, which items are read-only) stands here, from the manufacturer's
documentation.
"""
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Mapping

from style_core.errors import UsageError

__all__ = ['Item', 'ControlTable', 'control_table', 'models', 'model_named', 'BAUD_RATES']

#: Value of the Baud Rate item -> bits a second (X series).
BAUD_RATES = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000)

# rev/min^2 in rad/s^2
_REV_MIN2 = 2 * math.pi / 3600


@dataclass(frozen=True)
class Item:
    """One entry of a control table: ``size`` bytes at ``address``."""

    name: str
    address: int
    size: int


@dataclass(frozen=True, eq=False)
class ControlTable:
    """A model's items and units.

    Attributes
    ----------
    model_number : int
        As a ping returns it.
    model : str
        For example ``'XM430-W350'``.
    items : mapping of str to Item
        By the manufacturer's name of the item.
    zero : int
        Position value at 0 rad.
    position_unit, velocity_unit, acceleration_unit : float
        Rad, rad/s and rad/s^2 of one count.
    current_unit : float or None
        A of one count of Present Current; None for models that report a load in 0.1 % instead.
    """

    model_number: int
    model: str
    items: Mapping[str, Item]
    zero: int
    position_unit: float
    velocity_unit: float
    acceleration_unit: float
    current_unit: float

    def __getitem__(self, name):
        try:
            return self.items[name]
        except KeyError:
            raise UsageError(f'{self.model} has no "{name}" in its control table') from None

    def __contains__(self, name):
        return name in self.items


def _folder():
    try:
        return resources.files('dynamixel_easy_sdk') / 'control_table'
    except ModuleNotFoundError:
        raise UsageError('the Dynamixel back end and simulator need dynamixel-sdk 4.1 or newer with its packaged '
                         'control tables: pip install "dynamixel-sdk>=4.1"') from None


@cache
def models():
    """All packaged models: mapping of model number to name, e.g. ``{1020: 'XM430-W350'}``."""
    rows = (line.split() for line in (_folder() / 'dynamixel.model').read_text('utf-8').splitlines()[1:])
    return {int(number): file.removesuffix('.model').upper().replace('_', '-')
            for number, file in (row for row in rows if len(row) == 2)}


def model_named(name):
    """Model number of a model's name, with or without the bus letter (``XM430-W350-T``)."""
    wanted = name.upper().replace('_', '-')
    for number, model in models().items():
        if model == wanted or wanted.removesuffix('-T').removesuffix('-R') == model:
            return number
    raise UsageError(f'unknown Dynamixel model {name!r}; known: {", ".join(sorted(models().values()))}')


NEW_X330_FIRMWARE = 52      # moved the indirect data of XL330 and XC330


@cache
def control_table(model_number, firmware=0):
    """The control table of a model number and firmware version.

    Raises
    ------
    UsageError
        If dynamixel-sdk has no table for it.
    """
    if model_number not in models():
        raise UsageError(f'dynamixel-sdk has no control table for model number {model_number}')
    model = models()[model_number]
    name = model.lower().replace('-', '_')
    file = _folder() / f'{name}_fw{NEW_X330_FIRMWARE}.model'
    if firmware < NEW_X330_FIRMWARE or not file.is_file():
        file = _folder() / f'{name}.model'
    section, info, units, items = '', {}, {}, {}
    for line in file.read_text('utf-8').splitlines():
        fields = line.strip().split('\t')
        if line.startswith('['):
            section, first = line.strip(), True
        elif first or not line.strip():
            first = not line.strip() and first      # the row after a section's title names its columns
        elif section == '[type info]':
            info[fields[0]] = float(fields[1])
        elif section == '[unit info]':
            units[fields[0]] = float(fields[1])
        else:
            # two spellings in the packaged files
            name = {'BUS Watchdog': 'Bus Watchdog', 'Baud Rate (Bus)': 'Baud Rate'}.get(fields[2], fields[2])
            items[name] = Item(name, int(fields[0]), int(fields[1]))
    low, high = info['value_of_min_radian_position'], info['value_of_max_radian_position']
    # 4096 positions a turn are 0..4095; the other families count both ends
    turn = high - low + (1 if info['value_of_zero_radian_position'] else 0)
    x_series = model.startswith(('X', '2X', 'MX'))
    current = _current_unit(model) if 'Present Current' in items else None
    return ControlTable(model_number, model, items, int(info['value_of_zero_radian_position']),
                        2 * math.pi / turn, units['Present Velocity'],
                        (214.577 if x_series else 1.0) * _REV_MIN2, current)


def _current_unit(model):
    """A of one count of Present Current, from the manufacturer's documentation."""
    if model.startswith('MX'):
        return 0.00336
    if model.startswith('XH430-V'):
        return 0.00134
    return 0.001 if model.startswith(('XL330', 'XC330')) or not model.startswith(('X', '2X')) else 0.00269
