"""The bridge's cycles in a thread of their own, at even times; what others want of the bridge is done in between."""
import gc
import math
import threading
import time
from concurrent.futures import Future, wait
from contextlib import suppress
from queue import Empty, SimpleQueue

__all__ = ['ServoLoop']

COLLECT_EVERY_S = 1.0
COLLECT_ANYWAY_S = 10.0     # where there is never any slack
LOOK_S = 0.1        # how often somebody who waits for an answer looks whether the thread still lives


class ServoLoop:
    """Call ``cycle(now)`` at ``begin`` + k ``period``, and in the slack between what was handed over.

    While it runs, the bridge belongs to its thread: everybody else hands functions over with :meth:`post` or
    :meth:`ask`. They are called in their order, at once where the thread sleeps, and in any case before the next cycle.
    Deadlines are absolute, so cycles do not drift. After one that took longer than its period the next begins at once;
    periods missed altogether are left out (the cycle sees it by its time). Garbage is collected in the slack after a
    cycle and nowhere else.

    Parameters
    ----------
    cycle : callable
        Takes the time, s on the monotonic clock.
    begin, period : float
        S.
    failed : callable
        Called from the thread when it ends by an exception, which is then in ``failure``.

    Attributes
    ----------
    failure : BaseException or None
    """

    def __init__(self, cycle, begin, period, failed):
        self._cycle, self._begin, self._period, self._failed = cycle, begin, period, failed
        self._mail = SimpleQueue()
        self._stop = False
        self.failure = None
        self._thread = threading.Thread(target=self._run, name='servo', daemon=True)
        self._thread.start()

    def post(self, call):
        """Have ``call()`` called by the thread."""
        self._mail.put((call, None))

    def ask(self, call):
        """The same, and wait: returns what it returns, raises what it raises."""
        answer = Future()
        self._mail.put((call, answer))
        while not wait([answer], LOOK_S).done:
            if not self._thread.is_alive():
                raise RuntimeError('the servo thread has ended') from self.failure
        return answer.result()

    def stop(self):
        """End the thread after what it does now; what was handed over before is still done."""
        def end():
            self._stop = True
        self.post(end)
        self._thread.join()

    def _run(self):
        collected = gc.isenabled()
        gc.disable()
        try:
            self._spin()
        except BaseException as error:
            self.failure = error
            self._failed()
        finally:
            if collected:
                gc.enable()

    def _spin(self):
        mail, clock = self._mail, time.monotonic
        due = collect = self._begin
        while not self._stop:
            left = due - clock()
            if left > 0:
                job = None
                with suppress(Empty):
                    job = mail.get(timeout=left)
                if job is not None:
                    self._do(*job)
                continue
            for _ in range(mail.qsize()):
                self._do(*mail.get())
            now = clock()
            self._cycle(now)
            after = clock()
            due = self._begin + self._period * (math.floor((now - self._begin) / self._period) + 1)
            slack = due - after > 0.3 * self._period
            if after >= collect and (slack or after >= collect + COLLECT_ANYWAY_S):
                gc.collect()
                collect = after + COLLECT_EVERY_S

    def _do(self, call, answer):
        if answer is None:
            call()
            return
        try:
            answer.set_result(call())
        except Exception as error:
            answer.set_exception(error)
