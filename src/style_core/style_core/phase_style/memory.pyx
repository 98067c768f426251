"""Memory of the kernels: arrays on cache lines, and the arrays of an estimate in one piece."""
import numpy as np

from libc.stdint cimport uintptr_t

cdef object empty = np.empty


cdef double[::1] aligned(long count):
    """Zeros, `count` of them, from an address that is a multiple of a cache line on."""
    cdef double[::1] memory = np.zeros(count + 8)
    cdef long first = ((64 - <uintptr_t>&memory[0] % 64) % 64) // 8
    return memory[first:first + count]


cdef float[::1] aligned_single(long count):
    """The same in single precision."""
    return np.asarray(aligned((count + 1) // 2)).view(np.float32)[:count]


cdef int check_horizons(const double[::1] horizons) except -1:
    for h in range(horizons.shape[0]):
        if not horizons[h] >= 0:
            raise ValueError('horizons must be a one-dimensional array of times >= 0')
    return 0


cdef class Sheet:
    """Arrays of an estimate, in one piece of memory."""

    def __cinit__(self, int J, int D):
        cdef double[::1] memory
        self.J, self.D = J, D
        self.memory = memory = empty(4 + J + J * J + 2 * D)
        self.phases = &memory[0]
        self.style = self.phases + 4
        self.covariance = self.style + J
        self.mean = self.covariance + J * J
        self.std = self.mean + D

    cdef tuple arrays(self):
        cdef int J = self.J, D = self.D, k = 4 + J + J * J
        memory = self.memory
        return (memory[:4].reshape(2, 2), memory[4:4 + J], memory[4 + J:k].reshape(J, J), memory[k:k + D],
                memory[k + D:])
