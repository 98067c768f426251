"""Run a node with little between a message and its callback; every node of the suite is run by `run`."""
import gc
import signal
import sys
from contextlib import ExitStack
from time import monotonic

import rclpy
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.waitable import NumberOfEntities

from style_core.errors import ModelError, MotionError, UsageError

__all__ = ['PromptExecutor', 'run']

#: while messages or timers keep coming, how often everything else is looked at, and after how long a silence they no
#: longer do, s
LOOK_EVERY, SILENCE = 0.01, 0.05
#: no wait is longer, s: a signal that comes between two waits is noticed nevertheless
LONGEST = 1.0


class PromptExecutor(SingleThreadedExecutor):
    """Humble's single-threaded executor with a short way for subscriptions and timers.

    rclpy gathers everything a node has before every wait, and wraps every callback in a task whose end wakes the
    executor once more: most of a millisecond a message. Here what is waited for is gathered when it changes, and
    callbacks of timers and subscriptions are called at once, in this order. Everything else (services, clients,
    actions, tasks) is left to rclpy, and so is all of it while a coroutine keeps a callback group busy.

    A wait takes the longer the more there is to wait for. So while messages or timers keep coming, only they (and what
    wakes the executor) are waited for; everything else is looked at every 10 ms, just after one of them was served,
    when the next is not due yet. Garbage is collected at that moment too, where `run` has taken over collecting it.
    Callbacks of timers and subscriptions must be plain functions.

    Parameters
    ----------
    context : rclpy.Context, optional
    services_wait : bool
        False: everything is always waited for, as an emergency stop may be a service.
    mishap : callable, optional
        Takes an exception that a callback raised; without it the exception ends the program.
    """

    def __init__(self, *, context=None, services_wait=True, mishap=None):
        super().__init__(context=context)
        self.mishap = mishap
        self._services_wait = services_wait
        self._changed = True
        self._held = ExitStack()
        self._flowing = False
        self._look_at = 0.0

    def wake(self):
        """What there is to wait for has changed."""
        self._changed = True
        super().wake()

    def add_node(self, node):
        """Serve a node; whether it is new here."""
        self._changed = True
        return super().add_node(node)

    def remove_node(self, node):
        """Serve a node no longer."""
        self._changed = True
        super().remove_node(node)

    def shutdown(self, timeout_sec=None):
        """Stop, and let go of everything."""
        self._held.close()
        return super().shutdown(timeout_sec)

    def spin_once(self, timeout_sec=None):
        """Wait for callbacks and run those that are ready."""
        if self._changed:
            self._changed = False
            self._gather()
        if self._tasks_wait():
            self._rest()
            return
        if not all(one.callback_group.can_execute(one) for one in self._one_a_group):
            self._guarded(super().spin_once, timeout_sec)
            return
        if not self._flowing:
            longest = LONGEST if timeout_sec is None else min(timeout_sec, LONGEST)
            self._flowing = self._serve(self._whole, longest) and self._services_wait
            self._tidy()
            return
        if (now := monotonic()) >= self._look_at:
            self._look_at = now + LOOK_EVERY
            self._serve(self._whole, 0)
            self._tidy()
            return
        self._flowing = self._serve(self._quick, SILENCE if timeout_sec is None else min(timeout_sec, SILENCE))

    def _serve(self, which, timeout_sec):
        """Wait for a set of entities and serve what is ready; whether there were messages or timers."""
        wait_set, entries, waitables = which
        wait_set.clear_entities()
        for add, handle in entries:
            add(handle)
        for one in waitables:
            one.add_to_wait_set(wait_set)
        wait_set.wait(round(timeout_sec * 1e9))
        if self._is_shutdown:
            return False
        if not self._context.ok():
            raise ExternalShutdownException
        ready = wait_set.get_ready_entities
        timers = _of(self._timers, ready('timer'))
        for timer in timers:  # in rclpy's order
            self._run(timer, _call)
        subscriptions = _of(self._subscriptions, ready('subscription'))
        for subscription in subscriptions:
            self._run(subscription, _take)
        guards = _of(self._guards, ready('guard_condition'))
        for guard in guards:
            guard._executor_triggered = True  # rclpy triggers it again and serves it
        if guards or (which is self._whole and (
                ready('service') or ready('client') or any(one.is_ready(wait_set) for one in waitables))):
            self._rest()
        return bool(timers or subscriptions)

    def _tidy(self):
        """Collect garbage by the collector's own rule, where it does not do so itself."""
        if gc.isenabled():
            return
        counts, limits = gc.get_count(), gc.get_threshold()
        if counts[0] > limits[0]:
            gc.collect(2 if counts[2] > limits[2] else 1 if counts[1] > limits[1] else 0)

    def _rest(self):
        """Let rclpy serve everything that is ready once, so that busy timers keep no service waiting."""
        self._cb_iter = None  # what it knew to be ready may be no more
        while True:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
            except (TimeoutException, ShutdownException):
                return
            self._guarded(self._finish, handler)

    @staticmethod
    def _finish(handler):
        handler()
        if handler.exception() is not None:
            raise handler.exception()

    def _guarded(self, call, argument):
        """Call, and hand on what a callback raises."""
        try:
            call(argument)
        except (ExternalShutdownException, ShutdownException, TimeoutException):
            raise
        except Exception as error:
            if self.mishap is None or not self._context.ok():
                raise
            self.mishap(error)

    def _tasks_wait(self):
        """Whether coroutines can go on; earlier releases of Humble ask all that have not ended."""
        if hasattr(self, '_ready_tasks'):
            return len(self._ready_tasks) > 0
        return any(not one[0].done() for one in self._tasks)

    def _gather(self):
        """Note what to wait for and how to add it to a wait set, and hold it so that nobody destroys it meanwhile."""
        self._held.close()
        nodes = self.get_nodes()
        self._subscriptions, self._guards, self._timers, clients, services, self._waitables = (
            [one for node in nodes for one in getattr(node, kind)]
            for kind in ('subscriptions', 'guards', 'timers', 'clients', 'services', 'waitables'))
        guards = [*self._guards, self._guard, self._sigint_gc]
        self._quick = self._waiting(self._subscriptions, guards, self._timers)
        self._whole = self._waiting(self._subscriptions, guards, self._timers, clients, services, self._waitables)
        everything = (*self._subscriptions, *self._guards, *self._timers, *clients, *services, *self._waitables)
        self._one_a_group = list({id(one.callback_group): one for one in everything}.values())
        for one in (*(handle for _, handle in self._whole[1]), *self._waitables):
            self._held.enter_context(one)

    def _waiting(self, subscriptions, guards, timers, clients=(), services=(), waitables=()):
        """A wait set, how to add each entity to it, and waitables, which add themselves."""
        kinds = subscriptions, guards, timers, clients, services
        count = sum((one.get_num_entities() for one in waitables), NumberOfEntities(*map(len, kinds)))
        wait_set = rclpy_implementation.WaitSet(
            count.num_subscriptions, count.num_guard_conditions, count.num_timers, count.num_clients,
            count.num_services, count.num_events, self._context.handle)
        add = (wait_set.add_subscription, wait_set.add_guard_condition, wait_set.add_timer, wait_set.add_client,
               wait_set.add_service)
        return wait_set, [(add_one, one.handle) for add_one, kind in zip(add, kinds) for one in kind], waitables

    def _run(self, entity, serve):
        if self._changed and entity not in self._alive():
            return  # an earlier callback has destroyed it
        group = entity.callback_group
        if not group.beginning_execution(entity):
            return
        try:
            self._guarded(serve, entity)
        finally:
            group.ending_execution(entity)

    def _alive(self):
        return [one for node in self.get_nodes() for kind in (node.subscriptions, node.timers) for one in kind]


