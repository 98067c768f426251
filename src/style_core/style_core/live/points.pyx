# cython: language_level=3
"""Points of a serialised joint trajectory (CDR), copied to arrays."""
from libc.string cimport memcpy

__all__ = ['FIELDS', 'copy_points']

#: lists of numbers in a point, in their order; the time from start (seconds, nanoseconds) follows them
FIELDS = 'positions', 'velocities', 'accelerations', 'effort'

cdef enum:
    ENCAPSULATION = 4       # bytes; alignment counts from behind them


cdef inline unsigned int word(const unsigned char* p, bint big) noexcept nogil:
    if big:
        return <unsigned int>p[0] << 24 | <unsigned int>p[1] << 16 | <unsigned int>p[2] << 8 | p[3]
    return <unsigned int>p[3] << 24 | <unsigned int>p[2] << 16 | <unsigned int>p[1] << 8 | p[0]


cdef inline void numbers(const unsigned char* p, Py_ssize_t count, bint swap, double* out) noexcept nogil:
    cdef Py_ssize_t i, k
    cdef unsigned char* o = <unsigned char*>out
    if not swap:
        memcpy(out, p, 8 * count)
        return
    for i in range(count):
        for k in range(8):
            o[8 * i + k] = p[8 * i + 7 - k]


def copy_points(const unsigned char[::1] data, Py_ssize_t at, bint big, bint swap, double[::1] times,
                double[:, ::1] positions, double[:, ::1] velocities, double[:, ::1] accelerations, long[::1] lengths):
    """Copy the points that begin at ``at``; lists of a point that are not wanted are None.

    Parameters
    ----------
    data : bytes
        The whole message.
    at : int
    big, swap : bool
        Whether the message is big-endian, and whether that is not this machine's order.
    times : ndarray, shape (K,)
        Written, s from the start; for no points only ``lengths`` are written.
    positions, velocities, accelerations : ndarray, shape (K, J), or None
        Written.
    lengths : ndarray of int, shape (4,)
        Of the first point's lists: written where ``times`` is empty, expected of every point otherwise.

    Returns
    -------
    fault : int
        -2 none, -1 the message ends too early, 0 to 3 a list that has another length.
    """
    cdef Py_ssize_t size = data.shape[0], count = times.shape[0], k, field
    cdef long length
    cdef double* out
    cdef bint look = count == 0
    for k in range(1 if look else count):
        for field in range(4):
            at += -at & 3
            if at + 4 > size:
                return -1
            length = word(&data[at], big)
            at += 4
            if look:
                lengths[field] = length
            elif length != lengths[field]:
                return field
            if length == 0:
                continue
            at += (ENCAPSULATION - at) & 7
            if at + 8 * length > size:
                return -1
            out = NULL
            if not look:
                if field == 0:
                    out = &positions[k, 0]
                elif field == 1 and velocities is not None:
                    out = &velocities[k, 0]
                elif field == 2 and accelerations is not None:
                    out = &accelerations[k, 0]
            if out != NULL:
                numbers(&data[at], length, swap, out)
            at += 8 * length
        at += -at & 3
        if at + 8 > size:
            return -1
        if not look:
            times[k] = <int>word(&data[at], big) + 1e-9 * word(&data[at + 4], big)
        at += 8
    return -2
