"""The Dynamixel back end on a line that spoils replies in every way, in simulated time.

The line (faulty_bus.py) is written from the protocol's description alone.
"""
import numpy as np
import pytest
from faulty_bus import KINDS, FaultyBus

from style_servo.backend import BackendFault
from style_servo.chain import Chain, Joint
from style_servo.dynamixel_backend import BusSettings, DynamixelBackend

PERIOD = 0.005
IDS = (1, 2, 3)
JOINTS = tuple(Joint(f'joint_{k}', -1.5, 1.5, 3.0, 20.0, id=k, model='XM430-W350') for k in IDS)
LOW, HIGH = 2048 - 1.5 * 4096 / (2 * np.pi), 2048 + 1.5 * 4096 / (2 * np.pi)


class Port(FaultyBus):
    """A faulty line as the port that the back end opens."""

    def latency_timer(self):
        return None


def driven(fast_read, seed, **options):
    """A back end that holds three servos through a faulty line."""
    line = Port(IDS, seed, **{key: value for key, value in options.items() if key in ('likely', 'firmware')})
    settings = BusSettings('line', fast_read=fast_read, error_run=options.get('error_run', 10**9))
    backend = DynamixelBackend(Chain(JOINTS), settings, PERIOD, lambda name, baud: line)
    hold = line.position_of
    line.position_of = lambda request, servo_id: 2048       # a still posture while torque comes on
    backend.connect()
    backend.enable()
    line.position_of = hold
    return backend, line


def exchange(backend, line, angles):
    """One cycle of the bridge: whether it brought a measurement, and whether every reply came whole and in time."""
    begun, request = line.now, line.request
    backend.exchange(angles, np.zeros(3))
    line.now = max(line.now, begun + PERIOD)
    return backend.measurement.fresh, line.request > request and all(line.whole.values())


def counts(angles):
    return np.rint(2048 + angles * 4096 / (2 * np.pi)).astype(int)


@pytest.mark.parametrize('fast_read', [False, True])
def test_fifty_thousand_spoilt_exchanges(fast_read):
    """No exception, no goal beyond the limits, no number of another request, and what was lost is counted exactly."""
    backend, line = driven(fast_read, seed=18)
    draw = np.random.default_rng(18)
    targets = draw.uniform(-2.0, 2.0, (1000, 3))        # also beyond the limits
    backend.statistics.update(dict.fromkeys(backend.statistics, 0))
    line.goals.clear()
    line.spoiling = True
    lost = accepted = 0
    n = 50000
    for k in range(n):
        before = backend.measurement.position.copy()
        fresh, whole = exchange(backend, line, targets[k % 1000])
        assert fresh == whole, k
        if fresh:
            shown = counts(backend.measurement.position)
            assert list(shown) == [line.position_of(line.request, servo_id) for servo_id in IDS], k
            accepted += 1
        else:
            assert np.array_equal(backend.measurement.position, before), k
            lost += 1
    assert backend.statistics['read errors'] == lost and backend.statistics['cycles'] == n
    assert min(lost, accepted) > n / 10
    assert min(line.spoilt.values()) > 1000
    goals = np.array([goal for _, goal in line.goals])
    assert len(goals) == 3 * n and LOW <= goals.min() < LOW + 1 and HIGH - 1 < goals.max() <= HIGH


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('fast_read', [False, True])
def test_each_way_to_spoil_a_reply_alone(fast_read, kind):
    backend, line = driven(fast_read, seed=3)
    line.kinds, line.spoiling = (kind,), True
    shown = 0
    for _ in range(500):
        fresh, whole = exchange(backend, line, np.zeros(3))
        assert fresh == whole
        if fresh:
            assert list(counts(backend.measurement.position)) == [line.position_of(line.request, one) for one in IDS]
        shown += fresh
    assert shown == 500 if kind in ('doubled', 'foreign', 'noise', 'slow') else 50 < shown < 450


def test_every_whole_packet_is_taken_or_counted_as_a_stray():
    backend, line = driven(False, seed=4)
    strays, intact = backend.statistics['stray replies'], line.intact
    line.kinds, line.spoiling = ('late', 'later', 'doubled', 'foreign', 'missing'), True
    taken = 0
    original = backend.bus.client.sync_read

    def counted(*arguments):
        nonlocal taken
        replies = original(*arguments)
        taken += len(replies)
        return replies
    backend.bus.client.sync_read = counted
    backend.bus.read_slowly = lambda i, measurement: True
    for _ in range(2000):
        exchange(backend, line, np.zeros(3))
    line.spoiling = False
    line.now += 1.0
    exchange(backend, line, np.zeros(3))
    assert backend.statistics['stray replies'] - strays > 1000
    assert taken + backend.statistics['stray replies'] - strays == line.intact - intact


@pytest.mark.parametrize('seed', range(30))
@pytest.mark.parametrize('fast_read', [False, True])
def test_connecting_and_switching_on_while_replies_are_spoilt(fast_read, seed):
    """It succeeds with every register right, or says what is missing; never a number from another packet."""
    line = Port(IDS, seed, likely=0.15)
    line.kinds = ('late', 'doubled', 'truncated', 'foreign', 'garbled', 'missing')
    line.spoiling = True
    line.position_of = lambda request, servo_id: 2048
    backend = DynamixelBackend(Chain(JOINTS), BusSettings('line', fast_read=fast_read), PERIOD, lambda *_: line)
    try:
        backend.connect()
        backend.enable()
    except BackendFault as error:
        text = str(error)
        assert 'no reply' in text or 'no answer' in text or 'no complete answer' in text or 'garbled' in text, text
        return
    np.testing.assert_allclose(backend.measurement.position, 0.0)
    for servo in line.servos.values():
        assert servo.memory[64] == 1 and servo.memory[98] == 5
        assert int.from_bytes(servo.memory[116:120], 'little') == 2048


def test_a_run_of_lost_replies_is_a_fault_and_no_exception_else():
    backend, line = driven(False, seed=5, error_run=10)
    line.kinds, line.likely, line.spoiling = ('missing',), 1.0, True
    for _ in range(9):
        exchange(backend, line, np.zeros(3))
    with pytest.raises(BackendFault, match='10 cycles in a row'):
        exchange(backend, line, np.zeros(3))


def test_an_unexpected_error_is_a_fault_that_can_be_latched():
    backend, line = driven(False, seed=6)
    with pytest.raises(BackendFault, match='unexpected error on the bus: ValueError'):
        exchange(backend, line, np.full(3, np.nan))
    backend.exchange(np.zeros(3), np.zeros(3))
    assert backend.measurement.fresh
