"""Bases over phase, for kernels (see basis_table.pyx)."""
from libc.math cimport floor

cdef extern from "lanes.h":
    enum: LANES, MOST
    double TWO_PI
    ctypedef float cell
    ctypedef struct cubic:
        const cell *here
        const cell *next
        double h[8]
    void cubic_weights(cubic*, double, double) noexcept nogil
    double cubic_of(const double*, double, double, double, double) noexcept nogil
    void between(double, const double*, const double*, double*, int) noexcept nogil


cdef inline double wrapped(double phase) noexcept nogil:
    phase = phase - TWO_PI * floor(phase / TWO_PI)
    return phase if phase < TWO_PI else 0.0


cdef class Table:
    cdef readonly int count, channels, nodes
    cdef readonly bint rhythmic
    cdef int blocks, width
    cdef cell[::1] memory
    cdef cell* cells                    # (nodes + 1, blocks, count, value and slope, 8)
    cdef const double[:, ::1] variances

    cdef void place(self, double phase, int* node, double* part, double* rate) noexcept nogil
    cdef void look_up(self, double phase, cubic* at) noexcept nogil
    cdef double variance(self, double phase, const double* weight) noexcept nogil
