"""Memory of the kernels (see memory.pyx)."""

cdef double[::1] aligned(long count)
cdef float[::1] aligned_single(long count)
cdef int check_horizons(const double[::1] horizons) except -1

cdef inline double total_of(const double* four) noexcept nogil:
    """Sum of the lanes of half a block."""
    return (four[0] + four[1]) + (four[2] + four[3])


cdef class Sheet:
    cdef object memory
    cdef int J, D
    cdef double *phases     # covariance of phase and velocity (2, 2)
    cdef double *style      # (J,)
    cdef double *covariance  # (J, J)
    cdef double *mean       # (D,)
    cdef double *std        # (D,)

    cdef tuple arrays(self)
