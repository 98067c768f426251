"""What a search asks of a hypothesis (see hypothesis.pyx)."""
from style_core.phase_style.arrow_state cimport Filter


cdef class Hypothesis:
    cdef readonly int behaviour
    cdef readonly Filter filter
    cdef public long next
    cdef public double time         # of the last update, s; NaN before the first
    # fading sums over samples: 1, innovation a joint that entered and of all, joints, log det of their covariance
    cdef readonly double weight, misfit
    cdef double cost, seen, logs, tail, prior
    cdef double last            # innovation a joint of the last sample, of all
    cdef readonly int count

    cpdef judge_anew(self)
    cpdef update(self, double time, const double[::1] y, const unsigned char[::1] observed)
    cpdef judge(self)
    cpdef weigh(self, double innovation, double logs, int seen, int rejected=*)
    cdef double _tailed(self, double innovation)
    cdef double _score(self)
    cpdef double lead(self, Hypothesis other)
