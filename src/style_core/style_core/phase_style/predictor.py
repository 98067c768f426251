"""The full predictor: several behaviours, a search over phase and speed, detection of loss, one filter that leads."""
import math

import numpy as np

from style_core.errors import ModelError
from style_core.phase_style.full import PARTS, filter_table, make_filter, still_behaviour, style_prior
from style_core.phase_style.kernel import Table, rank_phases
from style_core.phase_style.online import GAP_S, InnovationMonitor, ObservationGate
from style_core.predictor import Estimate, Prediction, Status

__all__ = ['FullPredictor']

#: Samples kept for starting a hypothesis in the past, and their smallest distance, s.
WINDOW = 10
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


class _Glance:
    """Quick ranking of phases of one behaviour: its mean motion with two variances (see `rank_phases`)."""

    def __init__(self, behaviour, table):
        residual = behaviour.residual
        self.behaviour = behaviour
        self.mean = np.ascontiguousarray(table.values[:, 0])
        self.posture = np.ascontiguousarray(
            np.sum(table.values[:, 1:] ** 2, axis=1) + residual.offset + residual.fast + residual.personal)
        self.change = residual.fast + residual.noise + 0.5 * residual.personal
        mean, spread, low, high = behaviour.velocity
        if high <= 0:
            self.phases, self.speeds, self.width = np.zeros(1), [0.0], 0.1
        elif behaviour.rhythmic:
            self.phases = np.arange(PHASES) * 2 * np.pi / PHASES
            self.speeds = [min(max(mean + factor * spread, low), high) for factor in SPEEDS]
            self.width = 2 * np.pi / PHASES
        else:
            self.phases, self.speeds, self.width = np.arange(PHASES) / PHASES, [mean], 1 / PHASES
        self.scores = np.empty(len(self.phases))

    def peaks(self, y, observed, back, speed):
        """The best phases at the last sample, each a peak of the score over phase: list of (score, phase)."""
        rank_phases(self.mean, self.posture, self.change, y, observed, back, speed, self.phases,
                    self.behaviour.rhythmic, self.scores)
        scores = self.scores.tolist()
        last = len(scores) - 1
        if not self.behaviour.rhythmic:  # the ends have one neighbour
            scores.append(-math.inf)
        found = [(scores[k], k) for k in range(last + 1)
                 if scores[k] >= scores[k - 1] and (scores[k] > scores[(k + 1) % len(scores)] or last == 0)]
        found.sort(reverse=True)
        return [(score / len(y), float(self.phases[k])) for score, k in found[:PEAKS]]


class _Track:
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


