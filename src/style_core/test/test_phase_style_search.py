"""The search's states: every edge of the table is taken by a predictor that sees what calls for it."""
import numpy as np
import pytest
from test_phase_style_full import made_person, walk  # noqa: F401 (fixture)

from style_core.phase_style import FullPredictor
from style_core.phase_style.search_states import EDGES, Course, Event, State, mermaid
from style_core.predictor import Status

S, E = State, Event


class Story:
    """A predictor that is shown one thing after another at 60 Hz."""

    def __init__(self, behaviours):
        self.predictor, self.time, self.frame = FullPredictor(behaviours), 0.0, 0
        self.rng = np.random.default_rng(2)
        self.y = made_person('n_1', 5.6, 0.5, 31, seconds=8)[0].y
        self.nothing = np.full(6, np.nan)

    @property
    def course(self):
        return self.predictor._search.course

    def see(self, row=None, steps=1, until=None, dt=1 / 60):
        """So many observations, or until a state is reached: a row, random ones, or by default what the person does."""
        for _ in range(90 if until else steps):
            self.time += dt
            self.frame += 1
            shown = self.y[self.frame] if row is None else row() if callable(row) else row
            self.estimate = self.predictor.update(self.time, shown)
            assert self.estimate.status is self.course.state.status
            if self.course.state is until:
                return self
        assert until is None, f'{self.course.state} in place of {until}'
        return self

    def garbage(self):
        return 3 * self.rng.standard_normal(6)

    def elsewhere(self):
        """Another place of the motion: the leader takes nothing of it in."""
        return self.y[self.frame - 20]

    def leaning(self):
        """All joints off by so little that the leader takes them in."""
        return self.y[self.frame] + 0.1

    def leaning_elsewhere(self):
        return self.elsewhere() + 0.1

    def tracking(self):
        return self.see(until=S.TRACKING).see(steps=60)

    def lost(self):
        return self.tracking().see(self.leaning, until=S.LOST)

    def holding(self):
        return self.tracking().see(self.elsewhere, until=S.HOLDING)

    def kept(self):
        return self.holding().see(self.elsewhere, until=S.KEPT)

    def settled(self):
        return self.kept().see(self.elsewhere, until=S.SETTLED)


#: How a state is reached and what is shown then, for every edge.
STORIES = {
    (S.ACQUIRING, E.DECIDED): lambda story: story.tracking(),
    (S.ACQUIRING, E.ANEW): lambda story: story.see(story.garbage, steps=8),
    (S.ACQUIRING, E.RESET): lambda story: story.see(steps=2).see(dt=3.0),
    (S.TRACKING, E.LOST): lambda story: story.lost(),
    (S.TRACKING, E.REFUSED): lambda story: story.holding(),
    (S.TRACKING, E.RESET): lambda story: story.tracking().see(dt=3.0),
    (S.LOST, E.DECIDED): lambda story: story.lost().see(story.leaning, until=S.TRACKING),
    (S.LOST, E.ANEW): lambda story: story.lost().see(story.garbage, steps=12),
    (S.LOST, E.RESET): lambda story: story.lost().see(dt=3.0),
    (S.HOLDING, E.EXPECTED): lambda story: story.holding().see(until=S.TRACKING),
    (S.HOLDING, E.HELD): lambda story: story.kept(),
    (S.HOLDING, E.EXPIRED): lambda story: story.holding().see(story.elsewhere, dt=0.5),
    (S.HOLDING, E.DECIDED): lambda story: story.holding().see(story.elsewhere, steps=2).see(story.nothing, steps=60),
    (S.HOLDING, E.ANEW): lambda story: story.holding().see(story.garbage, steps=2),
    (S.HOLDING, E.RESET): lambda story: story.holding().see(dt=3.0),
    (S.KEPT, E.EXPECTED): lambda story: story.kept().see(until=S.TRACKING),
    (S.KEPT, E.EXPIRED): lambda story: story.kept().see(story.garbage, steps=20),
    (S.KEPT, E.DECIDED): lambda story: story.settled(),
    (S.KEPT, E.ANEW): lambda story: story.kept().see(story.garbage, steps=10),
    (S.KEPT, E.RESET): lambda story: story.kept().see(dt=3.0),
    (S.SETTLED, E.EXPIRED): lambda story: story.settled().see(story.elsewhere, until=S.TRACKING),
    (S.SETTLED, E.LOST): lambda story: story.settled().see(story.leaning_elsewhere, steps=6),
    (S.SETTLED, E.REFUSED): lambda story: story.settled().see(story.garbage, steps=2),
    (S.SETTLED, E.RESET): lambda story: story.settled().see(dt=3.0),
}


@pytest.mark.parametrize('edge', EDGES, ids=lambda edge: f'{edge[0].name}-{edge[1].name}')
def test_every_edge_is_taken(walk, edge):  # noqa: F811
    story = Story([walk])
    STORIES[edge](story)
    assert edge in story.course.taken


def test_an_event_without_an_edge_changes_nothing():
    for state in State:
        for event in Event:
            course = Course()
            course.state = state
            assert course.happen(event) == ((state, event) in EDGES)
            assert course.state is EDGES.get((state, event), state)
            assert len(course.taken) == ((state, event) in EDGES)


def test_states_say_what_an_estimate_says():
    assert {state for state in State if state.status is Status.TRACKING} == {S.TRACKING, S.SETTLED}
    assert [state.status for state in State if state.searching] == [Status.ACQUIRING] + 3 * [Status.LOST]
    assert {state for state in State if state.keeps} == {S.HOLDING, S.KEPT, S.SETTLED}


def test_the_diagram_shows_every_state():
    assert all(state.name in mermaid() for state in State)
