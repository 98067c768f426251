"""Search over behaviour, phase and speed: hypotheses ranked at a glance, run side by side, judged by likelihood.

The states of a search and the ways between them are in search_states.py, its settings in settings.py.
"""
import numpy as np

from libc.math cimport INFINITY, M_PI, exp, fabs, floor

from style_core.phase_style.arrow_state cimport Filter
from style_core.phase_style.candidates cimport Candidates
from style_core.phase_style.hypothesis cimport Hypothesis
from style_core.phase_style.recent_samples cimport RecentSamples
from style_core.phase_style.search_states import Course, Event, State
from style_core.phase_style.settings import (
    ANEW,
    BUDGET,
    ELSEWHERE,
    EXPLAINS,
    FEW,
    FEWEST_JUDGED,
    GIVE_UP,
    HOLD_S,
    KEPT_S,
    LIMIT,
    LIVE,
    PATIENCE,
    REPLAY,
    SEARCH_S,
    SHORTEST_S,
    SHORTEST_SAMPLES,
    START_COST,
    TAKE_OVER,
    WINDOW,
)

__all__ = ['ANEW', 'BUDGET', 'EXPLAINS', 'FEW', 'GIVE_UP', 'LIMIT', 'LIVE', 'PATIENCE', 'REPLAY', 'SEARCH_S',
           'START_COST', 'TAKE_OVER', 'WINDOW', 'Search']


