"""The executor serves everything rclpy's does: nothing is lost, nothing runs twice, nothing destroyed is called."""
import os
import subprocess
import sys
import threading
import time

import pytest
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from style_core.errors import MotionError, UsageError
from style_node.executor import PromptExecutor, run


class Setting:
    """A node under a `PromptExecutor`, and another that speaks to it."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=1 + os.getpid() % 100)
        self.node = rclpy.create_node('prompt', context=self.context)
        self.peer = rclpy.create_node('peer', context=self.context)
        self.executor, self.other = PromptExecutor(context=self.context), SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.other.add_node(self.peer)
        self.heard = []
        self.subscription = self.node.create_subscription(String, 'words', self.heard.append, 100)
        self.publisher = self.peer.create_publisher(String, 'words', 100)
        assert self.spin(lambda: self.publisher.get_subscription_count() == 1)

    def spin(self, condition, seconds=10.0):
        """Serve both nodes until the condition holds; whether it did."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.executor.spin_once(0.005)
            self.other.spin_once(0)
        return condition()

    def say(self, *words):
        for word in words:
            self.publisher.publish(String(data=str(word)))

    def close(self):
        self.executor.shutdown()
        self.other.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def setting():
    made = Setting()
    yield made
    made.close()


def test_every_message_once_and_in_order_beside_timers(setting):
    ticks = []
    setting.node.create_timer(0.002, lambda: ticks.append(len(setting.heard)))
    for first in range(0, 200, 20):
        setting.say(*range(first, first + 20))
        assert setting.spin(lambda n=first: len(setting.heard) == n + 20)
    assert [int(message.data) for message in setting.heard] == list(range(200)) and len(ticks) > 3


def test_services_answer_and_a_waiting_one_holds_up_its_own_group_only(setting):
    gate, order = Future(executor=setting.executor), []

    async def slow(request, response):
        order.append('asked')
        response.success = await gate
        order.append('answered')
        return response

    def quick(request, response):
        order.append('quick')
        return response
    setting.node.create_service(Trigger, 'slow', slow, callback_group=MutuallyExclusiveCallbackGroup())
    setting.node.create_service(Trigger, 'quick', quick)
    clients = [setting.peer.create_client(Trigger, name) for name in ('slow', 'quick')]
    assert setting.spin(lambda: all(client.service_is_ready() for client in clients))
    waiting = clients[0].call_async(Trigger.Request())
    assert setting.spin(lambda: order == ['asked'])
    answered = clients[1].call_async(Trigger.Request())
    setting.say('during')
    assert setting.spin(lambda: answered.done() and setting.heard) and not waiting.done()
    threading.Thread(target=gate.set_result, args=(True,)).start()
    assert setting.spin(waiting.done) and waiting.result().success
    assert order == ['asked', 'quick', 'answered']
    setting.say('after')
    assert setting.spin(lambda: len(setting.heard) == 2)


def test_a_waiting_coroutine_keeps_its_whole_group_waiting(setting):
    gate = Future(executor=setting.executor)

    async def slow(request, response):
        await gate
        return response
    setting.node.create_service(Trigger, 'slow', slow)   # in the group of the subscription
    client = setting.peer.create_client(Trigger, 'slow')
    assert setting.spin(client.service_is_ready)
    waiting = client.call_async(Trigger.Request())
    assert not setting.spin(waiting.done, 0.3)
    setting.say('held back')
    assert not setting.spin(lambda: setting.heard, 0.3)
    gate.set_result(None)
    assert setting.spin(lambda: waiting.done() and setting.heard)


def test_what_comes_and_goes_while_spinning(setting):
    calls = []

    def once():
        calls.append('timer')
        setting.node.destroy_timer(timer)
        setting.node.destroy_subscription(setting.subscription)
        setting.node.create_subscription(String, 'words', lambda message: calls.append(message.data), 100)
    timer = setting.node.create_timer(0.01, once)
    assert setting.spin(lambda: calls == ['timer'])
    assert setting.spin(lambda: setting.publisher.get_subscription_count() == 1)
    setting.say('new')
    assert setting.spin(lambda: calls == ['timer', 'new']) and setting.heard == []
    assert not setting.spin(lambda: len(calls) > 2, 0.1)
    second = rclpy.create_node('second', context=setting.context)
    second.create_subscription(String, 'words', lambda message: calls.append('second'), 100)
    setting.executor.add_node(second)
    assert setting.spin(lambda: setting.publisher.get_subscription_count() == 2)
    setting.say('both')
    assert setting.spin(lambda: {'both', 'second'} <= set(calls))
    setting.executor.remove_node(second)
    second.destroy_node()
    setting.say('one')
    assert setting.spin(lambda: 'one' in calls) and calls.count('second') == 1


