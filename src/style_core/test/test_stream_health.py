import numpy as np
from test_stream import NAMES, S, stream

from style_core.predictor import Status
from style_core.stream.health import ERROR, OK, WARN, health_of


def test_silence_is_an_error():
    report = health_of(stream(), 10 * S)
    assert (report.level, report.summary) == (ERROR, 'no joint states arrive')
    assert report.facts['joints never seen'] == 'hip knee ankle'


def test_tracking_is_fine_and_says_how_sure():
    live = stream()
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    outlook = live.predict(np.array([0.1, 0.2]))
    report = health_of(live, 10 * S + S // 100, outlook)
    assert (report.level, report.summary) == (OK, 'tracking')
    assert report.facts['stamp age (s)'] == '0.0100'
    assert report.facts['90 % band, mean half width (deg), nearest and farthest'] == '18.85, 18.85'
    assert 'update time p50, p99 (ms)' in report.facts


def test_counts_of_the_last_interval_raise_the_level_and_totals_stay():
    live = stream()
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S, 0)
    live.receive(NAMES, [1.0], 10 * S + 1, 0)
    report = health_of(live, 10 * S)
    assert report.level == WARN and '1 wrong length' in report.summary
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S + 2, 0)
    report = health_of(live, 10 * S)
    assert report.level == OK and report.facts['rejected: wrong length'] == '1'


def test_only_unusable_messages_is_an_error_with_the_reason():
    live = stream()
    live.receive(['wheel'], [1.0], 10 * S, 0)
    report = health_of(live, 10 * S)
    assert report.level == ERROR and '1 no known joint' in report.summary
    assert report.facts['unknown joints'] == 'wheel'


def test_missing_joints_and_a_lost_filter():
    live = stream()
    live.receive(['hip', 'knee'], [1.0, 2.0], 10 * S, 0)
    assert 'joints missing' in health_of(live, 10 * S).summary
    live.status = lambda: Status.LOST
    live.receive(NAMES, [1.0, 2.0, 3.0], 10 * S + 5, 0)
    assert health_of(live, 10 * S).level == ERROR
