"""The bridge's states and every way between them. Code, documentation and the coverage report read this one table."""
import enum

__all__ = ['State', 'Event', 'EDGES', 'StateMachine', 'mermaid']


class State(enum.IntEnum):
    """What the bridge is doing; the numbers are those of style_msgs/BridgeState."""

    DISARMED = 0
    READY = 1
    RAMPING = 2
    STREAMING = 3
    HOLDING = 4
    RELAXED = 5
    ESTOP = 6
    FAULT = 7

    @property
    def armed(self):
        """Whether the bridge talks to the motors in this state."""
        return self is not State.DISARMED


class Event(enum.Enum):
    """What can happen; the value is its meaning for people."""

    ARM = 'the node is activated: torque on at the measured posture'
    TRAJECTORY = 'a trajectory is accepted'
    RAMPED = 'the ramp from the held posture has ended'
    FINISHED = 'the trajectory has ended at rest'
    STALE = 'no trajectory for the input time-out, or the last one ended while moving'
    REFUSED = 'the limiter rejects the targets (discontinuity, not finite), or a joint lags too far for too long'
    TIRED = 'held for the hold time-out, and the policy is to relax'
    GIVE_UP = 'held for the hold time-out, and the policy is a fault'
    ESTOP = 'emergency stop'
    FAULT = 'back end fault or following error'
    RESET = 'reset is called and the motors answer without errors'
    DISARM = 'the node is deactivated: brake, then torque off'


_S, _E = State, Event

#: (state, event) -> next state. An event without an entry changes nothing.
EDGES = {
    (_S.DISARMED, _E.ARM): _S.READY,
    (_S.READY, _E.TRAJECTORY): _S.RAMPING,
    (_S.RAMPING, _E.RAMPED): _S.STREAMING,
    (_S.RAMPING, _E.STALE): _S.HOLDING,
    (_S.RAMPING, _E.REFUSED): _S.HOLDING,
    (_S.STREAMING, _E.FINISHED): _S.READY,
    (_S.STREAMING, _E.STALE): _S.HOLDING,
    (_S.STREAMING, _E.REFUSED): _S.HOLDING,
    (_S.HOLDING, _E.TRAJECTORY): _S.RAMPING,
    (_S.HOLDING, _E.TIRED): _S.RELAXED,
    (_S.HOLDING, _E.GIVE_UP): _S.FAULT,
    (_S.RELAXED, _E.RESET): _S.READY,
    (_S.HOLDING, _E.RESET): _S.READY,
    (_S.ESTOP, _E.RESET): _S.READY,
    (_S.FAULT, _E.RESET): _S.READY,
    **{(state, _E.ESTOP): _S.ESTOP for state in (_S.READY, _S.RAMPING, _S.STREAMING, _S.HOLDING, _S.RELAXED)},
    **{(state, _E.FAULT): _S.FAULT for state in (_S.READY, _S.RAMPING, _S.STREAMING, _S.HOLDING, _S.RELAXED,
                                                 _S.ESTOP)},
    **{(state, _E.DISARM): _S.DISARMED for state in _S if state is not _S.DISARMED},
}


class StateMachine:
    """The current state, and which edges were ever taken.

    Attributes
    ----------
    state : State
    taken : dict
        (state, event) -> count.
    """

    def __init__(self):
        self.state = State.DISARMED
        self.taken = {}

    def allows(self, event):
        """Whether an event leads anywhere from here."""
        return (self.state, event) in EDGES

    def happen(self, event):
        """Take the edge of an event; returns whether there is one."""
        key = self.state, event
        if key not in EDGES:
            return False
        self.taken[key] = self.taken.get(key, 0) + 1
        self.state = EDGES[key]
        return True


def mermaid():
    """The state diagram for the documentation."""
    groups = {}
    for (state, event), target in EDGES.items():
        groups.setdefault((state, target), []).append(event.name.lower())
    lines = ['stateDiagram-v2', '    [*] --> DISARMED']
    lines += [f'    {state.name} --> {target.name}: {", ".join(events)}' for (state, target), events in groups.items()]
    return '\n'.join(lines)
