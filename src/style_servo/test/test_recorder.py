"""Writing flight records: bounded, never over another one, below one folder, and whatever the disk does."""
import errno
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from style_core.errors import MotionError, UsageError
from style_servo.chain import Chain, Joint
from style_servo.record import main, read_record, violations
from style_servo.recorder import Recorder, record_path, runs_of
from style_servo.states import State

CHAIN = Chain((Joint('hip', -1.0, 1.0, 3.0, 20.0), Joint('knee', -1.0, 1.0, 3.0, 20.0)))


def write(recorder, cycles, first=0):
    for k in range(first, first + cycles):
        recorder.write(0.005 * k, State.STREAMING, *np.full((3, 2), 1e-6 * k), 0.0)


def until(condition):
    clock = threading.Event()
    for _ in range(2000):
        if condition():
            return
        clock.wait(0.01)
    raise AssertionError


def test_what_is_written_is_read(tmp_path):
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005)
    write(recorder, 500)
    recorder.close()
    record = read_record(tmp_path / 'flight')
    assert record.joint_names == ('hip', 'knee') and len(record.time) == 500
    np.testing.assert_array_equal(record.command[:, 1], 1e-6 * np.arange(500))
    assert violations(record)['velocity'] == 0 and not recorder.problem and not recorder.lost


def test_a_new_run_leaves_earlier_ones_as_they_are(tmp_path):
    path = tmp_path / 'flight'
    for run in range(1, 4):
        recorder = Recorder(path, CHAIN, 0.005)
        write(recorder, 10 * run)
        recorder.close()
    assert list(runs_of(path)) == [1, 2, 3]
    assert [len(read_record(path, run).time) for run in (1, 2, 3)] == [10, 20, 30]
    assert len(read_record(path).time) == 30
    with pytest.raises(MotionError, match='of run 7'):
        read_record(path, 7)


def test_size_is_bounded_and_the_end_of_the_run_before_stays(tmp_path, monkeypatch):
    monkeypatch.setattr('style_servo.recorder.WRITE_EVERY_S', 0.002)
    path, size, files = tmp_path / 'flight', 5000, 6

    def run(cycles):
        recorder = Recorder(path, CHAIN, 0.005, size, files)
        for k in range(0, cycles, 50):
            done = recorder._part, recorder._written
            write(recorder, 50, k)
            until(lambda: (recorder._part, recorder._written) != done and not recorder._waiting)   # noqa: B023
        recorder.close()
        assert not recorder.problem
    run(2000)
    assert len(runs_of(path)[1]) <= files
    end = read_record(path, 1).time[-1]
    crash = [part.read_bytes() for part in runs_of(path)[1][-2:]]
    run(2000)
    kept = [part for parts in runs_of(path).values() for part in parts]
    assert len(kept) <= files and all(part.stat().st_size <= size for part in kept)
    assert [part.read_bytes() for part in runs_of(path)[1]] == crash
    assert end == read_record(path, 1).time[-1] == read_record(path, 2).time[-1]
    np.testing.assert_allclose(np.diff(read_record(path, 2).time), 0.005)     # the parts of a run fit together
    run(50)
    assert 1 not in runs_of(path) or len(runs_of(path)[1]) < 2
    assert read_record(path, 2).time[-1] == end


class FullDisk:
    """A file on a disk of so many bytes, which takes what still fits, as the kernel does."""

    def __init__(self, room):
        self.room, self.tries = room, 0

    def __call__(self, path, mode, buffering):
        self._file = open(path, mode, buffering=buffering)      # noqa: SIM115
        return self

    def write(self, data):
        self.tries += 1
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = self._file.write(data[:self.room])
        self.room -= taken
        return taken

    def close(self):
        self._file.close()


@pytest.mark.parametrize('room', [0, 10, 2000, 20000])
def test_a_full_disk_ends_the_record_and_nothing_else(tmp_path, room):
    disk = FullDisk(room)
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005, opener=disk)
    write(recorder, 1000)
    until(lambda: recorder.problem)
    tries = disk.tries
    write(recorder, 1000)       # returns, raises nothing
    recorder.close()
    assert 'No space left' in recorder.problem and disk.tries == tries
    assert not recorder._waiting
    if room >= 2000:
        record = read_record(tmp_path / 'flight')       # without the row that was cut short
        assert 0 < len(record.time) < 1000
        np.testing.assert_array_equal(record.command[:, 0], 1e-6 * np.arange(len(record.time)))


def test_a_disk_that_is_really_full_ends_the_record(tmp_path):
    """By a limit of the kernel on the size of files."""
    program = f'''
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
sys.path[:0] = {sys.path!r}
from test_recorder import *
recorder = Recorder({str(tmp_path / "flight")!r}, CHAIN, 0.005)
write(recorder, 500)
until(lambda: recorder.problem)
write(recorder, 500)
recorder.close()
print(recorder.problem)
'''
    said = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, timeout=60, check=True,
                          cwd=os.path.dirname(__file__))
    assert 'File too large' in said.stdout
    assert 0 < len(read_record(tmp_path / 'flight').time) < 500


