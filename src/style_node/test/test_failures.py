"""No exception of a callback ends a node; a load that hangs keeps neither the next load nor the end waiting."""
import os
import signal
import subprocess
import sys
import threading

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from style_core import budgets
from style_core.errors import UsageError
from style_core.stream.health import ERROR, OK, Health
from style_node.diagnostics import diagnostics_message
from style_node.executor import PromptExecutor
from style_node.failures import CannotGoOn
from style_node.loader import Loader
from style_node.parameter_table import Parameter as Entry
from style_node.parameter_table import ParameterTable
from style_node.ros_parameters import declare, watch


def deep():
    return deep()


def greedy():
    return bytearray(1 << 62)


def divide():
    return 1 / 0


ERRORS = [deep, greedy, divide]


class Pair:
    """A node under a `PromptExecutor`, and a peer."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('tried', context=self.context)
        self.peer = rclpy.create_node('peer', context=self.context)
        self.executor, self.other = PromptExecutor(context=self.context), SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.other.add_node(self.peer)

    def spin(self, condition, seconds=10.0):
        for _ in range(int(seconds / 0.005)):
            if condition():
                break
            self.executor.spin_once(0.005)
            self.other.spin_once(0)
        return condition()

    def call(self, kind, name, request=None):
        client = self.peer.create_client(kind, name)
        assert self.spin(client.service_is_ready)
        future = client.call_async(request or kind.Request())
        assert self.spin(future.done), 'no answer'
        return future.result()

    def report(self, health=None):
        return diagnostics_message(self.node, 'tried', health or Health(OK, 'well', {})).status[0]

    def close(self):
        self.executor.shutdown(timeout_sec=0.2)
        self.other.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def pair():
    made = Pair()
    yield made
    made.close()


@pytest.mark.parametrize('fail', ERRORS)
def test_a_message_that_cannot_be_served_is_refused_and_the_next_is_served(pair, fail, capfd):
    heard = []

    def take(message):
        if message.data == 'bad':
            fail()
        heard.append(message.data)
    pair.node.create_subscription(String, 'words', take, 10)
    publisher = pair.peer.create_publisher(String, 'words', 10)
    assert pair.spin(lambda: publisher.get_subscription_count() == 1)
    for word in ('bad', 'bad', 'good'):
        publisher.publish(String(data=word))
    assert pair.spin(lambda: heard == ['good'])
    assert pair.executor.failures.total == 2
    first = pair.report()
    assert ord(first.level) == ERROR and '2 callbacks failed' in first.message and fail.__name__ in first.message
    assert ord(pair.report().level) == OK
    assert {pair_.key: pair_.value for pair_ in pair.report().values}['callbacks failed'] == '2'
    assert capfd.readouterr().err.count('a callback failed') == 1      # said once


@pytest.mark.parametrize('fail', ERRORS)
def test_a_timer_that_fails_goes_on(pair, fail):
    calls = []

    def tick():
        calls.append(0)
        fail()
    pair.node.create_timer(0.01, tick)
    assert pair.spin(lambda: len(calls) > 3)


@pytest.mark.parametrize('fail', ERRORS)
@pytest.mark.parametrize('group', [None, MutuallyExclusiveCallbackGroup])
def test_a_service_that_fails_answers_so_every_time(pair, fail, group):
    pair.node.create_service(Trigger, 'try', lambda request, response: fail(), callback_group=group and group())
    for _ in range(2):
        answer = pair.call(Trigger, 'try')
        assert not answer.success and 'the request failed' in answer.message and len(answer.message) < 500


def test_a_coroutine_that_fails_answers_so(pair):
    async def serve(request, response):
        divide()
    pair.node.create_service(Trigger, 'try', serve)
    assert 'ZeroDivisionError' in pair.call(Trigger, 'try').message


def test_a_request_that_cannot_be_taken_leaves_its_service_alive(pair):
    service = pair.node.create_service(Trigger, 'try', lambda request, response: Trigger.Response(success=True))
    taken, whole = [], pair.executor._take_service

    def take(entity):
        taken.append(entity)
        if len(taken) == 1:
            whole(entity)
            raise UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'made up')
        return whole(entity)
    pair.executor._take_service = take
    client = pair.peer.create_client(Trigger, 'try')
    assert pair.spin(client.service_is_ready)
    client.call_async(Trigger.Request())
    assert pair.spin(lambda: pair.executor.failures.total == 1)
    assert pair.call(Trigger, 'try').success and service in pair.node.services


@pytest.mark.parametrize('fail', ERRORS)
def test_a_parameter_that_cannot_be_applied_is_refused(pair, fail):
    table = ParameterTable((Entry('depth', 1, 'Of it', lower=0, upper=9),))
    declare(pair.node, table)
    watch(pair.node, table, lambda: False, lambda values: fail())
    wanted = [Parameter('depth', value=2).to_parameter_msg()]
    one = pair.call(SetParametersAtomically, '/tried/set_parameters_atomically',
                    SetParametersAtomically.Request(parameters=wanted))
    assert not one.result.successful and one.result.reason
    each = pair.call(SetParameters, '/tried/set_parameters', SetParameters.Request(parameters=wanted))
    assert not each.results[0].successful
    assert pair.node.get_parameter('depth').value == 1 and pair.executor.failures.total == 2


def test_what_must_end_the_program_does(pair):
    def give_up():
        raise CannotGoOn('no motors')
    pair.node.create_timer(0.001, give_up)
    with pytest.raises(CannotGoOn):
        pair.spin(lambda: False, 5.0)


def test_a_report_is_bounded_and_on_one_line_whatever_it_is_about(pair):
    health = Health(OK, 'x' * 10**6, {f'{n}' * 50: '\n\x1b[31m' + 'y' * 10**6 for n in range(300)})
    status = pair.report(health)
    assert len(status.message) < 2 * budgets.FACT_TEXT
    assert sum(len(one.key) + len(one.value) for one in status.values) < budgets.FACTS_TEXT + 200
    assert all(one.value.isprintable() and one.key.isprintable() for one in status.values)


class Loading:
    """A service that loads what it is asked for by name, through a `Loader`."""

    def __init__(self, pair):
        self.gate, self.pair = threading.Event(), pair
        self.loader, self.outcomes = Loader(pair.node, self.load), []

    def load(self, path):
        if path == 'hangs':
            self.gate.wait()
        if path == 'fails':
            deep()
        return path

    def ask(self, path):
        async def wait():
            try:
                self.outcomes.append(await self.loader.load(path))
            except Exception as error:
                self.outcomes.append(error)
        self.pair.executor.create_task(wait)


@pytest.fixture
def loading(pair):
    made = Loading(pair)
    yield made
    made.gate.set()


def test_a_load_that_hangs_gives_way_to_the_next(pair, loading):
    loading.ask('hangs')
    assert pair.spin(lambda: len(loading.loader._threads) == 1)
    loading.ask('other')
    assert pair.spin(lambda: 'other' in loading.outcomes and len(loading.outcomes) == 2)
    assert any('given up' in str(outcome) for outcome in loading.outcomes)
    loading.gate.set()     # what comes of it later is ignored
    assert pair.spin(lambda: not loading.loader._threads[0].is_alive()) and len(loading.outcomes) == 2


def test_loads_that_hang_are_counted_and_then_refused(pair, loading):
    for _ in range(budgets.HANGING_LOADS + 3):
        loading.ask('hangs')
    assert pair.spin(lambda: len(loading.outcomes) == budgets.HANGING_LOADS + 2)
    assert sum('have not ended' in str(outcome) for outcome in loading.outcomes) == 2


def test_a_load_that_fails_says_so(pair, loading):
    for path in ('fails', '', 'a\0b', 'x' * 5000):
        loading.ask(path)
        assert pair.spin(lambda: len(loading.outcomes) == 1)
        assert isinstance(loading.outcomes.pop(), RecursionError if path == 'fails' else UsageError)


HANGS = """
import sys, time
import rclpy
from style_node.executor import run
from style_node.loader import Loader

def forever(path):
    print('loading', flush=True)
    {what}

def make():
    node = rclpy.create_node('hangs')
    loader = Loader(node, forever)
    async def load():
        timer.cancel()
        await loader.load('model')
    timer = node.create_timer(0.01, lambda: (timer.cancel(), node.executor.create_task(load)))
    return node

sys.exit(run(make, 'hangs', args=[]))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('what', ['open(sys.argv[1]).read()', 'time.sleep(1e6)', 'while True: pass',
                                  '[sum(range(10**5)) for _ in range(10**9)]'])
def test_a_signal_ends_the_program_while_a_load_hangs(tmp_path, number, what):
    os.mkfifo(tmp_path / 'fifo')
    program = subprocess.Popen([sys.executable, '-c', HANGS.format(what=what), str(tmp_path / 'fifo')],
                               stdout=subprocess.PIPE, text=True)
    try:
        assert program.stdout.readline() == 'loading\n'
        program.send_signal(number)
        assert program.wait(20) == 0        # for ever is what it would be otherwise
    finally:
        program.kill()
        program.stdout.close()
        program.wait()
