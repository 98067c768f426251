"""What every item of a control table may hold, and what it holds when new: from the manufacturer's e-manual.

Addresses and sizes come with dynamixel-sdk (control_table.py). Here stand, by family and model, access, ranges and
initial values of the e-manual's "Control Table of EEPROM Area" and "... of RAM Area" and of the items' own sections.
Where the overview and an item's section differ, the section holds: Secondary ID takes 253 to 255 as "off", Drive Mode's
range is its bits, Bus Watchdog takes 0.
"""
from dataclasses import dataclass
from functools import cache
from typing import Optional, Tuple

from style_servo.control_table import control_table

__all__ = ['Rule', 'rules', 'PAGES']


@dataclass(frozen=True)
class Rule:
    """What the e-manual says of an item.

    Attributes
    ----------
    writable : bool
    low, high : int, optional
        The range; None where the e-manual names none.
    values : tuple of int, optional
        Where only some values of the range are defined.
    initial : int, optional
        When new; None where the e-manual names none.
    signed : bool
        Whether the bytes are a two's complement.
    limit : str, optional
        Name of the item that bounds this one, to both sides where ``signed``; then a value beyond is beyond a limit,
        not out of range.
    """

    writable: bool = True
    low: Optional[int] = None
    high: Optional[int] = None
    values: Optional[Tuple[int, ...]] = None
    initial: Optional[int] = None
    signed: bool = False
    limit: Optional[str] = None

    def allows(self, value):
        """Whether a value is in range."""
        return ((self.low is None or self.low <= value <= self.high)
                and (self.values is None or value in self.values))


def _bits(mask):
    return tuple(value for value in range(256) if not value & ~mask)


_READ_ONLY = ('Model Number', 'Model Information', 'Firmware Version', 'Registered Instruction',
              'Hardware Error Status', 'Realtime Tick', 'Moving', 'Moving Status', 'Present PWM', 'Present Load',
              'Present Input Voltage', 'Present Temperature', 'Backup Ready')
_READ_ONLY_SIGNED = ('Present Current', 'Present Velocity', 'Present Position', 'Velocity Trajectory',
                     'Position Trajectory')
# X series, and MX with Protocol 2.0: what all have in common
_X = {
    **{name: Rule(False) for name in _READ_ONLY}, **{name: Rule(False, signed=True) for name in _READ_ONLY_SIGNED},
    'ID': Rule(low=0, high=252, initial=1),
    'Baud Rate': Rule(low=0, high=7, initial=1),
    'Return Delay Time': Rule(low=0, high=254, initial=250),
    'Drive Mode': Rule(values=_bits(0x0D), initial=0),
    'Operating Mode': Rule(values=(0, 1, 3, 4, 5, 16), initial=3),
    'Secondary(Shadow) ID': Rule(low=0, high=255, initial=255),
    'Protocol Type': Rule(low=1, high=2, initial=2),
    'Homing Offset': Rule(low=-1044479, high=1044479, initial=0, signed=True),
    'Moving Threshold': Rule(low=0, high=1023, initial=10),
    'Temperature Limit': Rule(low=0, high=100, initial=80),
    'Max Voltage Limit': Rule(low=95, high=160, initial=160),
    'Min Voltage Limit': Rule(low=95, high=160, initial=95),
    'PWM Limit': Rule(low=0, high=885, initial=885),
    'Acceleration Limit': Rule(low=0, high=32767, initial=32767),
    'Velocity Limit': Rule(low=0, high=1023),
    'Max Position Limit': Rule(low=0, high=4095, initial=4095, signed=True),
    'Min Position Limit': Rule(low=0, high=4095, initial=0, signed=True),
    'Shutdown': Rule(initial=52),
    'Torque Enable': Rule(low=0, high=1, initial=0),
    'LED': Rule(low=0, high=1, initial=0),
    'Status Return Level': Rule(low=0, high=2, initial=2),
    'Velocity I Gain': Rule(low=0, high=16383, initial=1920),
    'Velocity P Gain': Rule(low=0, high=16383, initial=100),
    'Position D Gain': Rule(low=0, high=16383, initial=0),
    'Position I Gain': Rule(low=0, high=16383, initial=0),
    'Position P Gain': Rule(low=0, high=16383, initial=800),
    'Feedforward 2nd Gain': Rule(low=0, high=16383, initial=0),
    'Feedforward 1st Gain': Rule(low=0, high=16383, initial=0),
    'Bus Watchdog': Rule(low=0, high=127, initial=0, signed=True),
    'Goal PWM': Rule(signed=True, limit='PWM Limit'),
    'Goal Current': Rule(signed=True, limit='Current Limit'),
    'Goal Velocity': Rule(signed=True, limit='Velocity Limit'),
    'Goal Position': Rule(signed=True),
    'Profile Acceleration': Rule(low=0, high=32767, initial=0),
    'Profile Velocity': Rule(low=0, high=32767, initial=0),
    'PWM Slope': Rule(low=1, high=255),
    **{f'External Port Mode {k}': Rule(low=0, high=3, initial=3) for k in (1, 2, 3, 4)},
    **{f'External Port Data {k}': Rule() for k in (1, 2, 3, 4)},
    'Indirect Address': Rule(low=64, high=661),
    'Indirect Data': Rule(low=0, high=255),
}
_NO_CURRENT = {'Operating Mode': Rule(values=(1, 3, 4, 16), initial=3)}


