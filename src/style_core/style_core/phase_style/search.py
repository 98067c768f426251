"""Search over behaviour, phase and speed: hypotheses ranked at a glance, run side by side, judged by likelihood."""
import math

import numpy as np

from style_core.phase_style.kernel import PhaseRanking

__all__ = ['BUDGET', 'LIVE', 'Glance', 'Search', 'Track']

#: Samples kept for starting a hypothesis in the past, samples a glance looks at, and their smallest distance, s.
WINDOW = 10
GLANCE = 6
SPACING_S = 1 / 60 - 1e-3
#: Hypotheses that run at a time, and filter updates spent on one observation at most.
LIVE = 3
BUDGET = 4
#: Samples in the past from which a new hypothesis starts.
REPLAY = 4
#: Best phases kept of a glance, and how long they count, s.
PEAKS = 3
STALE_S = 0.15
#: Phases tried a behaviour, and speeds as multiples of the training spread around the mean.
PHASES = 32
SPEEDS = (0.0, -1.2, 1.2, 2.4)
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


class Glance:
    """Quick ranking of phases of one behaviour: its mean motion with two variances (see `PhaseRanking`)."""

    def __init__(self, behaviour, table):
        residual = behaviour.residual
        self.behaviour = behaviour
        posture = np.sum(table.values[:, 1:] ** 2, axis=1) + residual.offset + residual.fast + residual.personal
        change = residual.fast + residual.noise + 0.5 * residual.personal
        self._ranking = PhaseRanking(table.values[:, 0], posture, change, behaviour.rhythmic)
        mean, spread, low, high = behaviour.velocity
        if high <= 0:
            self.phases, self.speeds, self.width = np.zeros(1), [0.0], 0.1
        elif behaviour.rhythmic:
            self.phases = np.arange(PHASES) * 2 * np.pi / PHASES
            self.speeds = [min(max(mean + factor * spread, low), high) for factor in SPEEDS]
            self.width = 2 * np.pi / PHASES
        else:
            self.phases, self.speeds, self.width = np.arange(PHASES) / PHASES, [mean], 1 / PHASES

    def peaks(self, y, observed, back, speed):
        """The best phases at the last sample, each a peak of the score over phase: list of (score, phase)."""
        return self._ranking.peaks(y, observed, back, speed, self.phases, PEAKS)


class Track:
    """A hypothesis: a filter, how far it has come, and how well it explained what it saw."""

    __slots__ = ('behaviour', 'count', 'filter', 'misfit', 'next', 'score', 'time', 'weight')

    def __init__(self, behaviour, one, first):
        self.behaviour, self.filter, self.next, self.time = behaviour, one, first, None
        self.judge_anew()

    def judge_anew(self):
        """Forget how well it did."""
        self.score, self.weight, self.misfit, self.count = 0.0, 0.0, 0.0, 0

    def take(self, time, y, observed):
        """Update with a sample."""
        self.filter.update(y, observed, 0.0 if self.time is None else max(time - self.time, 0.0))
        self.time = time
        self.judge()

    def judge(self):
        """Take the filter's last update into account."""
        if not math.isnan(self.filter.innovation):
            self.score = MEMORY * self.score + self.filter.log_likelihood
            self.misfit = MEMORY * self.misfit + self.filter.innovation
            self.weight = MEMORY * self.weight + 1.0
            self.count += 1

    def lead(self, other):
        """Nats by which it explains the last samples better than another."""
        return (self.score / self.weight - other.score / other.weight) * min(self.weight, other.weight) / CORRELATED


