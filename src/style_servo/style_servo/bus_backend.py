"""A back end for servos on a polled bus: what is done about lost replies, and how torque comes on without motion.

A kind of bus is one file: a class with the methods of :class:`Bus`.
"""
import contextlib
import logging
from typing import Protocol

import numpy as np

from style_servo.backend import BackendFault, Measurement
from style_servo.serial_port import GONE

__all__ = ['Bus', 'BusBackend']

log = logging.getLogger(__name__)

TRIES = 20              # to read all joints where a fault would end everything
AGREE = 4               # readings in a row that must agree before torque comes on
STILL_RAD = 0.01        # within which a still joint's readings lie
LOOK_EVERY_S = 0.005    # between those readings: a joint that passes at 0.7 rad/s is not still
LOOKS = 40
JUMP_RAD = 0.2          # further than this no joint sags when torque comes on: its servo counts anew


class Bus(Protocol):
    """One kind of servo bus. Methods raise BackendFault, or one of GONE when the adapter has been pulled out."""

    port_name: str
    names: tuple

    def open(self):
        """Take the port. Where that fails, nothing may have been sent."""

    def set_up(self, notes, facts):
        """Find, check and configure every servo; adds warnings to ``notes``, and what was found to ``facts``."""

    def read(self, measurement):
        """All joints into ``measurement``; False if a reply is missing, and then nothing in it has changed."""

    def read_slowly(self, i, measurement):
        """Voltage and temperature of joint ``i``; False if no reply came."""

    def write(self, position):
        """Send goals, shape (D,), rad."""

    def explain_silence(self, what):
        """BackendFault that says why replies are missing; ``what`` is its first words."""

    def ready(self, position):
        """Check that the joints may be held where they stand, and set the servos' goals there, verified."""

    def torque_on(self):
        """Torque and watchdog on for all."""

    def verify_torque(self):
        """Raise unless all servos say that they hold and watch."""

    def release(self):
        """Torque off for all at once, without waiting for answers."""

    def confirm_release(self):
        """Torque off one by one; the names of those that did not confirm it."""

    def warnings(self, measurement):
        """What is about to make a servo shut down: list of str."""

    def sleep(self, seconds):
        """Wait."""

    def close(self):
        """Let go of the port; never raises."""