def _voltage(low, high, initial_low=None):
    return {'Max Voltage Limit': Rule(low=low, high=high, initial=high),
            'Min Voltage Limit': Rule(low=low, high=high, initial=low if initial_low is None else initial_low)}


_X330 = {
    'Baud Rate': Rule(low=0, high=6, initial=1), 'Protocol Type': Rule(values=(2, 20, 21, 22), initial=2),
    'Temperature Limit': Rule(low=0, high=100, initial=70), 'Indirect Address': Rule(low=64, high=227)}
_DUAL = {'Drive Mode': Rule(values=_bits(0x0F), initial=0)}


def _current(most):
    return {'Current Limit': Rule(low=0, high=most, initial=most)}


def _top(speed, most=1023):
    return {'Velocity Limit': Rule(low=0, high=most, initial=speed)}


def _gains(velocity_i, velocity_p, position_p, position_d=0, most=16383):
    return {'Velocity I Gain': Rule(low=0, high=most, initial=velocity_i),
            'Velocity P Gain': Rule(low=0, high=most, initial=velocity_p),
            'Position P Gain': Rule(low=0, high=most, initial=position_p),
            'Position D Gain': Rule(low=0, high=most, initial=position_d),
            **{name: Rule(low=0, high=most, initial=0)
               for name in ('Position I Gain', 'Feedforward 1st Gain', 'Feedforward 2nd Gain')}}


def _p_series(amperage, acceleration, most_acceleration, speed, position, most_position, gains, shutdown=58):
    return {
        'Baud Rate': Rule(low=0, high=9, initial=1), 'Drive Mode': Rule(values=_bits(0x01), initial=0),
        'Operating Mode': Rule(values=(0, 1, 3, 4, 16), initial=3), 'Secondary ID': Rule(low=0, high=255, initial=255),
        'Protocol Type': Rule(values=(2, 10), initial=2),
        'Homing Offset': Rule(low=-2147483648, high=2147483647, initial=0, signed=True),
        'Moving Threshold': Rule(low=0, high=speed, initial=20),
        **_voltage(150, 350),
        'PWM Limit': Rule(low=0, high=2009, initial=2009), **_current(amperage),
        'Acceleration Limit': Rule(low=0, high=most_acceleration, initial=acceleration), **_top(speed, speed),
        'Max Position Limit': Rule(low=-most_position, high=most_position, initial=position, signed=True),
        'Min Position Limit': Rule(low=-most_position, high=most_position, initial=-position, signed=True),
        'Shutdown': Rule(initial=shutdown), **{f'LED {colour}': Rule(low=0, high=255, initial=0) for colour in
                                               ('Red', 'Green', 'Blue')},
        'Profile Acceleration': Rule(limit='Acceleration Limit', initial=0),
        'Profile Velocity': Rule(limit='Velocity Limit', initial=0), 'Startup Configuration': Rule(),
        'Indirect Address': Rule(low=512, high=1023), **_gains(*gains, most=32767)}


