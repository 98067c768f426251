"""What a search asks of a glance."""

cdef extern from "glance.h":
    ctypedef struct glance:
        int blocks, nodes, samples
        const float *mean
        const float *posture
        const float *log_posture
        const float *change
        const float *y
        const float *seen
        const float *any
        const float *over
        float most
        float *totals


cdef class Glance:
    cdef readonly object phases, speeds
    cdef readonly double width
    cdef int _nodes, _channels
    cdef bint _rhythmic
    cdef glance _f
    cdef float[::1] _tables, _samples
    cdef double[::1] _log_change, _phases, _speeds, _scores
    cdef float[::1] _totals         # scratch
    cdef int[::1] _marks

    cpdef peaks(self, const double[:, ::1] y, const unsigned char[:, ::1] observed, const double[::1] back, int speeds,
                double[:, ::1] scores, double[:, ::1] phases)
    cdef double _lay_out(self, const double[:, ::1] y, const unsigned char[:, ::1] observed) except *
    cdef void _rank(self, const double[::1] back, double velocity, double constant) noexcept nogil
    cdef void _best(self, int samples, double[::1] scores, double[::1] phases) noexcept nogil
    cdef double _rate(self) noexcept nogil
    cdef int _node(self, double at) noexcept nogil