def test_a_subscription_destroyed_by_another_with_a_message_waiting_is_not_called(setting):
    calls = []

    def first(message):
        calls.append('first')
        setting.node.destroy_subscription(setting.subscription)
    setting.node.destroy_subscription(setting.subscription)
    setting.node.create_subscription(String, 'words', first, 10)
    setting.subscription = setting.node.create_subscription(String, 'words', lambda message: calls.append('second'), 10)
    assert setting.spin(lambda: setting.publisher.get_subscription_count() == 2)
    setting.say('x')
    assert setting.spin(lambda: 'first' in calls)
    assert not setting.spin(lambda: 'second' in calls, 0.2) or calls == ['second', 'first']


def test_a_timer_that_is_always_due_keeps_no_service_waiting(setting):
    setting.node.create_timer(0.001, lambda: time.sleep(0.004))

    def yes(request, response):
        response.success = True
        return response

    async def slowly(request, response):
        return yes(request, response)
    setting.node.create_service(Trigger, 'yes', yes)
    setting.node.create_service(Trigger, 'slowly', slowly)
    for name in ('yes', 'slowly'):
        client = setting.peer.create_client(Trigger, name)
        assert setting.spin(client.service_is_ready)
        for _ in range(5):
            asked = client.call_async(Trigger.Request())
            assert setting.spin(asked.done, 5.0) and asked.result().success
    setting.say('and messages')
    assert setting.spin(lambda: setting.heard)


def test_a_coroutine_goes_on_before_the_next_timer(setting):
    """As rclpy has it: what a timer finishes is not seen unfinished by its next call."""
    order, gate = [], Future()

    async def wait():
        await gate
        order.append('went on')

    def tick():
        order.append('tick')
        if order.count('tick') == 3:
            gate.set_result(None)
    setting.node.create_service(Trigger, 'unrelated', lambda request, response: response)
    task = setting.executor.create_task(wait)
    setting.node.create_timer(0.001, tick)
    assert setting.spin(lambda: task.done() and order.count('tick') > 5)
    assert order[:4] == ['tick', 'tick', 'tick', 'went on']


def test_a_timer_cancelled_by_another_does_not_fire(setting):
    fired = []

    def first():
        fired.append('first')
        late.cancel()
    early = setting.node.create_timer(0.05, first)
    late = setting.node.create_timer(0.05, lambda: fired.append('late'))
    early.reset()
    late.reset()
    time.sleep(0.08)   # now both are due
    assert setting.spin(lambda: len(fired) > 2) and 'late' not in fired and late.is_canceled()


def test_errors_of_callbacks_end_nothing_where_somebody_takes_them(setting):
    taken, calls = [], []
    setting.executor.mishap = taken.append

    def fail(kind):
        def callback(*_):
            calls.append(kind)
            raise ValueError(kind)
        return callback
    setting.node.create_subscription(String, 'words', fail('message'), 10)
    timer = setting.node.create_timer(0.01, fail('timer'))
    setting.node.create_service(Trigger, 'fails', fail('service'))
    guard = setting.node.create_guard_condition(fail('guard'))
    client = setting.peer.create_client(Trigger, 'fails')
    assert setting.spin(client.service_is_ready)
    client.call_async(Trigger.Request())
    guard.trigger()

    def all_have():
        setting.say('word')
        return {'message', 'timer', 'service', 'guard'} <= set(calls)
    assert setting.spin(all_have)
    timer.cancel()
    heard = len(setting.heard)
    setting.say('more')
    assert setting.spin(lambda: len(setting.heard) > heard)     # whoever does not fail is served
    assert len(taken) == len(calls) and {str(error) for error in taken} == set(calls)


def test_tasks_run_and_errors_of_callbacks_come_out(setting):
    task = setting.executor.create_task(lambda: 'done')
    assert setting.spin(task.done) and task.result() == 'done'

    def fail():
        raise ZeroDivisionError
    setting.node.create_timer(0.001, fail)
    with pytest.raises(ZeroDivisionError):
        setting.spin(lambda: False, 5.0)


@pytest.mark.parametrize('error, status', [(UsageError('no such thing'), 2), (MotionError('damaged'), 1)])
def test_what_is_wrong_is_said_and_is_the_exit_status(capsys, error, status):
    def make():
        raise error
    assert run(make, 'a_node', args=[]) == status
    assert capsys.readouterr().err == f'a_node: {error}\n'


INTERRUPTED = """
import signal, sys
import rclpy
from rclpy import executors
from style_node.executor import run

leave = executors._WorkTracker.__exit__

def interrupt(*all):
    signal.raise_signal(signal.SIGINT)
    return leave(*all)

def make():
    node = rclpy.create_node('interrupted')
    executors._WorkTracker.__exit__ = interrupt
    node.create_guard_condition(lambda: None).trigger()
    return node

sys.exit(run(make, 'interrupted', args=[]))
"""


def test_ctrl_c_at_the_worst_moment_ends_the_program():
    # right before rclpy notes that a callback has ended, for which it waits at the end
    done = subprocess.run([sys.executable, '-c', INTERRUPTED], capture_output=True, text=True, timeout=30)
    assert done.returncode == 0 and 'Traceback' not in done.stderr
