"""The stream between messages and a predictor, with a stand-in predictor whose answers are known."""
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.budgets import REMEMBERED_BYTES, UNKNOWN_BYTES, UNKNOWN_NAMES
from style_core.errors import MotionError, UsageError
from style_core.predictor import Estimate, Prediction, Status
from style_core.stream.health import health_of
from style_core.stream.joint_map import JointMap, JointRule, identity_map
from style_core.stream.stream import PredictorStream, StreamSettings, warm_up

S = 1_000_000_000
NAMES = ('hip', 'knee', 'ankle')


class Holder:
    """Believes the last value of every joint, 0.5 before the first; moves at 1 rad/s from there."""

    joint_names = NAMES

    def __init__(self):
        self.log = []
        self.resets = 0
        self.broken = False
        self.reset()

    def reset(self):
        self.resets += 1
        self.time = None
        self.mean = np.full(3, 0.5)

    def update(self, time, y, mask=None):
        if self.time is not None and not time > self.time:
            raise ValueError('time does not increase')
        self.time = time
        observed = ~np.isnan(y) & mask if mask is not None else ~np.isnan(y)
        self.mean = np.where(observed, y, self.mean)
        if self.broken:
            self.mean = self.mean * np.nan
        self.log.append((time, np.where(observed, y, np.nan)))
        return Estimate(time, 1.0, 6.0, np.eye(2), np.zeros(2), np.eye(2), self.mean, np.full(3, 0.1), observed, 1.0,
                        -1.0, Status.TRACKING)

    def predict(self, horizons):
        mean = self.mean + np.asarray(horizons)[:, None]
        return Prediction(self.time + horizons, mean, np.full_like(mean, 0.2), np.ones_like(mean))


def stream(joint_map=None, **settings_changes):
    return PredictorStream(Holder(), (joint_map or identity_map()).bind(NAMES),
                           StreamSettings(**{'merge_window': 0.0, 'max_stamp_age': 0.0, **settings_changes}))


def test_joints_by_name_in_any_order():
    live = stream()
    step, = live.receive(['ankle', 'hip', 'knee'], [3.0, 1.0, 2.0], 10 * S, 0)
    np.testing.assert_array_equal(step.positions, [1.0, 2.0, 3.0])
    assert step.observed.all() and step.stamp == 10 * S


def test_absent_nan_and_masked_joints_are_not_observed_and_filled_in():
    live = stream()
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    step, = live.receive(['hip', 'knee'], [1.5, np.nan], 10 * S + 10, 0)
    np.testing.assert_array_equal(step.observed, [True, False, False])
    np.testing.assert_array_equal(step.positions, [1.5, 2.0, 3.0])
    live.set_mask(['h*'], False)
    step, = live.receive(NAMES, [9.0, 4.0, 5.0], 10 * S + 20, 0)
    np.testing.assert_array_equal(step.observed, [False, True, True])
    np.testing.assert_array_equal(step.positions, [1.5, 4.0, 5.0])
    live.set_mask(['hip'], True)
    step, = live.receive(NAMES, [9.0, 4.0, 5.0], 10 * S + 30, 0)
    assert step.observed.all()
    assert live.tally.total['NaN values'] == 1


def test_masking_an_unknown_joint_changes_nothing():
    live = stream()
    with pytest.raises(MotionError, match='elbow'):
        live.set_mask(['hip', 'elbow'], False)
    assert live.allowed.all()


def test_the_joint_map_stands_on_both_sides():
    live = stream(JointMap({'knee': JointRule('K', sign=-1, offset=1.0, scale=2.0, limits=(-10, 0.5))}))
    step, = live.receive(['K', 'hip'], [0.2, 7.0], 10 * S, 0)
    np.testing.assert_allclose(live.predictor.log[0][1], [np.nan, 0.4, np.nan])
    np.testing.assert_allclose(step.positions, [0.2])
    np.testing.assert_allclose(step.std, [0.2])
    outlook = live.predict(np.array([0.1, 0.2]))
    np.testing.assert_allclose(outlook.mean, [[0.0], [-0.2]], atol=1e-12)
    np.testing.assert_allclose(outlook.std, [[0.4], [0.4]])
    np.testing.assert_allclose(outlook.velocity, [[-2.0], [-2.0]])
    assert list(live.unknown) == ['hip']


@pytest.mark.parametrize('names, positions, reason', [
    (NAMES, [1.0, 2.0], 'wrong length'),
    (NAMES, [1.0, 2.0, 3.0, 4.0], 'wrong length'),
    (NAMES, [], 'no positions'),
    ([], [], 'no positions'),
    ([], [1.0], 'wrong length'),
    (['hip', 'hip'], [1.0, 2.0], 'duplicate names'),
    (['wheel'], [1.0], 'no known joint'),
])
def test_messages_that_make_no_sense_are_counted_and_change_nothing(names, positions, reason):
    live = stream()
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    assert live.receive(names, positions, 11 * S, 0) == []
    assert live.tally.total[reason] == 1
    assert len(live.predictor.log) == 1


@pytest.mark.parametrize('value', [np.inf, -np.inf, 1e300, 101.0])
def test_implausible_angles_are_masked_and_counted(value):
    live = stream()
    step, = live.receive(NAMES, [value, 2.0, 3.0], 10 * S, 0)
    assert list(step.observed) == [False, True, True]
    assert live.tally.total['implausible values'] == 1 and live.tally.total['NaN values'] == 0


def test_time_of_the_filter_starts_at_zero_so_that_nanoseconds_survive():
    live = stream()
    start = 1_700_000_000 * S
    for number in range(4):
        live.receive(NAMES, [1.0, 2.0, 3.0], start + number * 1_000_001, 0)
    np.testing.assert_allclose([time for time, _ in live.predictor.log], np.arange(4) * 0.001000001, rtol=1e-12)