class FullPredictor:
    """Phase, style and residual of a moving person, on line.

    Fulfils `style_core.predictor.OnlinePredictor`. One filter leads and is used for estimates and predictions. At
    the start, and whenever the leader's innovations get out of bounds, other hypotheses (behaviour, phase, speed)
    are ranked at a quick glance, the best of them run beside the leader from the last samples on, and the likelihood
    of what was seen decides. The work for this is spread over the observations.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models. Standing still is added as a behaviour of its own.
    without : collection of str
        Parts of the filter to leave out (`style_core.phase_style.full.PARTS`), for ablation.
    """

    def __init__(self, behaviours, without=()):
        unknown = set(without) - set(PARTS)
        if unknown:
            raise ValueError(f'{", ".join(sorted(unknown))}: no part of the filter; the parts are {", ".join(PARTS)}')
        behaviours = list(behaviours)
        for behaviour in behaviours:
            if behaviour.residual is None:
                raise ModelError(f'behaviour {behaviour.name!r} has no residual model: train it again, or use '
                                 "method 'paper'")
        self.joint_names = behaviours[0].joint_names
        if 'still' not in without and all(behaviour.name != 'still' for behaviour in behaviours):
            behaviours.append(still_behaviour(behaviours))
        self._without = frozenset(without)
        self._behaviours = behaviours
        self._glances, self._pool, self._priors, self._tables = [], [], [], []
        for behaviour in behaviours:
            table = filter_table(behaviour, without)
            self._glances.append(_Glance(behaviour, table))
            self._priors.append(style_prior(behaviour.styles, behaviour.groups,
                                            1e4 if 'prior' in without else behaviour.residual.style_scale))
            table = Table(table)
            self._tables.append(table)
            self._pool.append([make_filter(behaviour, table, without) for _ in range(LIVE + 1)])
        self._certain = [{one.name: float(one is behaviour) for one in behaviours} for behaviour in behaviours]
        self._slices = [(index, speed) for index, glance in enumerate(self._glances) for speed in glance.speeds]
        channels = len(self.joint_names)
        self._gate = ObservationGate(channels)
        self._monitor = InnovationMonitor()
        self._y = np.zeros((WINDOW, channels))
        self._observed = np.zeros((WINDOW, channels), dtype=np.uint8)
        self._times = np.zeros(WINDOW)
        self._now = tuple(np.empty((1, channels)) for _ in range(3))
        self._zero = np.zeros(1)
        self._now_scale = [float(self._scale(index, self._zero)[0]) for index in range(len(behaviours))]
        self._leader = None
        self.reset()

    def reset(self):
        """Forget everything observed; the next update starts a search."""
        self._gate.reset()
        self._forget()

    def _forget(self):
        self._monitor.reset()
        self._tracks = []
        self._leader = None
        self._free = [list(filters) for filters in self._pool]
        self._filled = 0          # samples stored since the start of the window
        self._board = {}          # (behaviour, speed) -> time and peaks of the last glance
        self._turn = 0
        self._searching = True
        self._status = Status.ACQUIRING
        self._since = 0.0
        mean, spread = self._behaviours[0].velocity[:2]
        self._pool[0][0].start(0.0, mean, 4.0 if self._behaviours[0].rhythmic else 0.1, max(spread, 1e-3) ** 2)

    def update(self, time, y, mask=None):
        """Take one observation (see `style_core.predictor.OnlinePredictor.update`)."""
        gate = self._gate
        dt = gate.take(time, y, mask)
        if dt > GAP_S:
            self._forget()
            dt = 0.0
        try:
            self._follow(dt)
        except ArithmeticError:  # values no body can have: what they did to the filters is of no use
            self._forget()
        return self._estimate()

    def _follow(self, dt):
        """Update the leader, search, and judge."""
        gate = self._gate
        sampled = self._store()
        spent = 0
        leader = self._leader
        if leader is not None:
            leader.filter.update(gate.y, gate.observed, max(gate.time - leader.time, 0.0))
            leader.time = gate.time
            spent = 1
            if sampled:
                leader.judge()
        if self._searching:
            self._since += dt
            if sampled:
                self._search(BUDGET - spent)
            self._settle()
        leader = self._leader
        if not self._searching:
            out = self._monitor.add(leader.filter.innovation, dt)
            if out and 'restart' not in self._without:
                self._lose()

    def _store(self):
        """Keep the observation for the search if it is far enough from the last one and not empty."""
        gate = self._gate
        last = (self._filled - 1) % WINDOW
        if not gate.observed.any() or (self._filled and gate.time - self._times[last] < SPACING_S):
            return False
        row = self._filled % WINDOW
        self._y[row] = gate.y
        self._y[row][gate.observed == 0] = 0.0
        self._observed[row] = gate.observed
        self._times[row] = gate.time
        self._filled += 1
        return True

    def _window(self, most=6):
        """The last samples, oldest first."""
        count = min(self._filled, WINDOW, most)
        return np.arange(self._filled - count, self._filled) % WINDOW

    def _search(self, budget):
        """Glance at some hypotheses, start the best, and let those that run catch up."""
        rows = self._window()
        y, observed = self._y[rows], self._observed[rows]
        back = self._times[rows[-1]] - self._times[rows]
        now = self._times[rows[-1]]
        # one sample says nothing about speed: glance at every behaviour with its mean speed; later at all in turn
        if len(rows) == 1:
            keys = [(index, glance.speeds[0]) for index, glance in enumerate(self._glances)]
        else:
            keys = [self._slices[(self._turn + k) % len(self._slices)] for k in range((len(self._slices) + 2) // 3)]
            self._turn += len(keys)
        self._board = {key: found for key, found in self._board.items() if now - found[0] < STALE_S}
        for index, speed in keys:
            self._board[index, speed] = now, self._glances[index].peaks(y, observed, back, speed)
        self._start_candidates(rows)
        # those that are nearly up to date first: one that never catches up is of no use
        for track in sorted(self._tracks, key=lambda one: -one.next):
            while budget > 0 and track is not self._leader and track.next < self._filled:
                row = track.next % WINDOW
                track.take(self._times[row], self._y[row], self._observed[row])
                track.next += 1
                budget -= 1

    def _start_candidates(self, rows):
        """Start the best of the board that is not running yet, in place of the worst that runs."""
        now = self._times[rows[-1]]
        order = sorted(((score, index, speed, phase, stamp) for (index, speed), (stamp, found) in self._board.items()
                        for score, phase in found), reverse=True)
        most = 1 if 'search' in self._without and self._leader is None else LIVE
        for _, index, speed, phase, stamp in order:
            if len(self._tracks) >= most:
                break
            behaviour = self._behaviours[index]
            at = phase + speed * (now - stamp)
            if any(self._near(track, index, at, speed) for track in self._tracks):
                continue
            if not self._free[index]:
                continue
            one = self._free[index].pop()
            first = max(self._filled - REPLAY, 0)
            glance = self._glances[index]
            one.start(at - speed * (now - self._times[first % WINDOW]), speed, glance.width ** 2,
                      max(behaviour.velocity[1], 1e-3) ** 2 * (0.5 if len(glance.speeds) > 1 else 1.0))
            track = _Track(index, one, first)
            self._tracks.append(track)

    def _near(self, track, index, phase, speed):
        """Does a running hypothesis already stand for this behaviour, phase and speed?"""
        if track.behaviour != index:
            return False
        state, glance = track.filter.state, self._glances[index]
        difference = state[0] - phase
        if self._behaviours[index].rhythmic:
            difference = (difference + math.pi) % (2 * math.pi) - math.pi
        return len(glance.phases) == 1 or (
            abs(difference) < 2 * glance.width and abs(state[1] - speed) < self._behaviours[index].velocity[1])

    def _settle(self):
        """Choose the leader, give up what is far behind, end the search when it is decided."""
        ready = [track for track in self._tracks
                 if track.count and (track is self._leader or track.next >= self._filled)]
        if not ready:
            return
        leader = self._leader if self._leader in ready else ready[0]
        best = max(ready, key=lambda track: track.score / track.weight)
        if self._leader is None or best.lead(leader) > TAKE_OVER:
            leader = best
        self._leader = leader
        others = []
        for track in ready:
            track.next = self._filled
            if track is leader:
                continue
            ahead = leader.lead(track)
            state = track.filter.state
            same = ahead > 0 and self._near(leader, track.behaviour, state[0], state[1])
            if track.count >= 3 and (ahead > GIVE_UP or same or (track.count >= PATIENCE and ahead > 0)):
                self._drop(track)
            else:
                others.append(ahead)
        explains = leader.misfit / leader.weight < self._monitor.limit
        decided = leader.count >= 6 and all(ahead > TAKE_OVER for ahead in others)
        if explains and (self._since >= SEARCH_S or (decided and self._since >= 0.1)):
            for track in list(self._tracks):
                if track is not leader:
                    self._drop(track)
            self._searching = False
            self._status = Status.TRACKING
            self._monitor.reset()

    def _drop(self, track):
        self._tracks.remove(track)
        self._free[track.behaviour].append(track.filter)

    def _lose(self):
        """The leader no longer explains what is seen: search again, the leader as one of the hypotheses."""
        self._searching = True
        self._status = Status.LOST
        self._since = 0.0
        self._board = {}
        self._leader.judge_anew()

    def _probabilities(self):
        if not self._searching:
            return dict(self._certain[self._leader.behaviour])
        judged = [track for track in self._tracks if track.weight]
        if not judged:
            return {behaviour.name: 1 / len(self._behaviours) for behaviour in self._behaviours}
        weights = {}
        for track in judged:
            weight = math.exp(min(max(track.lead(judged[0]), -50.0), 50.0))
            weights[track.behaviour] = max(weights.get(track.behaviour, 0.0), weight)
        total = sum(weights.values())
        return {behaviour.name: weights.get(index, 0.0) / total
                for index, behaviour in enumerate(self._behaviours)}

    def _estimate(self):
        gate = self._gate
        observed = gate.observed.astype(bool)
        mean, std, velocity = self._now
        leader = self._leader
        if leader is None:  # nothing was observed yet
            index, one, innovation, log_likelihood = 0, self._pool[0][0], math.nan, 0.0
        else:
            index, one = leader.behaviour, leader.filter
            innovation, log_likelihood = one.innovation, one.log_likelihood
        one.predict(self._zero, mean, std, velocity)
        scale = self._now_scale[index]
        phase, speed, covariance, style, style_covariance = one.describe(*self._priors[index])
        return Estimate(
            time=gate.time, phase=phase, phase_velocity=speed, phase_covariance=covariance, style=style,
            style_covariance=style_covariance, mean=mean[0].copy(), std=std[0] * scale,
            observed=observed, innovation=innovation, log_likelihood=log_likelihood, status=self._status,
            behaviours=self._probabilities())

    def _scale(self, index, horizons):
        residual = self._behaviours[index].residual
        if 'calibration' in self._without:
            return np.ones(len(horizons))
        return np.interp(horizons, residual.calibration_horizon, residual.calibration_scale)

    def predict(self, horizons):
        """Predict at ``horizons`` (shape (H,), s after the last update, >= 0)."""
        horizons = np.ascontiguousarray(horizons, dtype=float)
        if horizons.ndim != 1 or not np.all(horizons >= 0):
            raise ValueError('horizons must be a one-dimensional array of times >= 0')
        shape = (len(horizons), len(self.joint_names))
        mean, std, velocity = np.empty(shape), np.empty(shape), np.empty(shape)
        leader = self._leader
        index, one = (0, self._pool[0][0]) if leader is None else (leader.behaviour, leader.filter)
        try:
            one.predict(horizons, mean, std, velocity)
        except ArithmeticError:
            self._forget()
            index, one = 0, self._pool[0][0]
            one.predict(horizons, mean, std, velocity)
        std *= self._scale(index, horizons)[:, None]
        start = 0.0 if self._gate.time is None else self._gate.time
        return Prediction(start + horizons, mean, std, velocity)
