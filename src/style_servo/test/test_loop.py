"""The servo thread: order, answers, failures and the grid of its cycles (never how fast this machine is)."""
import gc
import threading
import time

import numpy as np
import pytest

from style_servo.loop import ServoLoop


class Cycles:
    """Notes the times of cycles and whatever else happens, in order."""

    def __init__(self, hook=lambda k: None):
        self.seen, self.hook, self.failed = [], hook, threading.Event()
        self.begin = time.monotonic()
        self.loop = ServoLoop(self, self.begin, 0.005, self.failed.set)

    def __call__(self, now):
        self.seen.append(now)
        self.hook(len(self.seen))

    def wait(self, count):
        end = time.monotonic() + 30
        while len([one for one in self.seen if isinstance(one, float)]) < count:
            assert time.monotonic() < end
            time.sleep(0.002)


def test_cycles_never_begin_before_they_are_due_and_keep_to_the_grid():
    cycles = Cycles()
    cycles.wait(50)
    cycles.loop.stop()
    places = [(now - cycles.begin) / 0.005 for now in cycles.seen]
    assert np.all(np.diff(np.floor(places)) >= 1)       # at most one to each period: no drift, no burst
    ended = len(cycles.seen)
    time.sleep(0.03)
    assert len(cycles.seen) == ended


def test_what_is_handed_over_is_done_in_order_between_cycles_by_one_thread():
    cycles, threads = Cycles(), set()
    for k in range(200):
        cycles.loop.post(lambda k=k: (cycles.seen.append(k), threads.add(threading.current_thread())))
    assert cycles.loop.ask(lambda: 'answer') == 'answer'
    cycles.loop.stop()
    assert [one for one in cycles.seen if isinstance(one, int)] == list(range(200))
    assert len(threads) == 1 and threading.current_thread() not in threads


def test_what_comes_during_a_cycle_is_done_before_the_next_one_however_late_that_is():
    begun, posted = threading.Event(), threading.Event()

    def long_one(k):
        if k == 3:
            begun.set()
            assert posted.wait(30)
            time.sleep(0.02)
    cycles = Cycles(long_one)
    assert begun.wait(30)
    cycles.loop.post(lambda: cycles.seen.append('stop'))
    posted.set()
    cycles.wait(6)
    cycles.loop.stop()
    assert cycles.seen[3] == 'stop'


def test_errors_of_questions_come_back_and_do_no_harm():
    cycles = Cycles()
    with pytest.raises(ZeroDivisionError):
        cycles.loop.ask(lambda: 1 / 0)
    cycles.wait(3)
    cycles.loop.stop()
    assert cycles.loop.failure is None and not cycles.failed.is_set()


def test_an_error_in_a_cycle_ends_the_thread_and_is_told():
    def bad(k):
        if k == 2:
            raise ValueError('broken')
    cycles = Cycles(bad)
    assert cycles.failed.wait(30)
    assert isinstance(cycles.loop.failure, ValueError) and len(cycles.seen) == 2
    with pytest.raises(RuntimeError, match='has ended'):
        cycles.loop.ask(lambda: None)
    cycles.loop.stop()
    assert gc.isenabled()


def test_garbage_is_collected_after_cycles_only():
    assert gc.isenabled()
    enabled, collected = [], []
    cycles = Cycles(lambda k: enabled.append(gc.isenabled()))

    def note(phase, info):
        collected.append(threading.current_thread().name)
    gc.callbacks.append(note)
    try:
        cycles.wait(20)
        keep = [[[]] for _ in range(100000)]        # would have been the collector's turn many times
        cycles.loop.stop()
    finally:
        gc.callbacks.remove(note)
    assert len(keep) and not any(enabled) and set(collected) <= {'servo'} and gc.isenabled()
