"""Every state and every fault of the bridge over real middleware."""
import itertools
import os
import signal
import tempfile

import pytest
from lifecycle_msgs.msg import Transition
from servo_rig import ServoRig
from std_msgs.msg import Bool

from style_servo.control_table import control_table, model_named
from style_servo.record import read_record
from style_servo.recorder import runs_of
from style_servo.states import State

# to the latched states, and out of them only by a reset or a deactivation; READY may last for less than a cycle
# where trajectories stream in
LATCHED = {State.ESTOP, State.FAULT}
WAYS_OUT = {State.READY, State.RAMPING, State.DISARMED, State.FAULT}


@pytest.fixture
def start(tmp_path):
    """Start a rig with bridge parameters, configured and active; in the end, no latched state was left by itself."""
    rigs = []

    def begin(up=True, **parameters):
        rig = ServoRig(tempfile.mkdtemp(dir=tmp_path), **parameters)
        rigs.append(rig)
        return rig.up() if up else rig
    yield begin
    for rig in rigs:
        rig.close()
        for run in runs_of(rig.record):
            states = read_record(rig.record, run).state
            left = {(State(a), State(b)) for a, b in itertools.pairwise(states) if a != b and State(a) in LATCHED}
            assert all(after in WAYS_OUT for _, after in left), left


def fault(rig, *words, **how):
    """Something happens to the bus while the bridge streams: a fault whose reason says what."""
    rig.stream_until(State.STREAMING)
    rig.tell(**how)
    rig.until(lambda: rig.state is State.FAULT, 20, rig.send_legal)
    for word in words:
        assert word in rig.reason, rig.reason


def recover(rig):
    """An explicit reset, and it streams again."""
    rig.until(lambda: rig.trigger('reset').success, 20)
    rig.stream_until(State.STREAMING)


def test_faults_of_single_servos_and_their_reset(start):
    rig = start(reboot_servos=True)
    fault(rig, 'left_hip (ID 1', 'hardware error: overload', do='fail', id=1, kind='overload')
    rig.stream(0.3)
    assert rig.state is State.FAULT         # latched, whatever is sent
    rig.until(lambda: rig.diagnostics[-1].status[0].level == b'\x02')
    assert 'ros2 service call /servo_bridge/reset std_srvs/srv/Trigger' in rig.log()     # the warning says what to do
    recover(rig)
    fault(rig, 'left_knee (ID 2', 'overheating', do='heat', id=2, celsius=95)
    rig.tell('heat', id=2, celsius=30)
    recover(rig)
    fault(rig, 'right_ankle (ID 6', 'no longer answers', do='silent', id=6)
    answer = rig.trigger('reset')
    assert not answer.success and 'no answer, while others do' in answer.message
    rig.tell('silent', id=6, on=False)
    recover(rig)
    fault(rig, 'left_ankle', 'does not follow', do='block', id=3)
    # it presses no longer: the servo's goal is where the joint is blocked
    unit = control_table(model_named('XM430-W350')).position_unit

    def pressing():
        servo, = rig.tell('state', id=3)['servos']
        assert servo['torque']
        return abs(servo['goal'] * unit - servo['position'])
    rig.until(lambda: pressing() < unit)
    rig.tell('block', id=3, on=False)
    recover(rig)


def test_a_rebooting_servo(start):
    fault(start(error_run=1000), 'right_hip (ID 4', 'rebooted', do='reboot', id=4)


def test_the_adapter_is_unplugged_and_plugged_in_again(start):
    rig = start()
    fault(rig, 'is gone', 'unplugged', do='unplug')
    assert not rig.trigger('reset').success
    rig.tell('plug')
    recover(rig)


def test_lost_packets_are_counted_and_a_run_of_them_is_a_fault(start):
    rig = start()
    rig.tell('drop', id=5, count=3)
    rig.stream_until(State.STREAMING)
    rig.until(lambda: rig.states[-1].bus_errors >= 3, 20, rig.send_legal)
    assert rig.state is State.STREAMING
    fault(rig, 'cycles in a row', do='corrupt', count=-1)
    rig.tell('clear')
    recover(rig)


@pytest.mark.parametrize('policy', ['relax', 'fault'])
def test_the_hold_policies(start, policy):
    rig = start(hold_policy=policy, input_timeout=1.0, hold_timeout=2.0, fault_action='torque_off')
    rig.stream_until(State.STREAMING)
    rig.wait_for(State.RELAXED if policy == 'relax' else State.FAULT)
    assert not any(servo['torque'] for servo in rig.tell('state')['servos'])
    if policy == 'relax':
        rig.estop.publish(Bool(data=True))
        rig.wait_for(State.ESTOP)
        rig.estop.publish(Bool(data=False))
        rig.until(lambda: not rig.states[-1].estop_held)
    recover(rig)
    rig.wait_for(State.HOLDING)
    assert rig.trigger('reset').success
    rig.wait_for(State.READY)


