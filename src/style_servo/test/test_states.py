"""The state table: what it shows, and every edge of it taken by the bridge."""
import numpy as np
import pytest
from bridge_rig import RATE, Rig

from style_servo.backend import BackendFault
from style_servo.states import EDGES, Event, State, mermaid

QUICK = {'input_timeout': 0.1, 'hold_timeout': 0.1}


def faulty(rig):
    rig.motors.fault = BackendFault('gone')
    rig.run(2 / RATE)
    rig.motors.fault = None


def estop(rig):
    rig.bridge.estop(rig.now)


def goal(rig):
    rig.send([0.01], [rig.bridge.command])
    rig.run(1.0)


def jump(rig):
    """A trajectory in which a joint jumps."""
    now = rig.bridge.command
    rig.bridge._playback.hold(now)
    rig.send([0.0, 0.1, 0.101, 0.6], np.array([now, now, now + [0.9, 0.0], now + [0.9, 0.0]]))
    rig.run(0.4)


def reach(state, event):
    """A rig in a state; its parameters are such that the event can happen."""
    policy = {Event.TIRED: 'relax', Event.GIVE_UP: 'fault'}.get(event, 'hold')
    # a ramp so long that nothing else comes to its end before, or short where it is to end
    ramp = {'ramp_time': 0.05 if event is Event.RAMPED else 5.0} if state is State.RAMPING else {}
    rig = Rig(armed=state is not State.DISARMED, hold_policy='relax' if state is State.RELAXED else policy,
              **QUICK, **ramp)
    if state in (State.STREAMING, State.HOLDING, State.RELAXED):
        rig.stream(2.0)
    {State.DISARMED: rig.motors.connect, State.RAMPING: lambda: rig.stream(0.1), State.HOLDING: lambda: rig.run(0.15),
     State.RELAXED: lambda: rig.run(0.5), State.ESTOP: lambda: estop(rig), State.FAULT: lambda: faulty(rig)
     }.get(state, lambda: None)()
    assert rig.bridge.state is state
    return rig


CAUSES = {
    Event.ARM: lambda rig: rig.bridge.arm(rig.now), Event.TRAJECTORY: Rig.wave,
    Event.RAMPED: lambda rig: rig.stream(3.0), Event.FINISHED: goal, Event.STALE: lambda rig: rig.run(0.7),
    Event.REFUSED: jump, Event.TIRED: lambda rig: rig.run(0.3), Event.GIVE_UP: lambda rig: rig.run(0.3),
    Event.ESTOP: estop, Event.FAULT: faulty, Event.RESET: lambda rig: (rig.run(0.5), rig.bridge.reset(rig.now)),
    Event.DISARM: lambda rig: rig.bridge.disarm(rig.now)}


@pytest.mark.parametrize(('state', 'event'), EDGES, ids=lambda one: one.name)
def test_every_edge_is_taken(state, event):
    rig = reach(state, event)
    before = dict(rig.bridge.machine.taken)
    CAUSES[event](rig)
    taken = [edge for edge, count in rig.bridge.machine.taken.items() if count > before.get(edge, 0)]
    assert (state, event) in taken
    if rig.motors.sent:
        rig.stays_within_limits()


def test_the_state_diagram_shows_every_edge():
    text = mermaid()
    assert all(event.name.lower() in text for event in Event)
    assert all(f'{state.name} --> {target.name}' in text for (state, _), target in EDGES.items())
    reachable = {State.DISARMED}
    for _ in State:
        reachable |= {target for (state, _), target in EDGES.items() if state in reachable}
    assert reachable == set(State)
