import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.stream.frames import FrameAssembler

MS = 1_000_000
LEFT, RIGHT = np.array([0, 1]), np.array([2, 3])
BOTH = np.arange(4)


def add(assembler, channels, stamp_ms, value=None):
    value = stamp_ms if value is None else value
    frames, reason = assembler.add(channels, np.full(len(channels), float(value)), int(stamp_ms * MS))
    return [(frame.stamp / MS, list(np.flatnonzero(~np.isnan(frame.values)))) for frame in frames], reason


def assembler(window_ms=4, timeout_ms=100):
    return FrameAssembler(4, int(window_ms * MS), timeout_ms * MS)


def test_whole_messages_are_released_at_once():
    frames = assembler()
    for stamp in (10, 20, 30):
        assert add(frames, BOTH, stamp) == ([(stamp, [0, 1, 2, 3])], '')


def test_two_publishers_make_one_frame_once_both_are_known():
    frames = assembler()
    assert add(frames, LEFT, 10)[0] == [(10, [0, 1])]  # the right one has not spoken yet
    add(frames, RIGHT, 11)
    add(frames, LEFT, 20)
    add(frames, RIGHT, 21)
    for stamp in (30, 40, 50):
        assert add(frames, LEFT, stamp)[0] == []
        assert add(frames, RIGHT, stamp + 1)[0] == [(stamp + 1, [0, 1, 2, 3])]


def test_the_same_stamp_from_two_publishers_is_one_frame():
    frames = assembler()
    add(frames, LEFT, 10)
    assert add(frames, RIGHT, 10) == ([], 'late')  # unknown until now, so not waited for; from now on it is
    assert add(frames, LEFT, 20)[0] == []
    assert add(frames, RIGHT, 20)[0] == [(20, [0, 1, 2, 3])]


def test_the_slower_publisher_is_not_waited_for_between_its_messages():
    frames = assembler()
    released = []
    for stamp in range(0, 400, 5):
        released += [(stamp, frame) for frame in add(frames, LEFT, stamp)[0]]
        if stamp % 20 == 0:
            released += [(stamp + 1, frame) for frame in add(frames, RIGHT, stamp + 1)[0]]
    settled = [(now, frame) for now, frame in released if now > 100]
    assert all(frame[0] == now for now, frame in settled)  # nothing was held back past its own time
    assert sum(len(frame[1]) == 4 for _, frame in settled) >= 14


def test_a_publisher_that_falls_silent_holds_back_one_frame_only():
    frames = assembler()
    for stamp in (10, 20, 30):
        add(frames, LEFT, stamp)
        add(frames, RIGHT, stamp + 1)
    assert add(frames, LEFT, 40)[0] == []
    assert add(frames, LEFT, 50)[0] == [(40, [0, 1]), (50, [0, 1])]
    assert add(frames, LEFT, 60)[0] == [(60, [0, 1])]


def test_it_is_waited_for_again_when_it_is_back():
    frames = assembler()
    for stamp in (10, 20, 30):
        add(frames, LEFT, stamp)
        add(frames, RIGHT, stamp + 1)
    for stamp in (40, 50, 60):
        add(frames, LEFT, stamp)
    add(frames, RIGHT, 61)
    add(frames, LEFT, 70)
    add(frames, RIGHT, 71)
    add(frames, LEFT, 80)
    assert add(frames, RIGHT, 81)[0] == [(81, [0, 1, 2, 3])]


def test_a_joint_that_leaves_a_message_holds_back_one_frame_only():
    frames = assembler()
    add(frames, BOTH, 10)
    add(frames, BOTH, 20)
    assert add(frames, LEFT, 30)[0] == []
    assert add(frames, LEFT, 40)[0] == [(30, [0, 1]), (40, [0, 1])]


def test_repeated_and_older_stamps_are_dropped_by_name():
    frames = assembler()
    add(frames, BOTH, 10)
    assert add(frames, BOTH, 10) == ([], 'out of order')
    assert add(frames, LEFT, 9) == ([], 'out of order')


def test_without_a_window_every_message_is_a_frame():
    frames = assembler(window_ms=0)
    for stamp in (10, 20, 30):
        assert add(frames, LEFT, stamp)[0] == [(stamp, [0, 1])]
        assert add(frames, RIGHT, stamp + 1)[0] == [(stamp + 1, [2, 3])]


def test_ages():
    frames = assembler()
    add(frames, LEFT, 10)
    np.testing.assert_allclose(frames.ages(30 * MS), [0.02, 0.02, np.inf, np.inf])


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 15), st.integers(-6, 12)), max_size=60), st.sampled_from([0, 2, 5, 30]))
def test_every_measurement_is_used_at_most_once_and_frames_advance(messages, window_ms):
    frames = assembler(window_ms=window_ms)
    now, value, last, seen = 100, 0.0, -1, []
    for chosen, step in messages:
        now += step
        channels = np.array([i for i in range(4) if chosen >> i & 1])
        values = value + np.arange(len(channels))
        value += 10
        released, _ = frames.add(channels, values, now * MS)
        for frame in released:
            assert frame.stamp > last
            last = frame.stamp
            seen += list(frame.values[~np.isnan(frame.values)])
    assert len(seen) == len(set(seen))
