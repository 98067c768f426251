"""The simulator on a busy computer: time for which it did not run is no silence of the client."""
import time

import pytest

from style_servo.control_table import model_named
from style_servo.dynamixel_sim import PtyBus
from style_servo.packets import Instruction
from style_servo.simulated_bus import SimulatedBus

WATCHDOG_S = 0.1


@pytest.fixture
def port(tmp_path):
    bus = SimulatedBus([(1, model_named('XM430-W350'), 0.0)])
    port = PtyBus(bus, tmp_path / 'port', check_baud=False)
    bus.handle(1, Instruction.PING, b'', True, time.monotonic())
    servo, = bus.servos
    for name, value in (('Torque Enable', 1), ('Bus Watchdog', round(WATCHDOG_S / 0.02))):
        servo.write(servo.table[name].address, bytes((value,)))
    port.step(0.0)
    assert not bus.motion.halted.any()
    yield port
    port.close()


def serve(port, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        port.step(0.002)


def test_a_simulator_that_was_not_scheduled_does_not_stop_its_servos(port):
    for _ in range(5):
        time.sleep(2 * WATCHDOG_S)      # as a busy computer does
        port.step(0.002)
    assert not port.bus.motion.halted.any()


def test_a_client_that_falls_silent_is_noticed_all_the_same(port):
    end = time.monotonic() + 20.0
    while not port.bus.motion.halted.any():
        assert time.monotonic() < end
        serve(port, 0.01)
    assert port.bus.servos[0].watchdog == -1
