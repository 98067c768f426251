"""Where hypotheses may start: behaviours, phases and speeds, ranked at a glance."""
import numpy as np

from libc.math cimport INFINITY

from style_core.phase_style.glance cimport Glance
from style_core.phase_style.recent_samples cimport RecentSamples
from style_core.phase_style.settings import GLANCE, GLANCE_COST, PEAKS, STALE_S, START_COST, WINDOW

__all__ = ['GLANCE', 'GLANCE_COST', 'PEAKS', 'STALE_S', 'START_COST', 'WINDOW', 'Candidates']


cdef class Candidates:
    """Peaks of the glances, of every behaviour at every speed.

    Parameters
    ----------
    behaviours : list of Behaviour
    glances : list of Glance
    """

    def __init__(self, behaviours, glances):
        self.glances = glances
        counts = [len(glance.speeds) for glance in glances]
        self.behaviour = np.repeat(np.arange(len(glances), dtype=np.intc), counts)
        self.slot = [sum(counts[:index]) for index in range(len(glances))]
        self.speed = np.concatenate([glance.speeds for glance in glances])
        self.prior = np.concatenate([[-0.5 * ((speed - glance.speeds[0]) / max(one.velocity[1], 1e-3)) ** 2
                                      for speed in glance.speeds] for one, glance in zip(behaviours, glances)])
        self.stamps, self.taken = np.empty(sum(counts)), np.empty(sum(counts), dtype=np.intc)
        self.score, self.phase = np.empty((2, sum(counts), PEAKS))
        self.back = np.empty(WINDOW)
        self.reset()

    def reset(self):
        """Begin with the first behaviour."""
        self.turn = 0
        self.forget()

    def forget(self):
        """What was seen at a glance no longer counts."""
        self.stamps[:] = -INFINITY

    cdef double look(self, RecentSamples samples, double budget) except? -1:
        """Glance at one behaviour after the other, all speeds at a time; returns the budget left."""
        cdef int index, speeds
        cdef double cost, each = GLANCE_COST, start = START_COST
        if samples.usable() == 1:
            # one sample says nothing about speed: every behaviour with its mean speed, if one update can still follow
            cost = 2 * each
            for index in range(len(self.glances)):
                if budget < cost + (start + 1 if index else 0):
                    break
                self._glance(samples, index, 1)
                budget -= cost
            return budget
        speeds = len((<Glance>self.glances[self.turn]).speeds)
        cost = each * (1 + speeds)
        if budget < cost:
            return budget
        self._glance(samples, self.turn, speeds)
        self.turn = (self.turn + 1) % len(self.glances)
        return budget - cost

    cdef long reach(self, RecentSamples samples) except? -1:
        """How many samples a glance looks at."""
        return min(samples.usable(), <long>WINDOW, <long>GLANCE)

    cdef _glance(self, RecentSamples samples, int index, int speeds):
        cdef Glance glance = self.glances[index]
        cdef int slot = self.slot[index]
        cdef long k, stop = samples.row(samples.count)
        cdef long first = stop - self.reach(samples)
        for k in range(first, stop):
            self.back[k - first] = samples.last - samples.time[k]
        glance.peaks(samples.values[first:stop], samples.flags[first:stop], self.back[:stop - first], speeds,
                     self.score[slot:], self.phase[slot:])
        self.stamps[slot:slot + speeds] = samples.last

    cdef int next(self, double now):
        """Part of a glance with the best peak that is not taken yet; -1 if there is none."""
        cdef int slot, best = -1
        cdef double score, most = -INFINITY, stale = STALE_S
        for slot in range(self.stamps.shape[0]):
            if self.taken[slot] < self.score.shape[1] and now - self.stamps[slot] < stale:
                score = self.score[slot, self.taken[slot]]  # NaN: no peak is left here
                if score >= most:
                    best, most = slot, score
        return best
