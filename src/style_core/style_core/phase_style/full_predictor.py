"""The full predictor: several behaviours, detection of loss and a search to mend it, one filter that leads."""
import math

import numpy as np

from style_core.errors import ModelError
from style_core.phase_style.bands import Bands
from style_core.phase_style.basis_table import Table
from style_core.phase_style.full import PARTS, filter_table, make_filter, still_behaviour
from style_core.phase_style.glance import Glance
from style_core.phase_style.loss import InnovationMonitor
from style_core.phase_style.observation import ObservationChecker
from style_core.phase_style.search import BUDGET, LIMIT, LIVE, Search
from style_core.phase_style.settings import GAP_S
from style_core.phase_style.style_prior import gaits_of, style_prior
from style_core.predictor import Estimate, Prediction

__all__ = ['FullPredictor']


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
        behaviours = [gait for behaviour in behaviours for gait in gaits_of(behaviour)]
        self._behaviours = behaviours
        self._pool, self._priors = [], []
        rejects = not {'rejection', 'restart'} & set(without)  # what is left out may be a loss
        glances = []
        for behaviour in behaviours:
            table = filter_table(behaviour, without)
            glances.append(Glance(behaviour, table, LIMIT if rejects else math.inf))
            self._priors.append(style_prior(behaviour.styles, behaviour.groups,
                                            1e4 if 'prior' in without else behaviour.residual.style_scale))
            table = Table(table)
            self._pool.append([make_filter(behaviour, table, without) for _ in range(LIVE + 2)])
        self._search = Search(behaviours, glances, self._pool, single='search' in without, rejects=rejects)
        self._certain = [{one.name: float(one.name == behaviour.name) for one in behaviours}
                         for behaviour in behaviours]
        self._slowest = [one.velocity[2] if one.velocity[2] > 0 else -1.0 for one in behaviours]
        channels = len(self.joint_names)
        self._observation = ObservationChecker(channels)
        # one is what these variances promise; three times a lower median called steady walks lost
        self._monitor = InnovationMonitor(usual=(1.0, 1.0))
        self._bands = Bands(behaviours, 'calibration' not in without)
        self.reset()

    def reset(self):
        """Forget everything observed; the next update starts a search."""
        self._observation.reset()
        self._forget()

    def _forget(self):
        self._monitor.reset()
        self._search.reset()
        self._bands.reset()
        self._slow_s = 0.0
        mean, spread = self._behaviours[0].velocity[:2]
        self._pool[0][0].start(0.0, mean, 4.0 if self._behaviours[0].rhythmic else 0.1, max(spread, 1e-3) ** 2)

    def update(self, time, y, mask=None):
        """Take one observation (see `style_core.predictor.OnlinePredictor.update`)."""
        dt = self._observation.check(time, y, mask)
        if dt > GAP_S:
            self._forget()
            dt = 0.0
        try:
            self._follow(dt)
            return self._estimate()
        except ArithmeticError:  # values no body can have: what they did to the filters is of no use
            self._forget()
            return self._estimate()

    def _follow(self, dt):
        """Update the leader, search, and watch for a loss."""
        seen, search, leader = self._observation, self._search, self._search.leader
        sampled, searching, spent = search.store(seen.time, seen.y, seen.observed), search.searching, 0
        # while hypotheses are compared all of them see the same samples: one that sees more is surprised less by each
        if leader is not None and (sampled or not searching):
            leader.update(seen.time, seen.y, seen.observed)
            spent = 1
            if sampled:
                leader.judge()
        if searching:
            if sampled:
                search.step(BUDGET - spent)
            if search.decide(dt):
                self._monitor.reset()
        speaker = search.speaker
        if speaker is not None and speaker.filter.rejected:
            np.bitwise_and(seen.observed, speaker.filter.used, out=seen.observed)
        self._bands.observe(seen.observed, dt)
        if not search.searching and self._is_lost(dt):
            self._slow_s = 0.0
            search.lose()
            self._bands.forget()
        if not search.searching and not searching:  # what a search costs is enough for one observation
            self._bands.follow(search.leader, seen.time, seen.y, seen.observed)

    def _is_lost(self, dt):
        """Whether the leader no longer explains what it sees."""
        leader = self._search.leader
        one = leader.filter
        # an observation that is left out as a whole is a loss as well
        out = self._monitor.add(one.innovation, dt) or one.rejected > one.seen == 0
        # as slow as its behaviour allows, a phase follows something else, whatever the innovations say
        self._slow_s = self._slow_s + dt if one.velocity <= self._slowest[leader.behaviour] else 0.0
        return (out or self._slow_s > self._monitor.window_s) and 'restart' not in self._without

    def _probabilities(self):
        search = self._search
        if not search.searching or search.holding:
            return dict(self._certain[search.speaker.behaviour])
        return search.probabilities()

    def _estimate(self):
        speaker = self._search.speaker
        if speaker is None:  # nothing was observed yet
            index, one, innovation, log_likelihood = 0, self._pool[0][0], math.nan, 0.0
        else:
            index, one = speaker.behaviour, speaker.filter
            innovation, log_likelihood = one.innovation, one.log_likelihood
        late = self._late(speaker)
        phase, speed, covariance, style, style_covariance, mean, std = one.describe(*self._priors[index], late)
        self._bands.widen(index, np.array([late]), std[None])
        return Estimate(
            time=self._observation.time, phase=phase, phase_velocity=speed, phase_covariance=covariance, style=style,
            style_covariance=style_covariance, mean=mean, std=std, observed=self._observation.flags(),
            innovation=innovation, log_likelihood=log_likelihood, status=self._search.status,
            behaviours=self._probabilities())

    def _late(self, speaker):
        """Time since its last update, s: one of several hypotheses, it waits for the next sample of all."""
        return self._observation.time - speaker.time if self._search.searching and speaker is not None else 0.0

    def predict(self, horizons):
        """Predict at ``horizons`` (shape (H,), s after the last update, >= 0)."""
        horizons = np.array(horizons, dtype=float)
        speaker = self._search.speaker
        index, one = (0, self._pool[0][0]) if speaker is None else (speaker.behaviour, speaker.filter)
        try:
            mean, std, velocity = self._ahead(index, one, horizons + self._late(speaker))
        except ArithmeticError:
            self._forget()
            mean, std, velocity = self._ahead(0, self._pool[0][0], horizons)
        horizons += self._observation.time or 0.0
        return Prediction(horizons, mean, std, velocity)

    def _ahead(self, index, one, horizons):
        """Predict with the filter ``one`` of a behaviour; bands as wide as they must be."""
        if horizons.ndim != 1:
            raise ValueError('horizons must be a one-dimensional array of times >= 0')
        mean, std, velocity = one.forecast(horizons)
        self._bands.widen(index, horizons, std)
        return mean, std, velocity
