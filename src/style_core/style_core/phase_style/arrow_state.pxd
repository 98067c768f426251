"""What a search asks of a filter without going through Python, and the state of the full one (see arrow_state.pyx)."""
from style_core.phase_style.arrow cimport arrow, horizon
from style_core.phase_style.basis_table cimport MOST, Table
from style_core.phase_style.parts cimport Part, part
from style_core.phase_style.rejection cimport Rejection

cdef enum:
    KNOTS = 9   # standard deviations are evaluated at so many of the horizons


cdef class Filter:
    cdef readonly double innovation, log_likelihood
    cdef readonly double log_determinant    # of the covariance of the last update's innovations
    cdef readonly int seen, rejected        # joints that entered the last update, and those that were left out of it
    cdef double[::1] c                      # mean of the common state: phase, velocity, style

    cpdef start(self, double phase, double velocity, double phase_variance, double velocity_variance)
    cpdef copy(self, Filter of)
    cpdef gate(self, double limit=*, double few=*, double rest=*, bint whole=*)
    cpdef update(self, const double[::1] y, const unsigned char[::1] observed, double dt)
    cpdef double surprise(self, const double[::1] y, const unsigned char[::1] observed, double ahead) except? -1


cdef class ArrowState(Filter):
    cdef readonly Table table
    cdef readonly int styles, states, channels, common
    cdef double style_rate, acceleration, lowest, highest
    cdef Rejection rejection
    cdef int level              # state that takes over what a channel insists on
    cdef int harmonics          # the highest of any part
    cdef part parts[MOST]
    cdef arrow f
    cdef horizon times[KNOTS]
    cdef double[::1] memory, sums, rows
    # of the last prediction: `planned` horizons, and for each what does not depend on the state (`_plan_one`)
    cdef double[::1] horizons, plans
    cdef double[::1] one_plan
    cdef long planned
    cdef double[::1] age, work, pose
    cdef double[:, ::1] P, precision, matrix
    cdef double log_precision   # of its determinant
    cdef int turn               # style component that drifts next
    cdef bint fresh             # the precision belongs to the covariance
    cdef bint rooted            # so does its root

    cdef int _add(self, Part one) except -1
    cdef double _bounded(self, double phase) noexcept nogil
    cdef void _bound(self) noexcept nogil
    cdef int _invert(self) noexcept nogil
    cdef void _fill(self) noexcept nogil
    cdef int _root(self) noexcept nogil
    cdef void _multiples(self, double phase, double* c, double* d) noexcept nogil
