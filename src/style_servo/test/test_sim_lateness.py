"""The simulator on a busy computer: time for which it did not run is no silence of the client."""
import os

import pytest

from style_servo.control_table import model_named
from style_servo.dynamixel_sim import PtyBus
from style_servo.packets import Instruction, packet
from style_servo.simulated_bus import SimulatedBus

WATCHDOG_S, STEP_S = 0.1, 0.002


class Clock:
    """In place of the module time: passes when a test says so."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def port(tmp_path, monkeypatch):
    clock = Clock()
    monkeypatch.setattr('style_servo.dynamixel_sim.time', clock)
    bus = SimulatedBus([(1, model_named('XM430-W350'), 0.0)])
    port = PtyBus(bus, tmp_path / 'port', check_baud=False)
    port.clock = clock
    bus.handle(1, Instruction.PING, b'', True, clock.now)
    servo, = bus.servos
    for name, value in (('Torque Enable', 1), ('Bus Watchdog', round(WATCHDOG_S / 0.02))):
        servo.write(servo.table[name].address, bytes((value,)))
    step(port, STEP_S)
    assert not bus.motion.halted.any()
    yield port
    port.close()


def step(port, after):
    """The simulator looks again after so long, where it wanted to after a step."""
    port.clock.now += after
    port.step(STEP_S)


def test_a_simulator_that_was_not_scheduled_does_not_stop_its_servos(port):
    """What the client sends meanwhile waits in the terminal."""
    client = os.open(port.link, os.O_RDWR | os.O_NOCTTY)
    try:
        for _ in range(5):
            os.write(client, packet(1, bytes((Instruction.PING,))))
            step(port, 2 * WATCHDOG_S)
            assert not port.bus.motion.halted.any()
    finally:
        os.close(client)


def test_a_client_that_falls_silent_is_noticed_after_the_watchdogs_time(port):
    begin = port.clock.now
    while not port.bus.motion.halted.any():
        step(port, STEP_S)
        assert port.clock.now < begin + WATCHDOG_S + 0.01
    assert port.clock.now > begin + WATCHDOG_S - 0.01
    assert port.bus.servos[0].watchdog == -1


def test_a_client_that_falls_silent_is_noticed_on_a_busy_computer_too(port):
    """Every step comes late; what is forgiven is bounded."""
    for _ in range(8):
        step(port, 0.06)        # 0.48 s in all
    assert port.bus.motion.halted.all()
