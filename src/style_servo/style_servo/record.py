"""Reading the bridge's flight record: every cycle as a row of numbers."""
import argparse
import json
import sys
from pathlib import Path
from typing import NamedTuple, Tuple

import numpy as np

from style_core.errors import MotionError
from style_servo.recorder import runs_of
from style_servo.states import State

__all__ = ['Record', 'read_record', 'violations', 'main']

# states (style_servo.states.State) after which the bridge starts anew from the measured posture
_RESTARTS = (State.HOLDING, State.RELAXED, State.ESTOP, State.FAULT)


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


def read_record(path, run=None):
    """Read a flight record.

    Parameters
    ----------
    path : path-like
        One file, or the name that ``record`` gave: then all files of one run together.
    run : int, optional
        Which; the newest if not given.

    Raises
    ------
    MotionError
        If there is no such record, or a file is no flight record.
    """
    path = Path(path)
    if path.is_file():
        return _read_file(path)
    runs = runs_of(path)
    if not runs or run not in (None, *runs):
        raise MotionError(f'there is no flight record {path}' + (f' of run {run}' if runs else ''))
    parts = [_read_file(part) for part in runs[max(runs) if run is None else run]]
    table = [np.concatenate([getattr(part, field) for part in parts])
             for field in ('time', 'state', 'target', 'command', 'measured', 'playing')]
    return Record(parts[0].joint_names, *table, parts[0].limits)


def _read_file(path):
    """One file; a last row cut short (the program was killed, the disk was full) is left out."""
    content = path.read_bytes()
    line, _, rows = content.partition(b'\n')
    try:
        head = json.loads(line)
        names = tuple(head.pop('joint_names'))
        limits = {key: np.array(head[key], dtype=np.float64)
                  for key in ('lower', 'upper', 'velocity', 'acceleration', 'period')}
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
        raise MotionError(f'{path} is not a flight record of the bridge') from None
    n = len(names)
    width = 8 * (3 + 3 * n)
    table = np.frombuffer(rows[:len(rows) // width * width], np.float64).reshape(-1, 3 + 3 * n)
    target, command, measured = table[:, 3:].reshape(-1, 3, n).swapaxes(0, 1)
    return Record(names, table[:, 0], table[:, 1].astype(int), target, command, measured, table[:, 2], limits)


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
    sent = record.state != State.DISARMED       # these rows mark where the motors were let go
    anew = np.append(False, ~sent)[:-1][sent]
    command, state, limits = record.command[sent], record.state[sent], record.limits
    period = limits['period']
    counts = {'commands': command.size, 'not finite': int(np.count_nonzero(~np.isfinite(command)))}
    counts['position'] = int(np.count_nonzero((command < limits['lower']) | (command > limits['upper'])))
    # commands lie on a lattice of doubles: these differences are exact
    step = np.diff(command, axis=0)
    change = np.diff(step, axis=0)
    # a reset starts at the measured posture: READY after a state that only a reset leaves
    fresh = (np.isin(state[:-1], _RESTARTS) & (state[1:] == State.READY)) | anew[1:]
    step_of_one_life = ~fresh
    change_of_one_life = ~(fresh[1:] | fresh[:-1])
    counts['velocity'] = int(np.count_nonzero(np.abs(step[step_of_one_life]) > limits['velocity'] * period))
    counts['acceleration'] = int(np.count_nonzero(
        np.abs(change[change_of_one_life]) > limits['acceleration'] * period * period))
    return counts


def _summary(record):
    """What happened, line by line."""
    time, state = record.time, record.state
    if not len(time):
        return ['no cycles']
    lines = [f'{len(time)} cycles of {len(record.joint_names)} joints, {time[-1] - time[0]:.3f} s']
    changes = [0, *(np.flatnonzero(np.diff(state)) + 1)]
    lines += [f'{time[k] - time[0]:10.3f} s  {State(state[k]).name}' for k in changes]
    error = np.abs(record.command - record.measured)
    if np.isfinite(error).any():
        worst = int(np.nanargmax(np.nanmax(error, axis=0)))
        lines.append(f'largest following error: {np.nanmax(error):.4f} rad ({record.joint_names[worst]})')
    return lines + [f'{name}: {count}' for name, count in violations(record).items()]


def _write_csv(record, path):
    columns = ['time', 'state', 'playing'] + [f'{joint}.{field}' for field in ('target', 'command', 'measured')
                                              for joint in record.joint_names]
    table = np.column_stack([record.time, record.state, record.playing, record.target, record.command,
                             record.measured])
    np.savetxt(path, table, '%.17g', ',', header=','.join(columns), comments='')


def main(argv=None):
    """Command line: say what a flight record holds, or write it as CSV."""
    parser = argparse.ArgumentParser(prog='flight_record', description='Say what a flight record of the bridge holds: '
                                     'states with their times, and commands outside the limits.')
    parser.add_argument('record', help='one file, or the name of a record: then its newest run')
    parser.add_argument('--run', type=int, help='number of the run')
    parser.add_argument('--list', action='store_true', help='list runs and files')
    parser.add_argument('--csv', metavar='FILE', help='write every cycle as a line of text; - for standard output')
    args = parser.parse_args(argv)
    try:
        if args.list:
            for run, parts in runs_of(Path(args.record)).items():
                print(f'run {run}: ' + ', '.join(f'{part} ({part.stat().st_size} bytes)' for part in parts))
            return 0
        record = read_record(args.record, args.run)
        if args.csv:
            _write_csv(record, sys.stdout if args.csv == '-' else args.csv)
        else:
            print('\n'.join(_summary(record)))
    except (MotionError, OSError) as error:
        print(f'flight_record: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
