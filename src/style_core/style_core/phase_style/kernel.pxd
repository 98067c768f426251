"""What other kernels may use of this one without going through Python."""
from libc.math cimport floor

cdef extern from "blocks.h":
    double TWO_PI

cdef float[::1] aligned_single(long count)


cdef inline double wrapped(double phase) noexcept nogil:
    phase = phase - TWO_PI * floor(phase / TWO_PI)
    return phase if phase < TWO_PI else 0.0


cdef class Filter:
    cdef readonly double innovation, log_likelihood
    cdef readonly double log_determinant    # of the covariance of the last update's innovations
    cdef readonly int seen, rejected        # joints that entered the last update, and those that were not believed
    cdef double[::1] c                      # mean of the common state: phase, velocity, style

    cpdef start(self, double phase, double velocity, double phase_variance, double velocity_variance)
    cpdef copy(self, Filter of)
    cpdef believe(self, double limit=*, double few=*, double rest=*, bint whole=*)
    cpdef update(self, const double[::1] y, const unsigned char[::1] observed, double dt)
    cpdef double surprise(self, const double[::1] y, const unsigned char[::1] observed, double ahead) except? -1
