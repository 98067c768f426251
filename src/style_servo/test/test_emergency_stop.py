"""The emergency stop as a state: whoever speaks, in which order, by which stream, and whoever falls silent."""
import itertools
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import UsageError
from style_servo.emergency_stop import BEST_EFFORT, LATCHED, RELIABLE, Button, EmergencyStop

STREAMS = (LATCHED, RELIABLE, BEST_EFFORT)      # strongest first


class Topic:
    """A button and the publishers of its topic; what they say arrives on every stream that they reach."""

    def __init__(self, *publishers):
        self.button, self.publishers, self.now = Button('/estop'), list(publishers), 0.0

    def hear(self, pressed, stream):
        self.now += 0.001
        self.button.hear(pressed, stream, self.now, lambda: self.publishers)

    def say(self, pressed, publisher):
        for stream in STREAMS[STREAMS.index(publisher):]:
            self.hear(pressed, stream)


@pytest.mark.parametrize('publisher', STREAMS)
def test_one_publisher_presses_and_releases_whatever_it_offers(publisher):
    topic = Topic(publisher)
    assert not topic.button.known and not topic.button.pressed
    for pressed in (True, False, False, True, True, False):
        topic.say(pressed, publisher)
        assert topic.button.pressed is pressed and topic.button.known


@given(said=st.lists(st.booleans(), min_size=1, max_size=8), data=st.data())
@settings(derandomize=True, max_examples=300, deadline=None)
def test_streams_that_run_apart_and_lose_end_in_what_was_said_last_and_never_release_wrongly(said, data):
    """The strongest stream delivers everything; best effort loses, and all streams run at their own pace."""
    publisher = data.draw(st.sampled_from(STREAMS))
    topic, queues = Topic(publisher), {}
    for stream in STREAMS[STREAMS.index(publisher):]:
        lost = stream is BEST_EFFORT and publisher is not BEST_EFFORT
        queues[stream] = [one for one in said if not (lost and data.draw(st.booleans(), label='lost'))]
    strongest = []
    while any(queues.values()):
        stream = data.draw(st.sampled_from([stream for stream in queues if queues[stream]]))
        pressed = queues[stream].pop(0)
        topic.hear(pressed, stream)
        strongest += [pressed] if stream == publisher else []
        if strongest and strongest[-1]:
            assert topic.button.pressed     # what the strongest stream says last is what counts, if it is true
    if said[-1]:
        assert topic.button.pressed


def test_a_pressed_button_stays_pressed_when_its_publisher_goes_and_another_one_may_release_it():
    topic = Topic(LATCHED)
    topic.say(True, LATCHED)
    topic.publishers = []
    assert topic.button.pressed
    topic.publishers = [BEST_EFFORT]        # whatever it offers
    topic.say(True, BEST_EFFORT)
    topic.say(False, BEST_EFFORT)
    assert not topic.button.pressed


@pytest.mark.parametrize('first, second', itertools.product(STREAMS, STREAMS))
def test_with_two_publishers_pressed_by_any_is_pressed(first, second):
    topic = Topic(first, second)
    topic.say(False, first)
    topic.say(True, second)
    for _ in range(3):
        topic.say(False, first)     # says nothing about the other one
        assert topic.button.pressed
    topic.publishers.pop()
    topic.say(False, first)         # the one that pressed is gone, and has released nothing
    assert topic.button.pressed
    topic.button.override()
    assert not topic.button.pressed
    topic.say(False, first)
    topic.say(True, first)
    topic.say(False, first)         # now alone
    assert not topic.button.pressed


def test_a_second_publisher_that_came_while_pressed_does_not_release():
    topic = Topic(RELIABLE)
    topic.say(True, RELIABLE)
    topic.publishers.append(RELIABLE)
    topic.say(False, RELIABLE)
    assert topic.button.pressed


def test_an_unknown_button_counts_as_pressed_where_it_is_required():
    assert EmergencyStop(['/estop']).reason(0.0) == ''
    stop = EmergencyStop(['/one', '/two'], required=True)
    for button in stop.buttons:
        assert f'nothing was heard on {button.topic}' in stop.reason(0.0)
        button.hear(False, LATCHED, 0.0, lambda: [LATCHED])
    assert stop.reason(1e6) == '' and stop.known


def test_silence_is_a_stop_where_there_is_a_heartbeat():
    stop = EmergencyStop(['/estop'], heartbeat=0.5)
    hear = partial(stop.buttons[0].hear, stream=LATCHED, publishers=lambda: [LATCHED])
    assert 'nothing was heard' in stop.reason(0.0)
    hear(False, now=10.0)
    assert stop.reason(10.5) == ''
    assert 'silent for more than 0.5 s' in stop.reason(10.51)
    stop.override(lambda topic: 0)      # the operator's word is no heartbeat
    assert 'silent' in stop.reason(10.52)
    hear(False, now=11.0)
    assert stop.reason(11.1) == ''
    hear(True, now=11.2)
    assert 'pressed on /estop' in stop.reason(11.3)


def test_any_button_stops_and_each_is_released_by_itself():
    stop = EmergencyStop(['/one', '/two'])
    one, two = (partial(button.hear, stream=LATCHED, now=0.0, publishers=lambda: [LATCHED])
                for button in stop.buttons)
    one(True)
    two(True)
    one(False)
    assert 'pressed on /two' in stop.reason(0.0)
    one(True)
    two(False)
    assert 'pressed on /one' in stop.reason(0.0)
    one(False)
    assert stop.reason(0.0) == ''


def test_the_operator_releases_where_nobody_can_and_nowhere_else():
    stop = EmergencyStop(['/estop', '/other'])
    stop.buttons[0].hear(True, LATCHED, 0.0, lambda: [LATCHED])
    with pytest.raises(UsageError, match='its publisher is there'):
        stop.override(lambda topic: 1)
    assert stop.reason(0.0)
    stop.override(lambda topic: 0)
    assert stop.reason(0.0) == ''


def test_a_stop_by_service_lasts_until_it_is_lifted():
    stop = EmergencyStop(['/estop'])
    stop.by_service = True
    stop.buttons[0].hear(False, LATCHED, 0.0, lambda: [LATCHED])
    stop.override(lambda topic: 0)
    assert 'by service' in stop.reason(0.0)