_PH42 = _p_series(4500, 10765, 4306173, 2920, 303454, 303750, (502, 1332, 879))
_PM54_060 = _p_series(7980, 11145, 4457932, 2830, 251173, 251417, (813, 2265, 502))
_PH54_200 = _p_series(22740, 9982, 3992644, 2900, 501433, 501923, (2209, 6153, 314), 52)
_PM42 = _p_series(4500, 10765, 4306173, 2920, 262931, 263187, (502, 1332, 879))
_XC430 = {**_NO_CURRENT, **_voltage(60, 160), **_top(460), **_gains(1920, 100, 460)}
_XH430 = {**_current(648), **_top(130), **_gains(1920, 100, 900)}
# Beginning of a model's name -> what differs from _X; the longest that fits holds. Models whose pages were not read
# (see PAGES) have the numbers of the nearest relative whose page was.
_MODELS = {
    'XL330': {**_X330, **_current(1750), **_top(445, 2047), 'Shutdown': Rule(initial=53), **_gains(1600, 180, 400),
              **_voltage(31, 70, 35)},
    'XC330': {**_X330, **_current(910), **_top(320, 2047), **_gains(1200, 40, 900),
              **_voltage(55, 140)},
    'XL430': {**_NO_CURRENT, **_voltage(60, 140), **_top(265), 'Temperature Limit': Rule(low=0, high=100, initial=72),
              **_gains(1000, 100, 640, 4000)},
    '2XL430': {**_NO_CURRENT, **_voltage(60, 140), **_top(265), 'Temperature Limit': Rule(low=0, high=100, initial=72),
               **_gains(1000, 100, 640, 4000)},
    'XC430': _XC430, '2XC430': _XC430,
    'XM430-W350': {**_current(1193), **_top(200)},
    'XM430-W210': {**_current(1193), **_top(330)},
    'XH430-W': _XH430, 'XD430': _XH430,
    'XH430-V': {**_voltage(110, 300), **_current(689), **_top(135)},
    'XW430': {**_current(1193), **_top(200)},
    'XM540': {**_DUAL, **_current(2047), **_top(128)},
    'XH540': {**_DUAL, **_current(2047), **_top(128)},
    'XH540-V': {**_DUAL, **_voltage(110, 300), **_current(2047), **_top(230)},
    'XD540': {**_DUAL, **_current(2047), **_top(128)},
    'XW540': {**_current(2047), **_top(167)},
    'MX-28': {**_NO_CURRENT, 'Drive Mode': Rule(values=_bits(0x05), initial=0), **_top(210),
              **_gains(1920, 100, 850)},
    'MX-64': {**_current(2047), 'Drive Mode': Rule(values=_bits(0x05), initial=0), **_top(210),
              **_gains(1920, 100, 850)},
    'MX-106': {**_current(2047), 'Drive Mode': Rule(values=_bits(0x07), initial=0), **_top(210),
               **_gains(1920, 100, 850)},
    'PH42': _PH42, 'PM54': _PM54_060, 'PH54': _PH54_200, 'H42': _PH42, 'M54': _PM54_060, 'H54': _PH54_200,
    'PM42': _PM42, 'M42': _PM42, 'RH-P12': _PM42,
}


#: Models whose pages were read item by item.
PAGES = ('XL330-M288', 'XC330-T288', 'XL430-W250', 'XC430-W150', 'XM430-W350', 'XM430-W210', 'XH430-W350', 'XH430-V350',
         'XM540-W270', 'XH540-V150', 'XW540-T260', 'MX-106', 'PH42-020-S300', 'PM54-060-S250', 'PH54-200-S500')


@cache
def rules(model_number, firmware=255):
    """Rules by the names of a model's items, and of 'Indirect Address'; empty for families that are not in this table.

    ``firmware`` chooses among tables that changed with it.
    """
    table = control_table(model_number, firmware)
    fitting = [prefix for prefix in _MODELS if table.model.startswith(prefix)]
    if not fitting:
        return {}
    known = {**_X, **_MODELS[max(fitting, key=len)]}
    return {name: rule for name, rule in known.items() if name in table or name == 'Indirect Address'}
