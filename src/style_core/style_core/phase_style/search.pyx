"""Search over behaviour, phase and speed: hypotheses ranked at a glance, run side by side, judged by likelihood."""
import numpy as np

from libc.math cimport INFINITY, M_PI, NAN, exp, fabs, floor, isnan, log, log1p

from style_core.phase_style.glance cimport Glance
from style_core.phase_style.kernel cimport Filter

__all__ = ['BUDGET', 'GLANCE_COST', 'LIMIT', 'LIVE', 'START_COST', 'Search', 'Track']

#: Samples kept for starting a hypothesis in the past, samples a glance looks at, and their smallest distance, s.
WINDOW = 10
GLANCE = 6
SPACING_S = 1 / 60.0 - 1e-3
#: Hypotheses that run at a time.
LIVE = 3
#: Work spent on one observation at most, in filter updates; what a start costs in the same unit, and what a glance costs
#: for each speed, and once more to lay out the samples (measured in use, where little of it lies in the caches).
BUDGET = 5.0
GLANCE_COST = 0.35
START_COST = 0.35
#: Samples in the past from which a new hypothesis starts.
REPLAY = 4
#: Best phases kept of a glance, and how long they count, s.
PEAKS = 3
STALE_S = 0.15
#: Weight of the past, a sample, when hypotheses are compared by the likelihood of what they saw.
MEMORY = 0.85
#: Successive innovations of one filter repeat each other: so many count as one when hypotheses are compared.
CORRELATED = 5.0
#: Nats by which another hypothesis must lead to take over, and by which one must be behind to be given up.
TAKE_OVER = 1.0
GIVE_UP = 3.0
#: Samples after which a hypothesis that does not lead makes room for a new one.
PATIENCE = 12
#: A search ends after this long, s - if the leader explains what it sees; otherwise it goes on.
SEARCH_S = 0.4
#: Innovation a joint, averaged over what was seen, up to which a leader explains it; the variances promise one.
EXPLAINS = 3.0
#: Standard deviations beyond which a joint is not believed, and the share of the joints up to which it is the sensors
#: that are wrong. Where more are out it is the motion; while tracking the observation is left out then, and a loss.
#: For the likelihood a joint that is left out is at the limit.
LIMIT, FEW = 20.0, 0.15
#: Where every hypothesis is farther off than so many standard deviations on average, the search begins anew.
ELSEWHERE = 12.0
#: Times in a row that a search may begin anew.
ANEW = 2
#: So long a leader that did not take in what called a loss is kept as it was, s: it leads again once what is seen is as
#: it expects. And so long it goes on speaking: nobody is elsewhere that fast, but what a bus says may be.
KEPT_S, HOLD_S = 0.25, 0.05


cdef class Track:
    """A hypothesis: a filter, how far it has come, and how well it explained what it saw.

    Parameters
    ----------
    behaviour : int
    one : Filter
    first : int
        The sample it starts from.
    tail : float
        Samples that the size of what it promises is known from: its first innovation has the heavy tails of a Student
        distribution with so many, as nobody's posture is known before.
    prior : float
        Log prior weight of where it started, nats.
    """

    cdef readonly int behaviour
    cdef readonly Filter filter
    cdef public long next
    cdef public double time         # of the last update, s; NaN before the first
    # fading sums over samples: 1, innovation a joint that is believed and of all, joints, log det of their covariance
    cdef readonly double weight, misfit
    cdef double cost, seen, logs, tail, prior
    cdef double last            # innovation a joint of the last sample, of all
    cdef readonly int count

    def __init__(self, int behaviour, Filter one, long first, double tail, double prior=0.0):
        self.behaviour, self.filter, self.next, self.time = behaviour, one, first, NAN
        self.tail, self.prior = tail, prior
        self.judge_anew()

    cpdef judge_anew(self):
        """Forget how well it did."""
        self.weight, self.misfit, self.cost, self.seen, self.logs, self.count = 0.0, 0.0, 0.0, 0.0, 0.0, 0

    cpdef take(self, double time, const double[::1] y, const unsigned char[::1] observed):
        """Update with a sample."""
        self.filter.update(y, observed, 0.0 if isnan(self.time) else max(time - self.time, 0.0))
        self.time = time

    cpdef judge(self):
        """Take the filter's last update into account."""
        self.weigh(self.filter.innovation, self.filter.log_determinant, self.filter.seen, self.filter.rejected)

    cpdef weigh(self, double innovation, double logs, int seen, int rejected=0):
        """Take an update into account.

        Parameters
        ----------
        innovation : float
            Squared innovation a joint that was believed.
        logs : float
            Log of the determinant of the innovations' covariance.
        seen, rejected : int
            Joints that were believed, and that were not.
        """
        cdef double memory = MEMORY, limit = LIMIT * LIMIT
        if seen + rejected == 0:
            return
        if seen == 0:
            innovation = limit
        self.last = (innovation * seen + limit * rejected) / (seen + rejected)
        self.logs = memory * self.logs + logs
        self.misfit = memory * self.misfit + self._tailed(innovation)
        self.cost = memory * self.cost + self._tailed(self.last)
        self.seen = memory * self.seen + seen + rejected
        self.weight = memory * self.weight + 1.0
        self.count += 1

    cdef double _tailed(self, double innovation):
        """The first innovation has heavy tails."""
        return innovation if self.count else 1 + (self.tail + 1) * log1p((innovation - 1) / (self.tail + 1))

    cdef double _score(self):
        """Log likelihood a sample. Variances are those of a usual person: whoever is smoother has smaller ones."""
        cdef double level = min((1 + self.cost) / (1 + self.weight), 1.0)
        return -0.5 * (self.seen * (log(level) + self.cost / (level * self.weight)) + self.logs) / self.weight

    cpdef double lead(self, Track other):
        """Nats by which it explains the last samples better than another."""
        return ((self._score() - other._score()) * min(self.weight, other.weight) / <double>CORRELATED
                + self.prior - other.prior)


