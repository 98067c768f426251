"""A simulated chain in its own process, and the unmodified SDK talking to it."""
import os
import subprocess
import sys
import time

import pytest

from style_servo.dynamixel_sim import tell


def pytest_collection_modifyitems(items):
    """Nothing in this folder sends over ROS 2; one file reads what the middleware serialises."""
    for item in items:
        if item.path.parent.parent.name == 'style_servo' and item.path.name != 'test_trajectory_message.py':
            item.add_marker('no_middleware')


class Simulator:
    """A running dynamixel_sim."""

    def __init__(self, link, *arguments):
        self.link = str(link)
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'style_servo.dynamixel_sim', '--link', self.link, *arguments],
            stdout=subprocess.PIPE, text=True, env=environment)
        assert 'simulated servos' in self.process.stdout.readline()

    def tell(self, do, **options):
        return tell(self.link, do=do, **options)

    def servo(self, servo_id):
        return self.tell('state', id=servo_id)['servos'][0]

    def until(self, condition, seconds=3.0):
        """Wait until a condition on the state holds; returns that state."""
        end = time.monotonic() + seconds
        while True:
            state = self.tell('state')
            if condition(state):
                return state
            assert time.monotonic() < end, state
            time.sleep(0.01)

    def close(self):
        self.process.terminate()
        self.process.wait(5)
        self.process.stdout.close()


@pytest.fixture
def simulate(tmp_path):
    """Start simulators: ``simulate('--servos', '1:XM430-W350')``."""
    running = []

    def start(*arguments):
        running.append(Simulator(tmp_path / f'dxl{len(running)}', *arguments))
        return running[-1]
    yield start
    for simulator in running:
        simulator.close()
