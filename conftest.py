"""Tests that talk over ROS 2 stay on this machine, and each test file has a domain of its own.

This holds for nodes made in the test's process and for those it launches, also when several test runs share a machine.
"""
import itertools
import os
import signal
from contextlib import ExitStack

import pytest

try:
    from domain_coordinator import domain_id
except ImportError:  # tests of style_core run without ROS
    domain_id = None

os.environ['ROS_LOCALHOST_ONLY'] = '1'
# a shell starts what runs in its background with SIGINT ignored, and nodes of the tests would inherit that
signal.signal(signal.SIGINT, signal.default_int_handler)
_domains = itertools.count(os.getpid())  # never the domain of the file before: its nodes may still be leaving
_held = ExitStack()
_file = None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item):
    """Change the domain when the first test of a file comes."""
    global _file
    if domain_id is not None and item.path != _file:
        _held.close()
        domain = _held.enter_context(domain_id(lambda: next(_domains) % 100 + 1))
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        _file = item.path


def pytest_sessionfinish():
    """Free the last domain."""
    _held.close()
