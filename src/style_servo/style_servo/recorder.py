"""Writing the bridge's flight record, in a thread of its own: no disk, full or slow, keeps a command waiting."""
import json
import os
import re
import struct
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path

from style_core.errors import UsageError

__all__ = ['Recorder', 'record_path', 'runs_of']

WRITE_EVERY_S = 0.1
MOST_WAITING = 16 << 20     # bytes that a slow disk may leave in memory
_NAME = re.compile(r'[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}')
_PART = re.compile(r'\.(\d{4,9})-(\d{4,9})\.flight')


def record_path(folder, name):
    """Where a record of this name lies, without run and part.

    Parameters
    ----------
    folder : str
        Nothing outside it is touched; empty: ``servo_bridge`` in ``$ROS_HOME`` (``~/.ros``), which is made.
    name : str
        Below the folder; or the absolute path of a file below it.

    Raises
    ------
    UsageError
        Where the name leads out of the folder, by itself or by a symbolic link, or its folder is not there.
    """
    root = Path(folder or Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'servo_bridge').expanduser()
    if '..' in Path(name).parts or not _NAME.fullmatch(Path(name).name):
        raise UsageError(f'record {name[:200]!r} is no name of a file below {root}: letters, digits, "_", "-" and "." '
                         '(not first), at most 100, and no ".."')
    if not folder:
        root.mkdir(parents=True, exist_ok=True)
    if not root.is_dir():
        raise UsageError(f'there is no folder {root} for the record: make it, or set record_folder')
    root = root.resolve()
    path = root / name          # an absolute name replaces the folder
    parent = path.parent.resolve()
    if parent != root and root not in parent.parents:
        raise UsageError(f'record {str(name)[:200]!r} lies outside of {root}: it takes a name below record_folder, '
                         'which is set where the bridge is started')
    if not parent.is_dir():
        raise UsageError(f'there is no folder {parent} for the record')
    return parent / path.name


def runs_of(path):
    """Files of a record: dict of run number to the list of its files, both in order."""
    path, runs = Path(path), {}
    if not path.parent.is_dir():
        return runs
    for entry in os.scandir(path.parent):
        match = entry.name.startswith(path.name) and _PART.fullmatch(entry.name[len(path.name):])
        if match and entry.is_file(follow_symlinks=False):
            runs.setdefault(int(match[1]), []).append((int(match[2]), Path(entry.path)))
    return {run: [part for _, part in sorted(runs[run])] for run in sorted(runs)}


class Recorder:
    """Write a flight record: files of a line of JSON and rows of float64, named NAME.RUN-PART.flight.

    Every start is a new run; no file is ever written over. A file that has reached its size is followed by a next one.
    Beyond ``files`` of them the oldest go, but never the last two of the run before, which may show a crash.

    Whatever the disk does, nothing here raises or waits; after an error nothing more is written.

    Parameters
    ----------
    path : path-like
        From record_path.
    chain : Chain
    period : float
        Of the cycles, s.
    size : float
        Of a file, bytes.
    files : int
        Of this name, of all runs; at least 4.
    opener : callable
        As ``open``.

    Attributes
    ----------
    problem : str
        Why nothing more is written; '' while all is well.
    lost : int
        Rows that a slow disk did not take in time.
    """

    def __init__(self, path, chain, period, size=64e6, files=20, opener=open):
        self._base, self._size, self._files, self._open = Path(path), size, files, opener
        limits = {field: chain.array(field).tolist() for field in ('lower', 'upper', 'velocity', 'acceleration')}
        self._head = json.dumps({'joint_names': chain.names, 'period': period, **limits}).encode() + b'\n'
        self._numbers = struct.Struct('<ddd')
        self.problem, self.lost = '', 0
        self._waiting = deque()     # filled by one thread, emptied by another
        self._most = MOST_WAITING // (24 * (1 + len(chain.joints)))
        self._file, self._run, self._part = None, 0, 0
        try:
            self._run = max(runs_of(path), default=0) + 1
            self._next_file()
        except OSError as error:
            self._give_up(error)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, name='flight record', daemon=True)
        self._thread.start()

    def write(self, time, state, target, command, measured, playing):
        """Append one cycle."""
        if self.problem:
            return
        if len(self._waiting) >= self._most:
            self.lost += 1
            return
        self._waiting.append(self._numbers.pack(time, state, playing) + target.tobytes() + command.tobytes()
                             + measured.tobytes())

    def close(self):
        """Write what waits and finish the file; gives up on a disk that does not answer."""
        self._end.set()
        self._thread.join(2.0)

    def _work(self):
        last = False
        try:
            while not (last or self.problem):
                last = self._end.wait(WRITE_EVERY_S)
                self._write_waiting()
        except Exception as error:
            self._give_up(error)
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _write_waiting(self):
        data = b''.join([self._waiting.popleft() for _ in range(len(self._waiting))])
        if data and self._written + len(data) > self._size and self._written > len(self._head):
            self._next_file()
        self._put(data)

    def _put(self, data):
        left = memoryview(data)
        while left:
            left = left[self._file.write(left):]        # a disk that is nearly full takes a part
        self._written += len(data)

    def _next_file(self):
        if self._file is not None:
            self._file.close()
            self._file = None
        self._part += 1
        self._remove_old()
        # never an existing file, nor through a link
        self._file = self._open(f'{self._base}.{self._run:04d}-{self._part:04d}.flight', 'xb', buffering=0)
        self._written = 0
        self._put(self._head)

    def _remove_old(self):
        """Make room for one file."""
        runs = runs_of(self._base)
        own = runs.pop(self._run, [])
        before = runs.pop(max(runs), []) if runs else []
        old = [part for parts in runs.values() for part in parts]
        spare = old + before[:-2] + own[:-1]
        count = len(old) + len(own) + len(before)
        for part in spare[:max(0, count + 1 - self._files)]:
            part.unlink()

    def _give_up(self, error):
        self.problem = f'{self._base}: {getattr(error, "strerror", None) or error!r}'
        self._waiting.clear()