cdef class Search:
    """Hypotheses beside the one that leads.

    Samples are kept for a short while, so that a hypothesis can start in the past and catch up. Hypotheses are ranked
    at a quick glance, the best of them run, and the likelihood of what was seen decides who leads. The work is
    spread over the samples: updates, glances and starts share one budget. A leader that did not believe what called the
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
        Leave out joints that cannot be believed (False for ablation).

    Attributes
    ----------
    leader : Track or None
        None until something was observed.
    speaker : Track or None
        Where estimates and predictions come from: the leader, or one that is kept.
    holding : bool
        What was seen last is not believed yet: a leader that is kept speaks.
    tracks : list of Track
        All that run, the leader included.
    since : float
        Duration of this search, s.
    """

    cdef readonly list tracks, glances
    cdef readonly Track leader
    cdef public double since
    cdef list _pool, _free
    cdef bint _single, _rejects
    # of each part of a glance, a behaviour at a speed: which, its peaks (parts, peaks; see `Glance.peaks`), those looked at
    cdef int[::1] _behaviour, _taken
    cdef double[::1] _speed, _prior     # the latter is its log weight, nats
    cdef double[:, ::1] _score, _phase
    cdef double[::1] _stamps    # when it was glanced at, s
    cdef double[::1] _back      # time of each sample to the last one, s; scratch
    cdef int _turn              # behaviour to glance at next
    cdef Track _kept            # a leader that did not take in what called this search, as it was
    cdef int _anew              # times in a row that the search began anew
    cdef list _slot             # of each behaviour: its first part
    cdef object _y, _observed, _times
    cdef double[:, ::1] _samples
    cdef unsigned char[:, ::1] _flags
    cdef double[::1] _time
    cdef long _filled           # samples stored
    cdef long _first            # the first of them that this search may use
    cdef long _base             # of them, those before the first row of the memory
    cdef double _last           # stamp of the last, s
    cdef double[::1] _spread    # of the speed, of each behaviour
    cdef double[::1] _phase_variance, _speed_variance   # at a start
    cdef double[::1] _tail      # samples that the size of what they promise is known from
    cdef double[::1] _width     # distance of the phases tried
    cdef unsigned char[::1] _rhythmic
    cdef dict _gaits            # of each name: its behaviours
    cdef double[::1] _weights   # of each behaviour; scratch

    def __init__(self, behaviours, glances, pool, bint single=False, bint rejects=True):
        channels = len(behaviours[0].joint_names)
        self.glances, self._pool, self._single, self._rejects = glances, pool, single, rejects
        counts = [len(glance.speeds) for glance in glances]
        self._behaviour = np.repeat(np.arange(len(glances), dtype=np.intc), counts)
        self._slot = [sum(counts[:index]) for index in range(len(glances))]
        self._speed = np.concatenate([glance.speeds for glance in glances])
        spread = [max(behaviour.velocity[1], 1e-3) for behaviour in behaviours]
        self._prior = np.concatenate([[-0.5 * ((speed - glance.speeds[0]) / one) ** 2 for speed in glance.speeds]
                                      for glance, one in zip(glances, spread)])
        self._phase_variance = np.array([glance.width ** 2 for glance in glances])
        self._speed_variance = np.array([one ** 2 * (0.5 if len(glance.speeds) > 1 else 1.0)
                                         for glance, one in zip(glances, spread)])
        self._stamps, self._taken = np.empty(sum(counts)), np.empty(sum(counts), dtype=np.intc)
        self._score, self._phase = np.empty((2, sum(counts), PEAKS))
        self._back = np.empty(WINDOW)
        self._spread = np.array([behaviour.velocity[1] for behaviour in behaviours], dtype=float)
        self._tail = np.array([behaviour.residual.check_weight for behaviour in behaviours], dtype=float)
        self._width = np.array([glance.width if len(glance.phases) > 1 else INFINITY for glance in glances])
        self._rhythmic = np.array([behaviour.rhythmic for behaviour in behaviours], dtype=np.uint8)
        self._gaits, self._weights = {}, np.empty(len(behaviours))
        for index, behaviour in enumerate(behaviours):
            self._gaits.setdefault(behaviour.name, []).append(index)
        # several windows long, so that the last samples always lie in one piece
        self._y = np.zeros((8 * WINDOW, channels))
        self._observed = np.zeros((8 * WINDOW, channels), dtype=np.uint8)
        self._times = np.zeros(8 * WINDOW)
        self._samples, self._flags, self._time = self._y, self._observed, self._times
        self.reset()

    def reset(self):
        """Forget all hypotheses and samples."""
        self.tracks = []
        self.leader = None
        self._free = [list(filters) for filters in self._pool]
        self._filled = self._first = self._base = 0
        self._last = 0.0
        self._turn = self._anew = 0
        self._kept = None
        self._clear()

    cdef _clear(self):
        self.since = 0.0
        self._stamps[:] = -INFINITY

    def again(self):
        """The leader no longer explains what is seen: search, with the leader as one of the hypotheses.

        Samples from before say nothing about what is seen now, be it another person or another place. The last one
        counts for all: a leader that was surprised by it and has made room for it since would else look better than
        hypotheses which start from it.
        """
        self._first = max(self._filled - 1, 0)
        self._clear()
        self._keep()
        self.leader.judge_anew()
        self.leader.judge()
        if self._rejects:
            self.leader.filter.believe(LIMIT, FEW, EXPLAINS)

    cdef _keep(self):
        """A leader that refused what called this search stays as it is; a copy takes its place."""
        cdef Track old = self.leader
        cdef Filter one
        self._expire()
        if self._kept is not None or old.filter.seen or not self._rejects:
            return
        one = self._free[old.behaviour].pop()
        one.copy(old.filter)
        self.leader = Track(old.behaviour, one, self._filled, old.tail, old.prior)
        self.leader.time = old.time
        self.tracks[self.tracks.index(old)] = self.leader
        self._kept = old
        old.next = self._filled

    @property
    def speaker(self):
        return self._kept if self._holding() else self.leader

    @property
    def holding(self):
        return self._holding()

    cdef bint _holding(self):
        cdef double hold = HOLD_S
        return self._kept is not None and self._last - self._kept.time < hold + 1e-3

    cdef _expire(self):
        """Let go of a leader that was kept long enough."""
        if self._kept is not None and self._last - self._kept.time > KEPT_S:
            self._free[self._kept.behaviour].append(self._kept.filter)
            self._kept = None

    cdef bint _as_expected(self):
        """Is the last sample what the leader that was kept expects? Then what it refused was wrong, and it leads again."""
        cdef Track kept
        cdef long row = self._filled - 1 - self._base
        self._expire()
        kept = self._kept
        if kept is None or kept.next >= self._filled:
            return False
        kept.next = self._filled
        if not kept.filter.surprise(self._samples[row], self._flags[row], self._last - kept.time) < EXPLAINS:
            return False
        self._kept = None
        self.tracks.append(kept)
        self.leader = kept
        kept.take(self._last, self._samples[row], self._flags[row])
        kept.judge_anew()
        kept.judge()
        self._end()
        return True

    def store(self, double time, const double[::1] y, const unsigned char[::1] seen):
        """Keep an observation if it is far enough from the last one and not empty; returns whether it was."""
        cdef long row, d, count = 0
        for d in range(seen.shape[0]):
            count += seen[d]
        if (self._filled and time - self._last < SPACING_S) or count == 0:
            return False
        row = self._filled - self._base
        if row == self._samples.shape[0]:
            for memory in (self._y, self._observed, self._times):
                memory[:WINDOW] = memory[-WINDOW:]
            self._base = self._filled - WINDOW
            row = WINDOW
        self._samples[row, :] = y
        self._flags[row, :] = seen
        self._time[row] = self._last = time
        self._filled += 1
        return True

    def window(self):
        """The last samples of this search, oldest first: observations, and what of them counts."""
        rows = slice(self._oldest(), self._filled - self._base)
        return self._y[rows], self._observed[rows]

    cdef long _oldest(self):
        """Row of the first sample to glance at."""
        return self._filled - self._base - min(self._filled - self._first, <long>WINDOW, <long>GLANCE)

    def step(self, double budget):
        """Glance at a hypothesis, start the best, and let those that run catch up.

        ``budget`` is what this may cost, in filter updates. While a place is free a glance comes first; while all are
        taken, it gets what the updates leave.
        """
        cdef Track track
        cdef int live = 1 if self._single and self.leader is None else LIVE
        for track in list(self.tracks):
            if track is not self.leader and self._filled - track.next > WINDOW:
                self._drop(track)  # newer ones were served first, and its samples are gone
        if len(self.tracks) < live:
            budget = self._look(budget)
            budget = self._start_candidates(live, budget)
            self._catch_up(budget)
        else:
            budget = self._catch_up(budget)
            self._look(budget)

    cdef double _look(self, double budget):
        """Glance at one behaviour after the other, all speeds at a time; returns the budget left."""
        cdef int index, speeds
        cdef double cost, each = GLANCE_COST, start = START_COST
        if self._filled - self._first == 1:
            # one sample says nothing about speed: every behaviour with its mean speed, if one update can still follow
            cost = 2 * each
            for index in range(len(self.glances)):
                if budget < cost + (start + 1 if index else 0):
                    break
                self._glance(index, 1)
                budget -= cost
            return budget
        speeds = len((<Glance>self.glances[self._turn]).speeds)
        cost = each * (1 + speeds)
        if budget < cost:
            return budget
        self._glance(self._turn, speeds)
        self._turn = (self._turn + 1) % len(self.glances)
        return budget - cost

    cdef _glance(self, int index, int speeds):
        cdef Glance glance = self.glances[index]
        cdef long k, first = self._oldest(), stop = self._filled - self._base
        cdef int slot = self._slot[index]
        for k in range(first, stop):
            self._back[k - first] = self._last - self._time[k]
        glance.peaks(self._samples[first:stop], self._flags[first:stop], self._back[:stop - first], speeds,
                     self._score[slot:], self._phase[slot:])
        self._stamps[slot:slot + speeds] = self._last

    cdef double _catch_up(self, double budget):
        """Update hypotheses with samples they have not seen; returns the budget left."""
        cdef Track track, best
        cdef long row
        while budget >= 1:
            # those that are nearly up to date first: one that never catches up is of no use
            best = None
            for track in self.tracks:
                if track is not self.leader and track.next < self._filled and (best is None or track.next > best.next):
                    best = track
            if best is None:
                break
            row = best.next - self._base
            best.take(self._time[row], self._samples[row], self._flags[row])
            best.judge()
            best.next += 1
            budget -= 1
        return budget

    cdef double _start_candidates(self, int live, double budget):
        """Start the best that was seen at a glance and is not running yet; returns the budget left."""
        cdef double now = self._last, at, speed, start = START_COST
        cdef int slot, peak, index
        cdef long first
        cdef Filter one
        self._taken[:] = 0
        while len(self.tracks) < live and budget >= start + 1:  # an update must be left
            slot = self._best()
            if slot < 0:
                break
            peak, index, speed = self._taken[slot], self._behaviour[slot], self._speed[slot]
            self._taken[slot] += 1
            at = self._phase[slot, peak] + speed * (now - self._stamps[slot])
            if self._runs(index, at, speed) or not self._free[index]:
                continue
            one = self._free[index].pop()
            if self._rejects:
                one.believe(LIMIT, FEW, EXPLAINS)
            first = max(self._filled - REPLAY, self._first)
            one.start(at - speed * (now - self._time[first - self._base]), speed, self._phase_variance[index],
                      self._speed_variance[index])
            self.tracks.append(Track(index, one, first, self._tail[index], self._prior[slot]))
            budget -= start
        return budget

    cdef int _best(self):
        """Part of a glance with the best peak that is not taken yet; -1 if there is none."""
        cdef int slot, best = -1
        cdef double score, most = -INFINITY, stale = STALE_S
        for slot in range(self._stamps.shape[0]):
            if self._taken[slot] < self._score.shape[1] and self._last - self._stamps[slot] < stale:
                score = self._score[slot, self._taken[slot]]  # NaN: no peak is left here
                if score >= most:
                    best, most = slot, score
        return best

    cdef bint _runs(self, int index, double phase, double speed):
        cdef Track track
        for track in self.tracks:
            if self._near(track, index, phase, speed):
                return True
        return False

    cdef bint _near(self, Track track, int index, double phase, double speed):
        """Does a running hypothesis already stand for this behaviour, phase and speed?"""
        cdef double difference
        if track.behaviour != index:
            return False
        difference = track.filter.c[0] - phase
        if self._rhythmic[index]:
            difference -= 2 * M_PI * floor((difference + M_PI) / (2 * M_PI))
        return self._width[index] == INFINITY or (
            fabs(difference) < 2 * self._width[index]
            and fabs(track.filter.c[1] - speed) < self._spread[index])

    def settle(self):
        """Choose the leader, give up what is far behind; returns True when it is decided and the search is over."""
        cdef Track track, leader, best = None
        cdef list ready
        cdef double ahead, elsewhere = ELSEWHERE * ELSEWHERE, take_over = TAKE_OVER, give_up = GIVE_UP
        cdef int patience = PATIENCE
        cdef bint same, clear = True, over, lost = True
        if self._as_expected():
            return True
        ready = [track for track in self.tracks
                 if track.count and (track is self.leader or track.next >= self._filled)]
        if not ready:
            return False
        leader = self.leader if self.leader in ready else ready[0]
        for track in ready:
            lost = lost and track.last > elsewhere
            if best is None or track.lead(best) > 0:
                best = track
        if lost:
            if (len(ready) > 1 or leader.count > 2) and self._anew < ANEW:  # what came before is from elsewhere
                self._anew += 1
                self.leader, leader.next = leader, self._filled
                self._drop_others()
                self.again()
                return False
        else:
            self._anew = 0
        if self.leader is None or best.lead(leader) > take_over:
            leader = best
        self.leader = leader
        for track in ready:
            track.next = self._filled
            if track is leader:
                continue
            ahead = leader.lead(track)
            same = ahead > 0 and self._near(leader, track.behaviour, track.filter.c[0], track.filter.c[1])
            if track.count >= 3 and (ahead > give_up or same or (track.count >= patience and ahead > 0)):
                self._drop(track)
            else:
                clear = clear and ahead > take_over
        over = leader.misfit / leader.weight < EXPLAINS and (
            self.since >= SEARCH_S or (leader.count >= 6 and clear and self.since >= 0.1))
        if over:
            self._end()
        return over

    cdef _end(self):
        self._drop_others()
        if self._rejects:
            self.leader.filter.believe(LIMIT, FEW, EXPLAINS, True)

    cdef _drop_others(self):
        for track in list(self.tracks):
            if track is not self.leader:
                self._drop(track)

    cdef _drop(self, Track track):
        self.tracks.remove(track)
        self._free[track.behaviour].append(track.filter)

    def probabilities(self):
        """Posterior probability of each behaviour by name; gaits of one behaviour count together."""
        cdef Track track, first = None
        cdef double total = 0, weight
        self._weights[:] = 0
        for track in self.tracks:
            if track.weight:
                if first is None:
                    first = track
                weight = exp(min(max(track.lead(first), -50.0), 50.0))
                self._weights[track.behaviour] = max(self._weights[track.behaviour], weight)
        for weight in self._weights:
            total += weight
        if total == 0:  # nothing was judged yet
            return dict.fromkeys(self._gaits, 1 / <double>len(self._gaits))
        return {name: sum([self._weights[index] for index in gaits]) / total for name, gaits in self._gaits.items()}
