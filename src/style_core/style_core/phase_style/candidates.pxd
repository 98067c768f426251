"""Where hypotheses may start, for a search (see candidates.pyx)."""
from style_core.phase_style.recent_samples cimport RecentSamples


cdef class Candidates:
    cdef readonly list glances
    # of each part of a glance, a behaviour at a speed: which, its peaks (see `Glance.peaks`), how many were taken
    cdef int[::1] behaviour, taken
    cdef double[::1] speed, prior       # the latter is its log weight, nats
    cdef double[:, ::1] score, phase
    cdef double[::1] stamps             # when it was glanced at, s
    cdef double[::1] back               # time of each sample to the last one, s; scratch
    cdef int turn                       # behaviour to glance at next
    cdef list slot                      # of each behaviour: its first part

    cdef double look(self, RecentSamples samples, double budget) except? -1
    cdef long reach(self, RecentSamples samples) except? -1
    cdef int next(self, double now)
    cdef _glance(self, RecentSamples samples, int index, int speeds)