def test_a_backward_jump_resets_once_and_a_long_gap_does_too():
    live = stream()
    for stamp in (100.0, 100.01, 50.0, 50.01, 50.02, 60.0, 60.01):
        live.receive(NAMES, [1.0, 2.0, 3.0], round(stamp * S), 0)
    assert live.tally.total['clock resets'] == 2 and live.tally.total['jump'] == 2
    assert live.predictor.resets == 4  # its own, the stream's, two jumps
    assert len(live.predictor.log) == 5


def test_a_filter_that_breaks_down_starts_again_and_publishes_nothing():
    live = stream()
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    live.predictor.broken = True
    assert live.receive(NAMES, [1.0, 2.0, 3.0], 11 * S - 1, 0) == []
    assert live.predict(np.array([0.1])) is None
    live.predictor.broken = False
    assert len(live.receive(NAMES, [1.0, 2.0, 3.0], 11 * S, 0)) == 1
    assert live.predict(np.array([0.1])) is not None
    assert live.tally.total['filter failures'] == 1


def test_sensor_states():
    live = stream(joint_timeout=0.1)
    live.receive(['hip', 'knee'], [1.0, np.nan], 10 * S, 0)
    assert live.sensors(10 * S) == {'used': ['hip'], 'masked': [], 'timed out': [], 'never seen': ['ankle'],
                                    'not believed': [], 'not measured': ['knee']}
    live.set_mask(['ankle'], False)
    assert live.sensors(11 * S)['timed out'] == ['hip', 'knee']
    assert live.sensors(11 * S)['masked'] == ['ankle']


class Doubter(Holder):
    """Believes no angle above 2 rad."""

    def update(self, time, y, mask=None):
        return super().update(time, np.where(y > 2, np.nan, y), mask)


def test_what_the_filter_does_not_believe_is_filled_in_counted_and_named():
    rules = {'hip': JointRule('a', scale=2.0), 'knee': JointRule('b'), 'ankle': JointRule('c')}
    live = PredictorStream(Doubter(), JointMap(rules).bind(NAMES), StreamSettings(merge_window=0.0, max_stamp_age=0.0))
    live.receive(['a', 'b', 'c'], [1.0, 1.0, 1.0], 10 * S, 0)
    step, = live.receive(['a', 'b', 'c'], [3.0, 3.0, np.nan], 11 * S, 0)
    np.testing.assert_array_equal(step.observed, [True, False, False])
    np.testing.assert_array_equal(step.doubted, [False, True, False])
    np.testing.assert_array_equal(step.positions, [3.0, 1.0, 1.0])
    assert live.tally.total['values not believed'] == 1
    assert live.sensors(11 * S)['not believed'] == ['b'] and live.sensors(11 * S)['not measured'] == ['c']
    assert '1 values not believed' in health_of(live, 11 * S).summary


def test_reset_keeps_the_mask():
    live = stream()
    live.set_mask(['hip'], False)
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    live.reset()
    assert live.last is None and live.status() == Status.ACQUIRING and live.predict(np.array([0.1])) is None
    step, = live.receive(NAMES, [1.0, 2.0, 3.0], 5 * S, 0)  # earlier than before: a reset forgets the clock, too
    assert list(step.observed) == [False, True, True]


def test_publishers_with_ever_new_names_do_not_fill_the_memory():
    live = stream()
    tracemalloc.start()
    for number in range(10_000):
        live.receive([f'joint{number}', 'hip'], [0.0, 1.0], 10 * S + number * 1000, 0)
    for number in range(20):    # many names at once, and long ones
        many = [f'{number} {place}' for place in range(4096)]
        live.receive([*many, 'hip'], np.zeros(4097), 11 * S + number * 1000, 0)
        live.receive(['\x1b[31m\n' + 'x' * 200_000 + str(number), 'hip'], [0.0, 1.0], 12 * S + number * 1000, 0)
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert held < 4 * REMEMBERED_BYTES
    assert len(live.unknown) <= UNKNOWN_NAMES and sum(map(len, live.unknown)) <= UNKNOWN_BYTES
    assert all(name.isprintable() for name in live.unknown)
    assert len(live.predictor.log) > 10_000


@pytest.mark.parametrize('changes, message', [
    ({'joint_timeout': -1.0}, 'joint_timeout'),
    ({'max_gap': float('nan')}, 'max_gap'),
    ({'joint_timeout': 0.001, 'merge_window': 0.004}, 'longer than merge_window'),
    ({'joint_timeout': 2.0}, 'max_gap'),
    ({'reorder_window': 1.5}, 'reorder_window'),
])
def test_settings_are_checked_together(changes, message):
    with pytest.raises(UsageError, match=message):
        StreamSettings(**changes)


def test_warm_up_leaves_no_trace():
    predictor = Holder()
    warm_up(predictor, np.array([0.1]))
    assert predictor.time is None and len(predictor.log) == 3


numbers = st.one_of(st.floats(), st.floats(-3, 3))


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.lists(st.sampled_from(NAMES + ('wheel', '')), max_size=4), st.lists(numbers, max_size=4),
                          st.integers(-2**62, 2**62) | st.integers(10 * S, 10 * S + 50_000_000)), max_size=25),
       st.sampled_from([0.0, 0.004]))
def test_no_message_breaks_it_or_gets_a_nan_through(messages, window):
    live = stream(merge_window=window)
    for names, positions, stamp in messages:
        for step in live.receive(names, positions, stamp, 10 * S):
            assert np.isfinite(step.positions).all()
        outlook = live.predict(np.array([0.1, 0.2]))
        assert outlook is None or np.isfinite(outlook.mean).all()
    assert live.tally.total['messages'] == len(messages)