class Search:
    """Hypotheses beside the one that leads.

    Samples are kept for a short while, so that a hypothesis can start in the past and catch up. Hypotheses are ranked
    at a quick glance, the best of them run, and the likelihood of what was seen decides who leads. The work is
    spread over the samples.

    Parameters
    ----------
    behaviours : list of Behaviour
    glances : list of Glance
    pool : list of list of ArrowFilter
        Of each behaviour, ``LIVE + 1`` filters.
    single : bool
        Start from the best hypothesis alone (for ablation).

    Attributes
    ----------
    leader : Track or None
        None until something was observed.
    tracks : list of Track
        All that run, the leader included.
    """

    def __init__(self, behaviours, glances, pool, single=False):
        channels = len(behaviours[0].joint_names)
        self._behaviours, self._glances, self._pool, self._single = behaviours, glances, pool, single
        self._slices = [(index, speed) for index, glance in enumerate(glances) for speed in glance.speeds]
        # all in three samples; gaits of one behaviour take turns, so that a search costs what it would with one gait
        names = {behaviour.name: len(glance.speeds) for behaviour, glance in zip(behaviours, glances)}
        self._at_once = (sum(names.values()) + 2) // 3
        # several windows long, so that the last samples always lie in one piece
        self._y = np.zeros((8 * WINDOW, channels))
        self._observed = np.zeros((8 * WINDOW, channels), dtype=np.uint8)
        self._times = np.zeros(8 * WINDOW)
        self.reset()

    def reset(self):
        """Forget all hypotheses and samples."""
        self.tracks = []
        self.leader = None
        self._free = [list(filters) for filters in self._pool]
        self._filled = 0          # samples stored
        self._first = 0           # the first of them that this search may use
        self._base = 0            # of them, those before the first row of the memory
        self._last = 0.0          # stamp of the last, s
        self._board = {}          # (behaviour, speed) -> time and peaks of the last glance
        self._turn = 0
        self.since = 0.0          # duration of this search, s

    def again(self):
        """The leader no longer explains what is seen: search, with the leader as one of the hypotheses.

        Samples from before say nothing about what is seen now, be it another person or another place.
        """
        self._first = max(self._filled - 1, 0)
        self.since = 0.0
        self._board = {}
        self.leader.judge_anew()

    def store(self, time, y, seen):
        """Keep an observation if it is far enough from the last one and not empty; returns whether it was."""
        if (self._filled and time - self._last < SPACING_S) or not seen.any():
            return False
        row = self._filled - self._base
        if row == len(self._y):
            for memory in (self._y, self._observed, self._times):
                memory[:WINDOW] = memory[-WINDOW:]
            self._base = self._filled - WINDOW
            row = WINDOW
        self._y[row] = y
        self._observed[row] = seen
        self._times[row] = self._last = time
        self._filled += 1
        return True

    def window(self):
        """The last samples of this search, oldest first: observations, what of them counts, rows they are kept in."""
        stop = self._filled - self._base
        rows = slice(stop - min(self._filled - self._first, WINDOW, GLANCE), stop)
        return self._y[rows], self._observed[rows], rows

    def step(self, budget):
        """Glance at some hypotheses, start the best, and let those that run catch up."""
        y, observed, rows = self.window()
        now = self._last
        back = now - self._times[rows]
        # one sample says nothing about speed: glance at every behaviour with its mean speed; later at all in turn
        if len(y) == 1:
            keys = [(index, glance.speeds[0]) for index, glance in enumerate(self._glances)]
        else:
            keys = [self._slices[(self._turn + k) % len(self._slices)] for k in range(self._at_once)]
            self._turn += len(keys)
        self._board = {key: found for key, found in self._board.items() if now - found[0] < STALE_S}
        for index, speed in keys:
            self._board[index, speed] = now, self._glances[index].peaks(y, observed, back, speed)
        for track in [track for track in self.tracks if self._filled - track.next > WINDOW]:
            if track is not self.leader:  # newer ones were served first, and its samples are gone
                self._drop(track)
        self._start_candidates()
        # those that are nearly up to date first: one that never catches up is of no use
        for track in sorted(self.tracks, key=lambda one: -one.next):
            while budget > 0 and track is not self.leader and track.next < self._filled:
                row = track.next - self._base
                track.take(self._times[row], self._y[row], self._observed[row])
                track.next += 1
                budget -= 1

    def _start_candidates(self):
        """Start the best of the board that is not running yet, in place of the worst that runs."""
        most = 1 if self._single and self.leader is None else LIVE
        if len(self.tracks) >= most:
            return
        now = self._last
        order = sorted(((score, index, speed, phase, stamp) for (index, speed), (stamp, found) in self._board.items()
                        for score, phase in found), reverse=True)
        for _, index, speed, phase, stamp in order:
            if len(self.tracks) >= most:
                break
            behaviour = self._behaviours[index]
            at = phase + speed * (now - stamp)
            if any(self._near(track, index, at, speed) for track in self.tracks):
                continue
            if not self._free[index]:
                continue
            one = self._free[index].pop()
            first = max(self._filled - REPLAY, self._first)
            glance = self._glances[index]
            one.start(at - speed * (now - self._times[first - self._base]), speed, glance.width ** 2,
                      max(behaviour.velocity[1], 1e-3) ** 2 * (0.5 if len(glance.speeds) > 1 else 1.0))
            track = Track(index, one, first)
            self.tracks.append(track)

    def _near(self, track, index, phase, speed):
        """Does a running hypothesis already stand for this behaviour, phase and speed?"""
        if track.behaviour != index:
            return False
        one, glance = track.filter, self._glances[index]
        difference = one.phase - phase
        if self._behaviours[index].rhythmic:
            difference = (difference + math.pi) % (2 * math.pi) - math.pi
        return len(glance.phases) == 1 or (
            abs(difference) < 2 * glance.width and abs(one.velocity - speed) < self._behaviours[index].velocity[1])

    def settle(self, limit):
        """Choose the leader, give up what is far behind; returns True when it is decided and the search is over.

        ``limit`` is the innovation statistic up to which a leader explains what it sees.
        """
        ready = [track for track in self.tracks
                 if track.count and (track is self.leader or track.next >= self._filled)]
        if not ready:
            return False
        leader = self.leader if self.leader in ready else ready[0]
        best = max(ready, key=lambda track: track.score / track.weight)
        if self.leader is None or best.lead(leader) > TAKE_OVER:
            leader = best
        self.leader = leader
        others = []
        for track in ready:
            track.next = self._filled
            if track is leader:
                continue
            ahead = leader.lead(track)
            same = ahead > 0 and self._near(leader, track.behaviour, track.filter.phase, track.filter.velocity)
            if track.count >= 3 and (ahead > GIVE_UP or same or (track.count >= PATIENCE and ahead > 0)):
                self._drop(track)
            else:
                others.append(ahead)
        explains = leader.misfit / leader.weight < limit
        decided = leader.count >= 6 and all(ahead > TAKE_OVER for ahead in others)
        over = explains and (self.since >= SEARCH_S or (decided and self.since >= 0.1))
        if over:
            for track in list(self.tracks):
                if track is not leader:
                    self._drop(track)
        return over

    def _drop(self, track):
        self.tracks.remove(track)
        self._free[track.behaviour].append(track.filter)

    def weights(self):
        """Posterior weight of each behaviour under way, {index: weight}; empty before anything was judged."""
        judged = [track for track in self.tracks if track.weight]
        weights = {}
        for track in judged:
            weight = math.exp(min(max(track.lead(judged[0]), -50.0), 50.0))
            weights[track.behaviour] = max(weights.get(track.behaviour, 0.0), weight)
        total = sum(weights.values())
        return {index: weight / total for index, weight in weights.items()}
