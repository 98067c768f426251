"""The bridge's flight record: every cycle as a row of numbers in a file."""
import json
import struct
from pathlib import Path
from typing import NamedTuple, Tuple

import numpy as np

from style_core.errors import MotionError

__all__ = ['Recorder', 'Record', 'read_record', 'violations']

# states (style_servo.states.State) after which the bridge starts anew from the measured posture
_RESTARTS = (0, 4, 5, 6, 7)


class Record(NamedTuple):
    """A flight record: T cycles of D joints.

    Attributes
    ----------
    joint_names : tuple of str
    time : ndarray, shape (T,)
        S on a monotonic clock.
    state : ndarray of int, shape (T,)
        See style_servo.states.State.
    target, command, measured : ndarray, shape (T, D)
        Rad: what the trajectory asked for, what was sent after limiting, what the joints did.
    playing : ndarray, shape (T,)
        Stamp of the trajectory that played, s as its sender gave it; 0 where it had none, NaN before the first.
    limits : dict of str to ndarray
        ``lower``, ``upper`` (rad), ``velocity``, ``acceleration`` of the chain, and ``period`` (s).
    """

    joint_names: Tuple[str, ...]
    time: np.ndarray
    state: np.ndarray
    target: np.ndarray
    command: np.ndarray
    measured: np.ndarray
    playing: np.ndarray
    limits: dict


class Recorder:
    """Write a flight record: a line of JSON, then rows of float64."""

    def __init__(self, path, chain, period):
        self._file = Path(path).open('wb', buffering=1 << 16)     # noqa: SIM115  (open as long as the bridge)
        limits = {field: chain.array(field).tolist() for field in ('lower', 'upper', 'velocity', 'acceleration')}
        self._file.write(json.dumps({'joint_names': chain.names, 'period': period, **limits}).encode() + b'\n')
        self._head = struct.Struct('<ddd')

    def write(self, time, state, target, command, measured, playing):
        """Append one cycle."""
        self._file.write(self._head.pack(time, state, playing) + target.tobytes() + command.tobytes()
                         + measured.tobytes())

    def flush(self):
        """Hand over what was written so far; a program that is killed loses the rest."""
        self._file.flush()

    def close(self):
        """Finish the file."""
        self._file.close()


def read_record(path):
    """Read a flight record; a last row cut short (the program was killed) is left out.

    Raises
    ------
    MotionError
        If the file is no flight record.
    """
    content = Path(path).read_bytes()
    line, _, rows = content.partition(b'\n')
    try:
        head = json.loads(line)
        names = tuple(head.pop('joint_names'))
    except (ValueError, KeyError, AttributeError, TypeError):
        raise MotionError(f'{path} is not a flight record of the bridge') from None
    n = len(names)
    width = 8 * (3 + 3 * n)
    table = np.frombuffer(rows[:len(rows) // width * width], np.float64).reshape(-1, 3 + 3 * n)
    target, command, measured = table[:, 3:].reshape(-1, 3, n).swapaxes(0, 1)
    return Record(names, table[:, 0], table[:, 1].astype(int), target, command, measured, table[:, 2],
                  {key: np.array(value) for key, value in head.items()})


def violations(record):
    """Commands outside the limits, counted without any tolerance.

    Parameters
    ----------
    record : Record

    Returns
    -------
    counts : dict of str to int
        'position', 'velocity' and 'acceleration': joint commands beyond that limit; 'not finite'; and 'commands': how
        many joint commands were looked at.
    """
    command, limits = record.command, record.limits
    period = limits['period']
    counts = {'commands': command.size, 'not finite': int(np.count_nonzero(~np.isfinite(command)))}
    counts['position'] = int(np.count_nonzero((command < limits['lower']) | (command > limits['upper'])))
    # commands lie on a lattice of doubles: these differences are exact
    step = np.diff(command, axis=0)
    change = np.diff(step, axis=0)
    # a reset starts at the measured posture: READY after a state that only a reset leaves
    fresh = np.isin(record.state[:-1], _RESTARTS) & (record.state[1:] == 1)
    step_of_one_life = ~fresh
    change_of_one_life = ~(fresh[1:] | fresh[:-1])
    counts['velocity'] = int(np.count_nonzero(np.abs(step[step_of_one_life]) > limits['velocity'] * period))
    counts['acceleration'] = int(np.count_nonzero(
        np.abs(change[change_of_one_life]) > limits['acceleration'] * period * period))
    return counts