def _take(subscription):
    taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    if taken is not None:
        subscription.callback(taken[0])


def _call(timer):
    if not timer.is_canceled() and timer.handle.is_timer_ready():
        timer.handle.call_timer()
        timer.callback()


def _of(entities, pointers):
    return [one for one in entities if one.handle.pointer in pointers] if pointers else ()


def run(make_node, name, until=None, args=None, switch_interval=0.0005, services_wait=True):
    """Run a node until it is told to stop; returns the exit status of its program.

    Parameters
    ----------
    make_node : callable
        Returns the node. What it raises about its parameters or files is printed, not shown as a traceback; a method
        ``release`` of the node is called before it is destroyed.
    name : str
        Of the program.
    until : callable, optional
        Takes the node; true when it is done.
    args : list of str, optional
        Command line.
    services_wait : bool
        See PromptExecutor.
    switch_interval : float
        After this long (s) a thread that computes lets another one in: a model loading in its thread must not hold up
        messages.

    A node with a method ``mishap`` is not ended by what its callbacks raise: the method takes the exception.
    """
    node = None

    def interrupted(*_):
        # rclpy ends the context; an exception out of nowhere would tear its executor, which then waits for ever
        if node is None:
            raise KeyboardInterrupt

    sys.setswitchinterval(switch_interval)
    gc.disable()  # the executor collects between messages
    signal.signal(signal.SIGINT, interrupted)
    rclpy.init(args=args)
    executor = PromptExecutor(services_wait=services_wait)
    try:
        node = make_node()
        executor.mishap = getattr(node, 'mishap', None)
        executor.add_node(node)
        gc.collect()
        gc.freeze()  # what is there now stays; the collector need not look at it again
        while rclpy.ok() and not (until and until(node)):
            executor.spin_once(timeout_sec=0.2 if until else None)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except rclpy_implementation.RCLError:
        if rclpy.ok():
            raise  # otherwise the context has ended while a callback used it
    except (UsageError, MotionError, ModelError, OSError) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    finally:
        gc.enable()
        if node is not None:
            getattr(node, 'release', lambda: None)()
            executor.shutdown()
            node.destroy_node()
        rclpy.try_shutdown()
        if node is not None:  # a second Ctrl-C: Python gives every other handler back while it ends
            signal.signal(signal.SIGINT, signal.SIG_IGN)
    return 0
