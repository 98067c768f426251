"""The last samples, for a search (see recent_samples.pyx)."""


cdef class RecentSamples:
    cdef readonly object y, observed        # (rows, D)
    cdef object _times
    cdef double[:, ::1] values
    cdef unsigned char[:, ::1] flags
    cdef double[::1] time
    cdef long count         # samples stored
    cdef long first         # the first of them that this search may use
    cdef long base          # of them, those before the first row of the memory
    cdef double last        # stamp of the last, s

    cdef bint add(self, double time, const double[::1] y, const unsigned char[::1] seen) except -1
    cdef long row(self, long sample) noexcept
    cdef long usable(self) noexcept
