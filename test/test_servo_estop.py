"""The emergency stop over real middleware: a state, whoever said it, when, and with whatever quality of service."""
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from servo_rig import ServoRig
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from style_node.executor import PromptExecutor
from style_servo.bridge import Points
from style_servo.bridge_node import BridgeNode
from style_servo.record import read_record, violations
from style_servo.states import State

CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP = (
    getattr(Transition, f'TRANSITION_{name}') for name in ('CONFIGURE', 'ACTIVATE', 'DEACTIVATE', 'CLEANUP'))
OFFERS = {'latched': (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
          'volatile': (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
          'best_effort': (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
          'best_effort_latched': (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.TRANSIENT_LOCAL)}


class Button:
    """A publisher of the emergency stop; the only one."""

    def __init__(self, rig, offer, topic='/estop'):
        reliability, durability = OFFERS[offer]
        self._rig = rig
        self._publisher = rig.node.create_publisher(
            Bool, topic, QoSProfile(depth=1, reliability=reliability, durability=durability))

    def heard(self):
        """Wait until a bridge listens."""
        self._rig.until(lambda: self._publisher.get_subscription_count() > 0)
        return self

    def say(self, pressed):
        self._publisher.publish(Bool(data=pressed))

    def go(self):
        self._rig.node.destroy_publisher(self._publisher)


@pytest.fixture
def start(tmp_path):
    """Start a rig, with a bridge or without; nobody publishes on the topic of its emergency stop yet."""
    rigs = []

    def begin(bridge=True, **parameters):
        rig = ServoRig(str(tmp_path), **parameters)
        rigs.append(rig)
        rig.node.destroy_publisher(rig.estop)
        if not bridge:
            rig.bridge.kill()
            rig.bridge.wait()
        return rig
    yield begin
    for rig in rigs:
        rig.close()


def torque(rig):
    return any(servo['torque'] for servo in rig.tell('state')['servos'])


def configure(rig):
    assert any(rig.change(CONFIGURE) for _ in range(4)), rig.log()


def is_refused(rig, words):
    """Activation fails, says why, and torque never was on."""
    said = rig.log().count(words)
    assert not rig.change(ACTIVATE)
    rig.until(lambda: rig.log().count(words) > said)
    assert not torque(rig)


def arms(rig):
    assert any(rig.change(ACTIVATE) for _ in range(3)), rig.log()
    rig.wait_for(State.READY)
    assert torque(rig)


def test_a_latched_press_from_before_the_bridge_started_keeps_it_from_arming(start):
    rig = start(bridge=False)
    button = Button(rig, 'latched')
    button.say(True)
    rig.bridge = rig.start_bridge()
    configure(rig)
    is_refused(rig, 'pressed on /estop')
    button.say(False)
    arms(rig)


@pytest.mark.parametrize('offer', OFFERS)
def test_every_quality_of_service_is_heard_and_a_press_outlives_its_publisher(start, offer):
    rig = start()
    rig.up()
    button = Button(rig, offer).heard()
    rig.until(lambda: rig.state is State.ESTOP, doing=lambda: button.say(True))
    answer = rig.trigger('reset')
    assert not answer.success and 'still pressed' in answer.message
    button.go()
    assert rig.change(DEACTIVATE) and not torque(rig)
    is_refused(rig, 'pressed on /estop')
    assert rig.change(CLEANUP)
    configure(rig)
    is_refused(rig, 'pressed on /estop')
    if offer == 'latched':      # by the operator, where its publisher never comes back
        assert rig.trigger('release_estop').success
    else:                       # by a publisher that has come back
        button = Button(rig, offer).heard()
        rig.until(lambda: 'its publisher is there' in rig.trigger('release_estop').message)
        button.say(True)
        rig.spin(0.2)
        is_refused(rig, 'pressed on /estop')
        for _ in range(5):      # best effort
            button.say(False)
            rig.spin(0.1)
    arms(rig)


def test_one_of_two_publishers_does_not_release_what_the_other_one_pressed(start):
    rig = start()
    rig.up()
    one, two = Button(rig, 'latched').heard(), Button(rig, 'volatile').heard()
    rig.until(lambda: rig.node.count_publishers('/estop') == 2)
    two.say(False)
    one.say(True)
    rig.wait_for(State.ESTOP)
    for _ in range(20):
        two.say(False)
        rig.spin(0.02)
    assert rig.states[-1].estop_held and 'only ~/release_estop' in rig.trigger('reset').message
    assert rig.trigger('release_estop').success
    assert rig.trigger('reset').success
    rig.stream_until(State.STREAMING)
    # what is sent while stopped is refused and counted, and does not move anything when the stop is over
    one.say(True)
    rig.wait_for(State.ESTOP)
    rejected = rig.states[-1].rejected
    rig.stream(0.3)
    rig.until(lambda: rig.states[-1].rejected > rejected)
    assert rig.state is State.ESTOP
    one.go()
    two.go()
    assert rig.trigger('release_estop').success
    assert rig.trigger('reset').success
    rig.wait_for(State.READY)
    at = list(rig.states[-1].commanded)
    rig.spin(0.5)
    assert list(rig.states[-1].commanded) == at and rig.state is State.READY


def test_unknown_counts_as_pressed_where_it_is_required_and_silence_is_a_stop(start):
    rig = start(estop_heartbeat=1.0)
    configure(rig)
    is_refused(rig, 'nothing was heard on /estop')
    button = Button(rig, 'best_effort').heard()
    timer = rig.node.create_timer(0.05, lambda: button.say(False))
    rig.spin(0.3)
    arms(rig)
    rig.stream_until(State.STREAMING)
    timer.cancel()
    rig.wait_for(State.ESTOP)
    assert 'silent for more than 1 s' in rig.reason
    assert 'silent' in rig.trigger('reset').message
    timer.reset()
    rig.until(lambda: not rig.states[-1].estop_held)
    assert rig.trigger('reset').success
    rig.wait_for(State.READY)


def test_a_stop_by_service_outlives_deactivation_and_clean_up_until_a_reset(start):
    rig = start()
    rig.up()
    rig.stream_until(State.STREAMING)
    assert rig.trigger('estop').success
    rig.wait_for(State.ESTOP)
    assert rig.change(DEACTIVATE)
    is_refused(rig, 'emergency stop by service')
    assert rig.change(CLEANUP)
    configure(rig)
    is_refused(rig, 'emergency stop by service')
    assert not rig.change(CONFIGURE)        # twice
    assert rig.trigger('reset').success
    arms(rig)
    assert not rig.change(ACTIVATE) and torque(rig)
    assert rig.trigger('estop').success
    rig.wait_for(State.ESTOP)
    assert rig.trigger('reset').success
    rig.wait_for(State.READY)


def test_a_peer_can_neither_weaken_the_stop_nor_write_files_nor_end_the_bridge(start, tmp_path):
    rig = start(estop_required=True)
    precious = tmp_path.parent / f'{tmp_path.name}_precious'
    precious.write_text('mine')
    (tmp_path / 'link').symlink_to(tmp_path.parent)

    def set_parameters(*parameters):
        results = rig.call(SetParameters, '/servo_bridge/set_parameters',
                           SetParameters.Request(parameters=list(parameters))).results
        return results[0].successful, results[0].reason

    def set_one(name, value):
        return set_parameters(Parameter(name, value=value).to_parameter_msg())
    for name, value in (('estop_required', False), ('estop_topics', ['other']), ('estop_heartbeat', 5.0),
                        ('record_folder', '/'), ('stop_with_parent', True)):
        successful, reason = set_one(name, value)
        assert not successful and 'cannot change while the node runs' in reason
    for name in (str(precious), f'../{precious.name}', f'link/{precious.name}'):
        assert set_one('record', name)[0]
        assert not rig.change(CONFIGURE)
        rig.until(lambda name=name: name in rig.log())
    assert precious.read_text() == 'mine' and len(list(tmp_path.parent.glob(f'{precious.name}*'))) == 1
    assert set_one('record', 'record')[0]
    # a type that does not exist makes rclpy raise in its own callback, which is not answered
    client = rig.node.create_client(SetParameters, '/servo_bridge/set_parameters')
    assert client.wait_for_service(30.0)
    client.call_async(SetParameters.Request(parameters=[
        ParameterMessage(name='rate', value=ParameterValue(type=99))]))
    rig.until(lambda: 'Traceback' in rig.log())
    configure(rig)
    is_refused(rig, 'nothing was heard on /estop')
    button = Button(rig, 'latched').heard()
    button.say(False)
    arms(rig)
    for name, value in (('record', 'other'), ('estop_action', 'torque_off'), ('hold_error', 3.0)):
        assert 'cannot change while the node is configured' in set_one(name, value)[1]
    client.call_async(SetParameters.Request(parameters=[
        ParameterMessage(name='rate', value=ParameterValue(type=99))]))
    rig.stream_until(State.STREAMING)
    rig.until(lambda: any(one.key == 'errors of the program' and int(one.value) >= 1
                          for message in rig.diagnostics for one in message.status[0].values), 10, rig.send_legal)
    rig.stream_until(State.STREAMING)
    assert rig.bridge.poll() is None


def test_a_full_disk_ends_the_record_and_the_robot_drives_on(start, tmp_path):
    """A disk of 64 kB where it may be mounted, else a limit of the kernel on the size of files."""
    small = tmp_path / 'small'
    small.mkdir()
    mounted = not subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=64k', 'tmpfs', str(small)],
                                 stderr=subprocess.DEVNULL, check=False).returncode
    try:
        rig = start(bridge=False, record_folder=str(small))
        rig.bridge = rig.start_bridge(limit=None if mounted else 1 << 16)
        rig.up()
        problem = 'No space left' if mounted else 'File too large'
        rig.until(lambda: 'the flight record has ended' in rig.log(), 30, rig.send_legal)
        rig.stream_until(State.STREAMING)
        rig.stream(1.5)
        assert rig.state is State.STREAMING and torque(rig)
        rig.until(lambda: problem in rig.diagnostics[-1].status[0].message, 10, rig.send_legal)
        assert rig.log().count('the flight record has ended') == 1
        rig.close()
        counts = violations(read_record(small / 'record'))
        assert counts.pop('commands') > 100 and not any(counts.values())
    finally:
        if mounted:
            subprocess.run(['umount', '-l', str(small)], check=True)


def test_a_bridge_whose_launcher_has_gone_brakes_and_switches_torque_off(start):
    rig = start(bridge=False, stop_with_parent=True)
    launcher = subprocess.Popen(
        [sys.executable, '-c', 'import subprocess, sys; child = subprocess.Popen(sys.argv[1:]); '
         'print(child.pid, flush=True); child.wait()', *rig.bridge.args],
        stdout=subprocess.PIPE, stderr=open(rig.folder / 'launched', 'w'), text=True)       # noqa: SIM115
    bridge = int(launcher.stdout.readline())
    try:
        rig.up()
        rig.stream_until(State.STREAMING)
        rig.stream(0.3)
        launcher.send_signal(signal.SIGKILL)
        launcher.wait()
        rig.until(lambda: not os.path.exists(f'/proc/{bridge}') or zombie(bridge))
        assert not torque(rig)
        assert 'the program that started this bridge has ended' in (rig.folder / 'launched').read_text()
        record = read_record(rig.record)
        assert not any(count for name, count in violations(record).items() if name != 'commands')
        assert record.state[-1] == State.DISARMED
    finally:
        launcher.stdout.close()
        if os.path.exists(f'/proc/{bridge}') and not zombie(bridge):
            os.kill(bridge, signal.SIGKILL)


# --- the node in this process, so that its two threads can be led into a race ------------------------------------


@pytest.fixture
def node(start, tmp_path):
    """A configured node with a simulated chain, its executor, and a latched button; `rig` is the rig."""
    rig = start(bridge=False)
    values = {**rig.parameters, 'record': ''}
    context = rig.context
    node = BridgeNode(context=context, parameter_overrides=[Parameter(name, value=value)
                                                            for name, value in values.items()])
    node.rig, node.button = rig, Button(rig, 'latched')
    node.button.say(False)
    executor = PromptExecutor(context=context, services_wait=False)
    executor.add_node(node)

    def spin_until(condition, seconds=20.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, node._bridge.reason
            executor.spin_once(timeout_sec=0.01)
            rig.executor.spin_once(timeout_sec=0.0)
    node.spin_until = spin_until
    # a busy machine may keep the simulated servos from answering
    assert any(node.trigger_configure() is TransitionCallbackReturn.SUCCESS for _ in range(4))
    yield node
    node.release()
    executor.shutdown()
    node.destroy_node()


def pressing_when(node, name):
    """Have the button pressed in the middle of a method of the back end."""
    backend, was = node._bridge.backend, getattr(node._bridge.backend, name)

    def press():
        setattr(backend, name, was)
        node.button.say(True)
        node.rig.until(lambda: node.rig.node.count_subscribers('/estop') > 0)
        time.sleep(0.2)     # until it has arrived
        return was()
    setattr(backend, name, press)


@pytest.mark.parametrize('moment', ['observe', 'enable'])
def test_a_press_while_the_node_arms_leaves_torque_off(node, moment):
    pressing_when(node, moment)
    assert node.trigger_activate() is TransitionCallbackReturn.FAILURE
    assert not torque(node.rig) and node._bridge.state is State.DISARMED
    node.button.say(False)
    time.sleep(0.2)
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    assert torque(node.rig)


@pytest.mark.parametrize('moment', ['observe', 'enable'])
def test_a_press_while_the_node_resets_stops_it_before_it_moves(node, moment):
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    node.spin_until(lambda: node._bridge.state is State.READY)
    node._on_estop()
    node.spin_until(lambda: node._bridge.state is State.ESTOP)
    held = node._bridge.command.copy()
    node._loop.ask(lambda: pressing_when(node, moment))
    response = node._answer(node._on_reset, None, Trigger.Response())
    assert response.success is (moment == 'enable') and 'Traceback' not in response.message
    node.rig.send_legal()
    for _ in range(20):
        node.spin_until(lambda: True)
        time.sleep(0.01)
    assert node._bridge.state is State.ESTOP and not node._bridge.moving
    assert abs(node._bridge.command - held).max() < 0.01
    response = node._answer(node._on_reset, None, Trigger.Response())
    assert not response.success and 'still pressed' in response.message


@pytest.mark.parametrize('during', ['activation', 'reset'])
def test_a_goal_that_comes_while_nothing_is_to_move_is_not_played_when_it_may(node, during):
    """It waits in the middleware until the node has time to look at it, and then the bridge is ready."""
    rig, bridge = node.rig, node._bridge
    rig.until(lambda: rig.trajectories.get_subscription_count() > 0)
    if during == 'reset':
        assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
        node._on_estop()
        node.spin_until(lambda: bridge.state is State.ESTOP)
    was = bridge.backend.enable

    def enable():
        for _ in range(3):
            rig.send({'names': list(rig.chain.names), 'times': [0.5], 'velocities': None, 'stamp': 0.0,
                      'positions': (rig.chain.array('lower') + rig.chain.array('upper'))[None] / 2})
        time.sleep(0.3)         # until they have arrived
        was()
    bridge.backend.enable = enable
    if during == 'reset':
        assert node._answer(node._on_reset, None, Trigger.Response()).success
    else:
        assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    at = bridge.command.copy()
    end = time.monotonic() + 0.5
    node.spin_until(lambda: time.monotonic() > end)
    assert bridge.state is State.READY and np.array_equal(bridge.command, at)
    assert bridge.rejections == {'wrong state': 3}


@pytest.mark.parametrize('values', [['estop_required:=true', 'estop_topics:=[""]'], ['estop_topics:=[no topic]']])
def test_a_stop_that_cannot_be_heard_is_refused_at_the_start(values):
    words = [word for value in values for word in ('-p', value)]
    done = subprocess.run([sys.executable, '-m', 'style_servo.bridge_node', '--ros-args', *words],
                          stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2 and 'estop_topics' in done.stderr and 'Traceback' not in done.stderr


@pytest.mark.parametrize('seed', [0, 1])
def test_pressed_at_any_moment_of_any_life_nothing_arms_and_nothing_moves(node, seed):
    """Presses, releases, transitions, resets, goals and faults in any order, against what the button last said."""
    rng, rig, pressed = np.random.default_rng(seed), node.rig, False

    def say(value):
        nonlocal pressed
        pressed = value
        node.button.say(value)
        if node._bridge is None or rng.random() < 0.5:
            time.sleep(0.1)         # it has arrived, but the executor has not looked at it
        else:
            node.spin_until(lambda: bool(node._stop.reason(0.0)) == value)

    def activate():
        was_pressed = pressed
        if node.state == 'inactive':
            taken = node.trigger_activate()
            assert not (was_pressed and taken is TransitionCallbackReturn.SUCCESS)

    def deactivate():
        if node.state == 'active':
            assert node.trigger_deactivate() is TransitionCallbackReturn.SUCCESS
            assert not torque(rig)

    def restart():
        deactivate()
        if node.state == 'inactive':
            assert node.trigger_cleanup() is TransitionCallbackReturn.SUCCESS
        assert any(node.trigger_configure() is TransitionCallbackReturn.SUCCESS for _ in range(4))

    def reset():
        was_pressed = pressed
        answer = node._answer(node._on_reset, None, Trigger.Response())
        assert not (was_pressed and answer.success), answer.message

    def block():
        rig.tell('block', id=int(rng.integers(1, 7)), on=bool(rng.random() < 0.5))
    for _ in range(50):
        rng.choice([lambda: say(True), lambda: say(False), activate, activate, reset, deactivate, restart, block,
                    rig.send_legal, rig.send_legal, rig.send_legal])()
        end = time.monotonic() + float(rng.uniform(0.0, 0.1))
        node.spin_until(lambda: time.monotonic() > end)     # noqa: B023
        if pressed:
            node.spin_until(lambda: node._stop.reason(0.0))
            node.spin_until(lambda: node._loop is None or node._bridge.state in (State.ESTOP, State.FAULT), 1.0)
    rig.tell('block', on=False)


def test_a_node_that_no_longer_listens_stops(node):
    """The executor's thread hangs; a long trajectory would play to its end with nobody to hear an emergency stop."""
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    node.spin_until(lambda: node._bridge.state is State.READY)
    middle = (node.rig.chain.array('lower') + node.rig.chain.array('upper')) / 2
    bridge = node._bridge
    node._loop.ask(lambda: bridge.submit(Points(bridge.chain.names, np.array([60.0]), middle[None]),
                                         time.monotonic(), time.monotonic()))
    assert bridge.state in (State.RAMPING, State.STREAMING)
    end = time.monotonic() + 20
    while bridge.state is not State.ESTOP:      # nobody spins
        assert time.monotonic() < end
        time.sleep(0.05)
    assert 'heard nothing for 2 s' in bridge.reason
    node.spin_until(lambda: not node._pressed(time.monotonic()))
    assert bridge.state is State.ESTOP
    assert node._answer(node._on_reset, None, Trigger.Response()).success


def test_an_error_in_a_callback_or_a_cycle_is_counted_and_ends_nothing(node):
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
    node.spin_until(lambda: node._bridge.state is State.READY)
    node._reader.read = node._command_message.write = None       # not callable: in the one thread, and in the other
    listening = node.rig.node.create_subscription(JointState, '/servo_bridge/command', lambda message: None, 10)
    node.spin_until(lambda: node._mishaps > 50)
    before = node._mishaps
    node.rig.until(lambda: node.rig.trajectories.get_subscription_count() > 0)
    node.rig.send_legal()
    node.spin_until(lambda: node._mishaps > before and "'NoneType' object is not callable" in node._last_mishap)
    assert node._bridge.state is State.READY and torque(node.rig)
    response = node._answer(lambda: 1 / 0, None, Trigger.Response())
    assert not response.success and 'ZeroDivisionError' in response.message
    node._post(lambda: 1 / 0)
    node.spin_until(lambda: 'ZeroDivisionError' in node._last_mishap)
    assert node._loop.failure is None
    node.rig.node.destroy_subscription(listening)


def zombie(pid):
    """Whether a process has ended and only its entry is left."""
    try:
        with open(f'/proc/{pid}/stat') as file:
            return file.read().rpartition(')')[2].split()[0] == 'Z'
    except OSError:
        return True