class BusBackend:
    """See Backend; this one drives a Bus.

    Parameters
    ----------
    bus : Bus
    error_run : int
        So many cycles in a row without a complete answer are a fault.
    period : float
        Of the commands, s.
    """

    def __init__(self, bus, error_run, period):
        self.bus, self._error_run = bus, error_run
        n = len(bus.names)
        self.measurement = Measurement.unknown(n)
        self.statistics = {'cycles': 0, 'read errors': 0, 'slow read errors': 0, 'longest run': 0}
        self.notes, self.facts = [], {}
        self._open = False
        self._run = 0
        self._slow_turn, self._slow_every = 0, max(1, round(1.0 / period / n))

    @property
    def warnings(self):
        """What is about to make a servo shut down."""
        return self.bus.warnings(self.measurement)

    # --- connecting ---------------------------------------------------------------------------------------------

    def connect(self):
        """Take the port, find every servo, write and verify its settings; torque is off afterwards."""
        self.close()
        self.notes.clear()
        self.facts.clear()
        self._run = 0
        self.bus.open()
        self._open = True
        try:
            self.bus.set_up(self.notes, self.facts)
            self._insist('no complete answer to the first readings')
            for _ in self.bus.names:
                self._read_slowly()
        except GONE as error:
            raise self._unplugged(error) from None
        except BaseException:
            with contextlib.suppress(*GONE):
                self.bus.release()
            self._abandon()
            raise

    def _unplugged(self, error):
        self._abandon()
        return BackendFault(f'the adapter at {self.bus.port_name} is gone (unplugged?): {error}. The servos stop by '
                            'themselves when their watchdog hears nothing', True)

    def _abandon(self):
        self._open = False
        self.bus.close()

    def close(self):
        """Torque off and let go of the port. A port that was never taken is not touched."""
        if self._open:
            self.disable()
            self._abandon()

    # --- every cycle --------------------------------------------------------------------------------------------

    def exchange(self, position, velocity, coming=None):
        """Send goal positions and read the servos back; see Backend.exchange."""
        self._cycle(position)

    def observe(self):
        """Read the servos back; see Backend.observe."""
        self._cycle(None)

    def _cycle(self, position):
        if not self._open:
            raise BackendFault(f'port {self.bus.port_name} is not open', True)
        self.statistics['cycles'] += 1
        try:
            if position is not None:
                self.bus.write(position)
            if self._read():
                self._run = 0
            else:
                self._run += 1
                self.statistics['longest run'] = max(self.statistics['longest run'], self._run)
                if self._run >= self._error_run:
                    run, self._run = self._run, 0
                    raise self.bus.explain_silence(f'{run} cycles in a row without a complete answer')
            if self.statistics['cycles'] % self._slow_every == 0 and not self._run:
                self._read_slowly()
        except GONE as error:
            raise self._unplugged(error) from None
        except BackendFault:
            raise
        except Exception as error:      # a fault is latched and held; an error that ends the servo thread is not
            log.exception('unexpected error on the bus')
            raise BackendFault(f'unexpected error on the bus: {type(error).__name__}: {error}') from error

    def _read(self):
        self.measurement.fresh = False
        if not self.bus.read(self.measurement):
            self.statistics['read errors'] += 1
            return False
        self.measurement.fresh = True
        return True

    def _read_slowly(self):
        i = self._slow_turn = (self._slow_turn + 1) % len(self.bus.names)
        self.statistics['slow read errors'] += not self.bus.read_slowly(i, self.measurement)

    def _insist(self, what):
        """Read all joints, trying a few times."""
        for _ in range(TRIES):
            if self._read():
                return
            self.bus.sleep(LOOK_EVERY_S)
        raise self.bus.explain_silence(what)

    # --- torque -------------------------------------------------------------------------------------------------

    def enable(self):
        """Torque on where the joints stand: believed only if several readings agree, and verified afterwards."""
        try:
            posture = self._still_posture()
            self.bus.ready(posture)
            self.bus.torque_on()
            self._insist('no complete answer while switching on')
            self.bus.verify_torque()
            after = self._still_posture()
            jump = np.abs(after - posture)
            if jump.max() > JUMP_RAD:
                worst = int(np.argmax(jump))
                raise BackendFault(f'joint {self.bus.names[worst]} stood at {posture[worst]:.3f} rad and reads '
                                   f'{after[worst]:.3f} since torque came on: its servo counts its turn anew. Turn it '
                                   'within its turn by hand, or mend its offset')
            self._run = 0
        except GONE as error:
            raise self._unplugged(error) from None
        except BaseException:
            self.disable()
            raise

    def _still_posture(self):
        """The posture that AGREE readings in a row agree on."""
        seen = []
        for _ in range(LOOKS):
            self._insist('no complete answer while switching on')
            seen.append(self.measurement.position.copy())
            if len(seen) >= AGREE and np.ptp(seen[-AGREE:], axis=0).max() <= STILL_RAD:
                return seen[-1]
            self.bus.sleep(LOOK_EVERY_S)
        span = np.ptp(seen[-AGREE:], axis=0)
        worst = int(np.argmax(span))
        low, high = np.min(seen, axis=0)[worst], np.max(seen, axis=0)[worst]
        raise BackendFault(f'joint {self.bus.names[worst]} does not stand still: its readings go from {low:.3f} to '
                           f'{high:.3f} rad. Torque comes on only where {AGREE} readings in a row agree within '
                           f'{STILL_RAD:g} rad')

    def disable(self):
        """Torque off for every servo that can be reached; returns whether all confirmed it."""
        if not self._open:
            return False
        try:
            self.bus.release()
            failed = self.bus.confirm_release()
        except GONE:
            self._abandon()
            return False
        for reason in failed:
            log.warning('torque may still be on: %s', reason)
        return not failed
