"""The search's states and every way between them. Code, documentation and the test of every edge read this table."""
import enum

from style_core.predictor import Status

__all__ = ['State', 'Event', 'EDGES', 'Course', 'mermaid']


class State(enum.Enum):
    """What the search is doing; the value is its meaning for people."""

    ACQUIRING = 'hypotheses are compared; nothing was followed before'
    TRACKING = 'one hypothesis is followed'
    LOST = 'hypotheses are compared, the one that was followed among them'
    HOLDING = 'the same, while the one that refused what called the loss is kept as it was and speaks'
    KEPT = 'the same, but the one that is kept no longer speaks'
    SETTLED = 'one hypothesis is followed, while one is still kept for the next loss'

    @property
    def searching(self):
        """Whether hypotheses are compared."""
        return self not in (State.TRACKING, State.SETTLED)

    @property
    def keeps(self):
        """Whether a hypothesis is kept as it was."""
        return self in (State.HOLDING, State.KEPT, State.SETTLED)

    @property
    def status(self):
        """What an estimate says of it."""
        if self is State.ACQUIRING:
            return Status.ACQUIRING
        return Status.LOST if self.searching else Status.TRACKING


class Event(enum.Enum):
    """What can happen; the value is its meaning for people."""

    LOST = 'the leader took in what it does not explain, or its phase is at its slowest'
    REFUSED = 'the same, but the leader took nothing of it in'
    EXPECTED = 'what is seen is as the one that is kept expects'
    DECIDED = 'the leader explains what it sees, and leads clearly or for long enough'
    ANEW = 'every hypothesis is far off: what came before is from elsewhere'
    HELD = 'the hold time is over'
    EXPIRED = 'one was kept for long enough'
    RESET = 'a reset, a silence, or values that no body can have'


_S, _E = State, Event

#: (state, event) -> next state. An event without an entry changes nothing.
EDGES = {
    (_S.ACQUIRING, _E.DECIDED): _S.TRACKING,
    (_S.TRACKING, _E.LOST): _S.LOST,
    (_S.TRACKING, _E.REFUSED): _S.HOLDING,
    (_S.LOST, _E.DECIDED): _S.TRACKING,
    (_S.HOLDING, _E.EXPECTED): _S.TRACKING,
    (_S.HOLDING, _E.HELD): _S.KEPT,
    (_S.HOLDING, _E.EXPIRED): _S.LOST,
    (_S.HOLDING, _E.DECIDED): _S.SETTLED,
    (_S.KEPT, _E.EXPECTED): _S.TRACKING,
    (_S.KEPT, _E.EXPIRED): _S.LOST,
    (_S.KEPT, _E.DECIDED): _S.SETTLED,
    (_S.SETTLED, _E.EXPIRED): _S.TRACKING,
    (_S.SETTLED, _E.LOST): _S.KEPT,
    (_S.SETTLED, _E.REFUSED): _S.KEPT,
    **{(state, _E.ANEW): state for state in (_S.ACQUIRING, _S.LOST, _S.HOLDING, _S.KEPT)},
    **{(state, _E.RESET): _S.ACQUIRING for state in _S},
}


class Course:
    """The current state, and which edges were ever taken.

    Attributes
    ----------
    state : State
    taken : dict
        (state, event) -> count.
    """

    def __init__(self):
        self.state = State.ACQUIRING
        self.taken = {}

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
        if event is not Event.RESET:
            groups.setdefault((state, target), []).append(event.name.lower())
    lines = ['stateDiagram-v2', '    [*] --> ACQUIRING: reset']
    lines += [f'    {state.name} --> {target.name}: {", ".join(events)}' for (state, target), events in groups.items()]
    return '\n'.join(lines)
