"""Time stamps of tables: seconds or a finer unit, times of day, and stamps that were printed with too few digits."""
import re
import warnings
from decimal import Decimal, InvalidOperation

import numpy as np

from style_core.errors import MotionError

__all__ = ['times_of', 'unit_of_time']

_NAMES = ('time', 't', 'seconds', 'timestamp', 'stamp')
_SECONDS = {**dict.fromkeys(('s', 'sec', 'secs', 'second', 'seconds'), 1.0),
            **dict.fromkeys(('ms', 'msec', 'millisecond', 'milliseconds'), 1e-3),
            **dict.fromkeys(('us', 'usec', 'microsecond', 'microseconds'), 1e-6),
            **dict.fromkeys(('ns', 'nsec', 'nanosecond', 'nanoseconds'), 1e-9)}
_EXACT = {1.0: Decimal(1), 1e-3: Decimal('1e-3'), 1e-6: Decimal('1e-6'), 1e-9: Decimal('1e-9')}
_HEADER = re.compile(r'(\w+?)(?:_|\s*[\[(]\s*|\s+)(\w+)[\])]?$')
#: stamps from here on are seconds since 1970 (this is in 1973), not of a recording that began at zero
_EPOCH_S = 1e8
#: whole numbers with steps from here on cannot be seconds
_FINE_STEP = 2.0


def unit_of_time(header):
    """Seconds of one unit of a header such as ``time``, ``time_ms`` or ``Timestamp [ns]``.

    Returns
    -------
    float or None
        NaN where the header names no unit, None where it is not a time.
    """
    word = header.strip().lower()
    if word in _NAMES:
        return 1.0 if word == 'seconds' else float('nan')
    found = _HEADER.match(word)
    if found and found.group(1) in _NAMES:
        return _SECONDS.get(found.group(2))
    return None


def times_of(path, stamps, unit_s, line_numbers):
    """Times of written stamps.

    Parameters
    ----------
    path : path-like
        Named in messages.
    stamps : list of str
        Decimal numbers.
    unit_s : float
        Of `unit_of_time`. Where no unit is named, whole numbers with steps of 2 or more are milliseconds,
        microseconds (steps from 1e3 on) or nanoseconds (from 1e6 on).
    line_numbers : list of int

    Returns
    -------
    times : ndarray, shape (N,)
        S. Stamps since 1970 count from the first.
    epoch_ns : int
        Of time zero, where the stamps count since 1970; else 0.
    kept : ndarray of int, shape (N,)
        Rows that are frames.

    Raises
    ------
    MotionError
        Where time goes back, or a stamp is not finite.

    Warns
    -----
    UserWarning
        Of a unit that is guessed, and of equal stamps: a constant rate that fits all of them within their last digit
        takes their place; where there is none, of rows with one stamp the last counts.
    """
    try:
        exact = [Decimal(stamp) for stamp in stamps]
        if not all(stamp.is_finite() for stamp in exact):
            raise InvalidOperation
    except InvalidOperation:
        row = next(row for row, stamp in enumerate(stamps) if not _finite(stamp))
        raise MotionError(f'{path}: line {line_numbers[row]}: the time {stamps[row][:40]!r} is not a finite number') \
            from None
    if unit_s != unit_s:
        unit_s = _guessed(path, exact)
    first = exact[0] if exact else Decimal(0)
    since_1970 = bool(exact) and float(first) * unit_s >= _EPOCH_S
    if since_1970:
        exact = [stamp - first for stamp in exact]
    times = np.array([float(stamp * _EXACT[unit_s]) for stamp in exact])
    epoch_ns = int(first * _EXACT[unit_s] * 10**9) if since_1970 else 0
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        raise MotionError(f'{path}: line {line_numbers[back[0] + 1]}: time does not increase ({times[back[0]]:.9g} s, '
                          f'then {times[back[0] + 1]:.9g} s)')
    equal = int((np.diff(times) == 0).sum())
    if not equal:
        return times, epoch_ns, np.arange(len(times))
    return _parted(path, times, exact, unit_s, equal, epoch_ns)


def _finite(stamp):
    try:
        return Decimal(stamp).is_finite()
    except InvalidOperation:
        return False


def _guessed(path, exact):
    """Seconds of a unit, from the stamps alone."""
    if len(exact) < 2 or any(stamp != int(stamp) for stamp in exact):
        return 1.0
    step = float(np.median(np.diff([float(stamp - exact[0]) for stamp in exact])))
    if step < _FINE_STEP:
        return 1.0
    name, unit_s = next((name, unit_s) for least, name, unit_s in
                        ((1e6, 'nanoseconds', 1e-9), (1e3, 'microseconds', 1e-6), (0.0, 'milliseconds', 1e-3))
                        if step >= least)
    warnings.warn(f'{path}: times in steps of {step:g} are taken as {name} ({1 / (step * unit_s):.6g} Hz); call the '
                  f'column time_s or time_ms to say what they are', stacklevel=5)
    return unit_s


def _parted(path, times, exact, unit_s, equal, epoch_ns):
    """Times where some stamps are equal."""
    digits = max(-min(stamp.as_tuple().exponent for stamp in exact), 0)
    resolution = 10.0 ** -digits * unit_s
    rows = np.arange(len(times))
    if len(times) > 2 and times[-1] > times[0]:
        step, start = np.polyfit(rows, times, 1)
        if step > 0 and np.abs(start + step * rows - times).max() <= resolution:
            warnings.warn(f'{path}: {equal} of {len(times)} stamps equal the one before, as they are printed to '
                          f'{resolution:g} s only: a constant rate of {1 / step:.4g} Hz fits them all and is taken',
                          stacklevel=5)
            return times[0] + step * rows, epoch_ns, rows
    kept = rows[np.append(np.diff(times) > 0, True)]
    warnings.warn(f'{path}: {equal} rows have the stamp of the row before; of each stamp the last row counts',
                  stacklevel=5)
    return times[kept], epoch_ns, kept
