"""Outlier rejection for the arrow filter (see rejection.pyx)."""
from style_core.phase_style.arrow cimport arrow


cdef class Rejection:
    cdef double limit, few, rest
    cdef bint whole
    cdef double[:, ::1] doubt
    cdef bint doubting              # some channels are in doubt
    cdef readonly object used
    cdef unsigned char[::1] _used
    cdef int seen, rejected         # channels that entered the last update, and that were left out of it

    cdef void reset(self) noexcept nogil
    cdef void copy(self, Rejection other)
    cdef bint trusted(self, int channel) noexcept nogil
    cdef void admit(self, const unsigned char[::1] observed) noexcept nogil
    cdef bint gate(self, arrow* f, const double* P, int level, double dt) noexcept nogil
    cdef bint readmit(self, const unsigned char[::1] observed, double squares) noexcept nogil
    cdef int _mark(self, arrow* f, const double* P, double squares, bint first) noexcept nogil
    cdef void _judge(self, arrow* f, int level, int channel, double dt) noexcept nogil