def test_emergency_stops_in_every_state_and_a_fault_after_one(start):
    rig = start(estop_action='torque_off', ramp_time=3.0, reboot_servos=True)
    for reach in (lambda: rig.wait_for(State.READY), lambda: rig.stream_until(State.RAMPING),
                  lambda: (rig.stream_until(State.RAMPING), rig.wait_for(State.HOLDING))):
        reach()
        assert rig.trigger('estop').success
        rig.wait_for(State.ESTOP)
        assert not any(servo['torque'] for servo in rig.tell('state')['servos'])
        rig.until(lambda: rig.trigger('reset').success)
    rig.trigger('estop')
    rig.wait_for(State.ESTOP)
    rig.tell('fail', id=1, kind='shock')
    rig.wait_for(State.FAULT)
    assert 'electrical shock' in rig.reason
    recover(rig)


def test_deactivating_brakes_and_releases_from_every_state(start):
    rig = start()
    for reach in (lambda: None, lambda: rig.stream_until(State.STREAMING),
                  lambda: (rig.stream_until(State.STREAMING), rig.wait_for(State.HOLDING)),
                  lambda: rig.trigger('estop')):
        reach()
        assert rig.change(Transition.TRANSITION_DEACTIVATE)
        assert not any(servo['torque'] for servo in rig.tell('state')['servos'])
        if rig.states[-1].estop_held:       # a stop outlives that
            assert not rig.change(Transition.TRANSITION_ACTIVATE)
            assert rig.trigger('reset').success
        assert rig.change(Transition.TRANSITION_ACTIVATE)
        rig.wait_for(State.READY)
    assert rig.change(Transition.TRANSITION_DEACTIVATE)
    assert rig.change(Transition.TRANSITION_CLEANUP)
    rig.up()


def test_faults_stops_and_resets_from_the_other_states(start):
    """Edges of the state table that no test above takes."""
    rig = start(hold_policy='relax', input_timeout=0.4, hold_timeout=1.5, ramp_time=1.5, error_run=30)

    def silence():
        rig.tell('silent', id=6)
        rig.until(lambda: rig.state is State.FAULT, 20, rig.send_legal if rig.state is State.RAMPING else None)
        rig.tell('silent', id=6, on=False)

    def restart():
        assert rig.change(Transition.TRANSITION_DEACTIVATE)
        rig.wait_for(State.DISARMED)
        assert rig.change(Transition.TRANSITION_ACTIVATE)
        rig.wait_for(State.READY)

    def relax():
        rig.stream_until(State.STREAMING)
        rig.wait_for(State.RELAXED)
    silence()                               # from READY
    restart()                               # from FAULT
    rig.stream_until(State.RAMPING)
    restart()                               # from RAMPING
    rig.stream_until(State.RAMPING)
    silence()                               # from RAMPING
    rig.until(lambda: rig.trigger('reset').success)
    relax()
    assert rig.trigger('reset').success     # from RELAXED
    rig.wait_for(State.READY)
    relax()
    restart()                               # from RELAXED
    relax()
    silence()                               # from RELAXED
    rig.until(lambda: rig.trigger('reset').success)
    rig.stream_until(State.STREAMING)
    rig.wait_for(State.HOLDING)
    rig.stream_until(State.RAMPING)         # from HOLDING
    rig.stream_until(State.STREAMING)
    rig.estop.publish(Bool(data=True))      # from STREAMING
    rig.wait_for(State.ESTOP)
    rig.estop.publish(Bool(data=False))
    rig.until(lambda: not rig.states[-1].estop_held)
    assert rig.trigger('reset').success


def test_a_finished_trajectory_leaves_it_ready(start):
    rig = start(ramp_time=0.1)
    target = (rig.chain.array('lower') + rig.chain.array('upper')) / 2
    rig.send({'names': list(rig.chain.names), 'times': [2.0], 'positions': target[None], 'velocities': None,
              'stamp': 0})
    rig.wait_for(State.STREAMING)
    rig.wait_for(State.READY)
    rig.spin(0.3)
    assert max(abs(a - b) for a, b in zip(rig.states[-1].commanded, target)) < 1e-6
    assert max(abs(a - b) for a, b in zip(rig.joint_states[-1].position, target)) < 0.02


@pytest.mark.parametrize('parameters, words', [
    ({'chain': 'nowhere.yaml'}, 'does not exist, neither in'), ({'port': '/dev/nothing'}, 'no such device'),
    ({'baud': 57600}, 'no servo answers'), ({'chain': ''}, 'the parameter chain is empty'),
    ({'chain': os.path.join(os.path.dirname(__file__), '..', 'config', 'servo', 'humanoid20.yaml')},
     'is a XM540-W270')])
def test_configuring_with_something_wrong_fails_with_the_reason(start, parameters, words):
    rig = start(up=False)
    rig.bridge.send_signal(signal.SIGINT)
    rig.bridge.wait(20)
    rig.bridge = rig.start_bridge(**parameters)
    assert not rig.change(Transition.TRANSITION_CONFIGURE)
    rig.until(lambda: words in rig.log())


def test_parameters_out_of_range_and_changes_while_configured_are_refused(start):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    rig = start()
    request = SetParameters.Request(parameters=[Parameter('rate', value=100.0).to_parameter_msg()])
    result = rig.call(SetParameters, '/servo_bridge/set_parameters', request).results[0]
    assert not result.successful and 'cannot change while the node is configured' in result.reason
    child = rig.start_bridge(rate=-5.0)
    assert child.wait(20) == 2
    assert 'rate' in rig.log()