def test_a_slow_disk_keeps_nobody_waiting_and_memory_bounded(tmp_path):
    go = threading.Event()

    class Slow(FullDisk):
        def write(self, data):
            if self.tries:
                go.wait(30)
            return super().write(data)
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005, opener=Slow(10**9))
    recorder._most = 1000
    write(recorder, 50)
    until(lambda: not recorder._waiting)        # being written
    write(recorder, 5000)
    assert recorder.lost == 4000 and len(recorder._waiting) == 1000
    go.set()
    recorder.close()
    assert len(read_record(tmp_path / 'flight').time) == 1050


def test_a_record_never_follows_a_link_nor_takes_an_existing_file(tmp_path):
    precious = tmp_path / 'precious'
    precious.write_text('mine')
    (tmp_path / 'flight.0001-0001.flight').symlink_to(precious)
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005)
    write(recorder, 10)
    recorder.close()
    assert precious.read_text() == 'mine' and 'File exists' in recorder.problem


@pytest.mark.parametrize('name', ['../flight', 'deeper/../../flight', '/etc/passwd', '/flight', 'away/flight', '', '.',
                                  '..', '.bashrc', 'a b', 'a\nb', 'x' * 200, 'nowhere/flight', 'a\0b', 'file/flight'])
def test_a_record_lies_below_its_folder_or_nowhere(tmp_path, name):
    folder = tmp_path / 'records'
    folder.mkdir()
    (folder / 'file').write_text('')
    (folder / 'away').symlink_to(tmp_path)
    with pytest.raises(UsageError):
        record_path(str(folder), name)


def test_names_and_absolute_paths_below_the_folder_are_taken(tmp_path):
    folder = tmp_path / 'records'
    (folder / 'today').mkdir(parents=True)
    (tmp_path / 'link').symlink_to(folder)
    assert record_path(str(folder), 'flight_1') == folder / 'flight_1'
    assert record_path(str(folder), 'today/flight') == folder / 'today' / 'flight'
    assert record_path(str(folder), str(folder / 'flight')) == folder / 'flight'
    assert record_path(str(tmp_path / 'link'), 'flight') == folder / 'flight'
    with pytest.raises(UsageError, match='make it, or set record_folder'):
        record_path(str(tmp_path / 'nowhere'), 'flight')


def test_without_a_folder_records_lie_where_ros_keeps_its_files(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    assert record_path('', 'flight') == tmp_path / 'ros' / 'servo_bridge' / 'flight'
    assert (tmp_path / 'ros' / 'servo_bridge').is_dir()


def test_the_reader_says_what_a_record_holds_and_writes_text(tmp_path, capsys):
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005)
    write(recorder, 20)
    recorder.close()
    path = str(tmp_path / 'flight')
    assert main([path]) == 0
    said = capsys.readouterr().out
    assert '20 cycles of 2 joints' in said and 'STREAMING' in said and 'velocity: 0' in said
    assert main([path, '--list']) == 0 and 'run 1: ' in capsys.readouterr().out
    assert main([path, '--csv', str(tmp_path / 'flight.csv')]) == 0
    table = np.loadtxt(tmp_path / 'flight.csv', delimiter=',', skiprows=1)
    assert table.shape == (20, 9)
    np.testing.assert_array_equal(table[:, 5], 1e-6 * np.arange(20))
    capsys.readouterr()
    assert main([str(tmp_path / 'nothing')]) == 1 and 'there is no flight record' in capsys.readouterr().err
    (tmp_path / 'other').write_text('{"joint_names": 5}\n')
    assert main([str(tmp_path / 'other')]) == 1 and 'is not a flight record' in capsys.readouterr().err


def test_where_the_motors_were_let_go_nothing_was_commanded(tmp_path):
    """In the middle of a motion, with the bus gone: then it starts anew from another posture."""
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005)
    rows = [(State.STREAMING, 0.0), (State.STREAMING, 0.0004), (State.FAULT, 0.0005), (State.DISARMED, 0.0005),
            (State.READY, 0.9), (State.READY, 0.9)]
    for k, (state, position) in enumerate(rows):
        recorder.write(0.005 * k, state, *np.full((3, 2), position), 0.0)
    recorder.close()
    assert violations(read_record(tmp_path / 'flight')) == {
        'commands': 10, 'not finite': 0, 'position': 0, 'velocity': 0, 'acceleration': 0}
    recorder = Recorder(tmp_path / 'flight', CHAIN, 0.005)
    for k, (_, position) in enumerate(rows):
        recorder.write(0.005 * k, State.STREAMING, *np.full((3, 2), position), 0.0)
    recorder.close()
    counts = violations(read_record(tmp_path / 'flight'))
    assert counts['velocity'] == 2 and counts['acceleration'] == 4