cdef class Search:
    """Hypotheses beside the one that leads.

    Samples are kept for a short while, so that a hypothesis can start in the past and catch up. Hypotheses are ranked
    at a quick glance, the best of them run, and the likelihood of what was seen decides who leads. The work is
    spread over the samples: updates, glances and starts share one budget. A leader that refused what called the
    search is kept for a while: it may be that which was wrong.

    Parameters
    ----------
    behaviours : list of Behaviour
    glances : list of Glance
    pool : list of list of ArrowFilter
        Of each behaviour, ``LIVE + 2`` filters: of all that run, of a leader that is kept, and of a new one.
    single : bool
        Start from the best hypothesis alone (for ablation).
    rejects : bool
        Leave out joints that contradict all others (False for ablation).

    Attributes
    ----------
    course : Course
        The state, and the edges taken.
    status : style_core.predictor.Status
        What an estimate says of the state.
    searching : bool
        Whether hypotheses are compared.
    leader : Hypothesis or None
        None until something was observed.
    speaker : Hypothesis or None
        Where estimates and predictions come from: the leader, or one that is kept.
    holding : bool
        A leader that is kept speaks, as what was seen last may be wrong.
    hypotheses : list of Hypothesis
        All that run, the leader included.
    since : float
        Duration of this search, s.
    """

    cdef readonly object course, status
    cdef readonly bint searching, holding
    cdef readonly list hypotheses
    cdef readonly Hypothesis leader
    cdef readonly double since
    cdef Hypothesis _kept       # a leader that did not take in what called this search, as it was
    cdef int _anew              # times in a row that the search began anew
    cdef RecentSamples _samples
    cdef Candidates _candidates
    cdef list _pool, _free
    cdef bint _single, _rejects
    # of each behaviour: spread of the speed, variances of phase and speed at a start, samples that the size of what it
    # promises is known from, distance of the phases tried, and whether it is rhythmic
    cdef double[::1] _spread, _phase_variance, _speed_variance, _tail, _width
    cdef unsigned char[::1] _rhythmic
    cdef dict _gaits            # of each name: its behaviours
    cdef double[::1] _weights   # of each behaviour; scratch

    def __init__(self, behaviours, glances, pool, bint single=False, bint rejects=True):
        self._pool, self._single, self._rejects = pool, single, rejects
        self._samples = RecentSamples(len(behaviours[0].joint_names))
        self._candidates = Candidates(behaviours, glances)
        self._spread = np.array([behaviour.velocity[1] for behaviour in behaviours], dtype=float)
        self._phase_variance = np.array([glance.width ** 2 for glance in glances])
        self._speed_variance = np.array([max(one, 1e-3) ** 2 * (0.5 if len(glance.speeds) > 1 else 1.0)
                                         for glance, one in zip(glances, self._spread)])
        self._tail = np.array([behaviour.residual.check_weight for behaviour in behaviours], dtype=float)
        self._width = np.array([glance.width if len(glance.phases) > 1 else INFINITY for glance in glances])
        self._rhythmic = np.array([behaviour.rhythmic for behaviour in behaviours], dtype=np.uint8)
        self._gaits, self._weights = {}, np.empty(len(behaviours))
        for index, behaviour in enumerate(behaviours):
            self._gaits.setdefault(behaviour.name, []).append(index)
        self.course = Course()
        self.reset()

    # ---- states

    cdef _happen(self, event):
        """Take the edge of an event; what the states mean for the hot path is kept beside them."""
        self.course.happen(event)
        state = self.course.state
        self.status, self.searching, self.holding = state.status, state.searching, state is State.HOLDING
        if self._kept is not None and not state.keeps:
            self._free[self._kept.behaviour].append(self._kept.filter)
            self._kept = None

    def reset(self):
        """Forget all hypotheses and samples."""
        self.hypotheses = []
        self.leader = self._kept = None
        self._free = [list(filters) for filters in self._pool]
        self._samples.reset()
        self._candidates.reset()
        self._anew = 0
        self.since = 0.0
        self._happen(Event.RESET)

    def lose(self):
        """The leader no longer explains what is seen: search, with the leader as one of the hypotheses."""
        refused = self._rejects and not self.leader.filter.seen
        if refused and self._kept is None:
            self._keep()
        self._happen(Event.REFUSED if refused else Event.LOST)
        self._begin()

    cdef _keep(self):
        """The leader stays as it is; a copy takes its place."""
        cdef Hypothesis old = self.leader
        cdef Filter one = self._free[old.behaviour].pop()
        one.copy(old.filter)
        self.leader = Hypothesis(old.behaviour, one, self._samples.count, old.tail, old.prior)
        self.leader.time = old.time
        self.hypotheses[self.hypotheses.index(old)] = self.leader
        self._kept = old
        old.next = self._samples.count

    cdef _begin(self):
        """Search from the last sample on.

        Samples from before say nothing about what is seen now, be it another person or another place. The last one
        counts for all: a leader that was surprised by it and has made room for it since would else look better than
        hypotheses which start from it.
        """
        self._samples.forget()
        self._candidates.forget()
        self.since = 0.0
        self.leader.judge_anew()
        self.leader.judge()
        if self._rejects:
            self.leader.filter.gate(LIMIT, FEW, EXPLAINS)

    cdef _end(self, event):
        """The leader is followed alone."""
        self._drop_others()
        if self._rejects:
            self.leader.filter.gate(LIMIT, FEW, EXPLAINS, True)
        self._happen(event)

    @property
    def speaker(self):
        return self._kept if self.holding else self.leader

    # ---- samples

    def store(self, double time, const double[::1] y, const unsigned char[::1] seen):
        """Keep an observation as a sample if it is one (see `RecentSamples.add`); returns whether it is."""
        cdef double age, hold = HOLD_S
        cdef bint sampled = self._samples.add(time, y, seen)
        if sampled and self._kept is not None:
            age = self._samples.last - self._kept.time
            if age > KEPT_S:
                self._happen(Event.EXPIRED)
            elif self.holding and not age < hold + 1e-3:
                self._happen(Event.HELD)
        return sampled

    def window(self):
        """Samples of this search that a glance looks at, oldest first: observations, and what of them counts."""
        stop = self._samples.row(self._samples.count)
        rows = slice(stop - self._candidates.reach(self._samples), stop)
        return self._samples.y[rows], self._samples.observed[rows]

    # ---- work on one sample

    def step(self, double budget):
        """Glance at a hypothesis, start the best, and let those that run catch up.

        ``budget`` is what this may cost, in filter updates. While a place is free a glance comes first; while all are
        taken, it gets what the updates leave.
        """
        cdef Hypothesis one
        cdef int live = 1 if self._single and self.leader is None else LIVE
        for one in list(self.hypotheses):
            if one is not self.leader and self._samples.count - one.next > WINDOW:
                self._drop(one)  # newer ones were served first, and its samples are gone
        if len(self.hypotheses) < live:
            budget = self._candidates.look(self._samples, budget)
            budget = self._start_candidates(live, budget)
            self._catch_up(budget)
        else:
            budget = self._catch_up(budget)
            self._candidates.look(self._samples, budget)

    cdef double _catch_up(self, double budget) except? -1:
        """Update hypotheses with samples they have not seen; returns the budget left."""
        cdef Hypothesis one, best
        cdef long row
        cdef RecentSamples samples = self._samples
        while budget >= 1:
            # those that are nearly up to date first: one that never catches up is of no use
            best = None
            for one in self.hypotheses:
                if one is not self.leader and one.next < samples.count and (best is None or one.next > best.next):
                    best = one
            if best is None:
                break
            row = samples.row(best.next)
            best.update(samples.time[row], samples.values[row], samples.flags[row])
            best.judge()
            best.next += 1
            budget -= 1
        return budget

    cdef double _start_candidates(self, int live, double budget) except? -1:
        """Start the best that was seen at a glance and is not running yet; returns the budget left."""
        cdef RecentSamples samples = self._samples
        cdef Candidates found = self._candidates
        cdef double at, speed, start = START_COST
        cdef int slot, peak, index
        cdef long first
        cdef Filter one
        found.taken[:] = 0
        while len(self.hypotheses) < live and budget >= start + 1:  # an update must be left
            slot = found.next(samples.last)
            if slot < 0:
                break
            peak, index, speed = found.taken[slot], found.behaviour[slot], found.speed[slot]
            found.taken[slot] += 1
            at = found.phase[slot, peak] + speed * (samples.last - found.stamps[slot])
            if self._runs(index, at, speed) or not self._free[index]:
                continue
            one = self._free[index].pop()
            if self._rejects:
                one.gate(LIMIT, FEW, EXPLAINS)
            first = max(samples.count - REPLAY, samples.first)
            one.start(at - speed * (samples.last - samples.time[samples.row(first)]), speed,
                      self._phase_variance[index], self._speed_variance[index])
            self.hypotheses.append(Hypothesis(index, one, first, self._tail[index], found.prior[slot]))
            budget -= start
        return budget

    cdef bint _runs(self, int index, double phase, double speed):
        cdef Hypothesis one
        for one in self.hypotheses:
            if self._near(one, index, phase, speed):
                return True
        return False

    cdef bint _near(self, Hypothesis one, int index, double phase, double speed):
        """Does a running hypothesis already stand for this behaviour, phase and speed?"""
        cdef double difference
        if one.behaviour != index:
            return False
        difference = one.filter.c[0] - phase
        if self._rhythmic[index]:
            difference -= 2 * M_PI * floor((difference + M_PI) / (2 * M_PI))
        return self._width[index] == INFINITY or (
            fabs(difference) < 2 * self._width[index]
            and fabs(one.filter.c[1] - speed) < self._spread[index])

    # ---- decision

    def decide(self, double dt):
        """Choose the leader and give up what is far behind, ``dt`` seconds after the last time; True if that ends the
        search."""
        cdef Hypothesis one, leader, best = None
        cdef list ready
        cdef double take_over = TAKE_OVER
        self.since += dt
        if self._as_expected():
            return True
        ready = [one for one in self.hypotheses
                 if one.count and (one is self.leader or one.next >= self._samples.count)]
        if not ready:
            return False
        leader = self.leader if self.leader in ready else ready[0]
        for one in ready:
            if best is None or one.lead(best) > 0:
                best = one
        if self._is_elsewhere(ready, leader):
            self.leader, leader.next = leader, self._samples.count
            self._drop_others()
            self._happen(Event.ANEW)
            self._begin()
            return False
        if self.leader is None or best.lead(leader) > take_over:
            leader = best
        self.leader = leader
        if not self._is_over(leader, self._prune(ready, leader)):
            return False
        self._end(Event.DECIDED)
        return True

    cdef bint _as_expected(self):
        """Is the last sample what the one that is kept expects? Then what it refused was wrong, and it leads again."""
        cdef Hypothesis kept = self._kept
        cdef RecentSamples samples = self._samples
        cdef long row = samples.row(samples.count - 1)
        if kept is None or kept.next >= samples.count:
            return False
        kept.next = samples.count
        if not kept.filter.surprise(samples.values[row], samples.flags[row], samples.last - kept.time) < EXPLAINS:
            return False
        self._kept = None
        self.hypotheses.append(kept)
        self.leader = kept
        kept.update(samples.last, samples.values[row], samples.flags[row])
        kept.judge_anew()
        kept.judge()
        self._end(Event.EXPECTED)
        return True

    cdef bint _is_elsewhere(self, list ready, Hypothesis leader):
        """Is every hypothesis far off, so that what came before is from elsewhere? Only so many times in a row."""
        cdef Hypothesis one
        cdef double far = ELSEWHERE * ELSEWHERE
        for one in ready:
            if not one.last > far:
                self._anew = 0
                return False
        if not (len(ready) > 1 or leader.count > 2) or self._anew >= ANEW:
            return False
        self._anew += 1
        return True

    cdef bint _prune(self, list ready, Hypothesis leader):
        """Give up what is far behind the leader; returns whether it leads clearly before what is left."""
        cdef Hypothesis one
        cdef double ahead, take_over = TAKE_OVER, give_up = GIVE_UP
        cdef int patience = PATIENCE, fewest = FEWEST_JUDGED
        cdef bint same, clear = True
        for one in ready:
            one.next = self._samples.count
            if one is leader:
                continue
            ahead = leader.lead(one)
            same = ahead > 0 and self._near(leader, one.behaviour, one.filter.c[0], one.filter.c[1])
            if one.count >= fewest and (ahead > give_up or same or (one.count >= patience and ahead > 0)):
                self._drop(one)
            else:
                clear = clear and ahead > take_over
        return clear

    cdef bint _is_over(self, Hypothesis leader, bint clear):
        cdef double explains = EXPLAINS, longest = SEARCH_S, shortest = SHORTEST_S
        cdef int samples = SHORTEST_SAMPLES
        return leader.misfit / leader.weight < explains and (
            self.since >= longest or (leader.count >= samples and clear and self.since >= shortest))

    cdef _drop_others(self):
        cdef Hypothesis one
        for one in list(self.hypotheses):
            if one is not self.leader:
                self._drop(one)

    cdef _drop(self, Hypothesis one):
        self.hypotheses.remove(one)
        self._free[one.behaviour].append(one.filter)

    def probabilities(self):
        """Posterior probability of each behaviour by name; gaits of one behaviour count together."""
        cdef Hypothesis one, first = None
        cdef double total = 0, weight
        cdef Py_ssize_t index
        self._weights[:] = 0
        for one in self.hypotheses:
            if one.weight:
                if first is None:
                    first = one
                weight = exp(min(max(one.lead(first), -50.0), 50.0))
                self._weights[one.behaviour] = max(self._weights[one.behaviour], weight)
        for index in range(self._weights.shape[0]):
            total += self._weights[index]
        if total == 0:  # nothing was judged yet
            return dict.fromkeys(self._gaits, 1 / <double>len(self._gaits))
        return {name: sum([self._weights[index] for index in gaits]) / total for name, gaits in self._gaits.items()}
