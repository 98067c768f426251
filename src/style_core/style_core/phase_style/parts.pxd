"""What a channel is made of beside the bases: a sum of independent stationary processes, its parts.

A part has states u, du = F u dt + noise, with the stationary covariance P0 (a multiple of the part's variance), and
adds w(phase)^T u to the channel (docs/phase_style.md, eq. 3). A kind of part is said here, once: how many states it
has, F, e^(F t), w, its derivative by phase, and P0. All else follows: what is new after a time, how the states enter an
observation ahead of time, its velocity, and the covariance between two times.
"""
from libc.math cimport exp

cdef enum:
    LEVEL    # a value of which e^-rt is left
    SMOOTH   # a value and its velocity, Matern 3/2
    SMOOTHER  # a value, its velocity and its acceleration, Matern 5/2
    CYCLE    # two coefficients, of cos k phase and sin k phase, of which e^-rt is left

cdef enum:
    WIDEST_PART = 3     # states a part may have

cdef struct part:
    int kind, first, harmonic   # first of its states in the channel
    double rate


cdef inline int size_of(const part* p) noexcept nogil:
    return 1 if p.kind == LEVEL else 3 if p.kind == SMOOTHER else 2


cdef inline bint is_coupled(const part* p) noexcept nogil:
    """Do its states depend on each other? Otherwise F = -rate I, P0 = I, and w has length one."""
    return p.kind == SMOOTH or p.kind == SMOOTHER


cdef inline bint turns(const part* p) noexcept nogil:
    """Does it enter an observation according to the phase? (Such a part is not coupled.)"""
    return p.kind == CYCLE


cdef inline void generator(const part* p, double* F) noexcept nogil:
    """F of coupled states, row by row."""
    cdef double r = p.rate
    if p.kind == SMOOTH:
        F[0], F[1] = 0, 1
        F[2], F[3] = -r * r, -2 * r
    elif p.kind == SMOOTHER:
        F[0], F[1], F[2] = 0, 1, 0
        F[3], F[4], F[5] = 0, 0, 1
        F[6], F[7], F[8] = -r * r * r, -3 * r * r, -3 * r


cdef inline void transition(const part* p, double t, double left, double* G) noexcept nogil:
    """e^(F t) of coupled states; ``left`` is e^(-rate t)."""
    cdef double r = p.rate, x = r * t
    if p.kind == SMOOTH:
        G[0], G[1] = left * (1 + r * t), left * t
        G[2], G[3] = -left * r * r * t, left * (1 - r * t)
    elif p.kind == SMOOTHER:  # (F + r I)^3 = 0, so that the series ends
        G[0], G[1], G[2] = left * (1 + x + x * x / 2), left * t * (1 + x), left * t * t / 2
        G[3], G[4], G[5] = -left * r * x * x / 2, left * (1 + x - x * x), left * t * (1 - x / 2)
        G[6], G[7], G[8] = left * r * r * x * (x / 2 - 1), left * r * x * (x - 3), left * (1 - 2 * x + x * x / 2)


cdef inline void prior(const part* p, double* P0) noexcept nogil:
    """P0 of coupled states; that of their sum in an observation, w^T P0 w, is one."""
    if p.kind == SMOOTH:
        P0[0], P0[1] = 1, 0
        P0[2], P0[3] = 0, p.rate * p.rate
    elif p.kind == SMOOTHER:
        P0[0], P0[1], P0[2] = 1, 0, -p.rate * p.rate / 3
        P0[3], P0[4], P0[5] = 0, p.rate * p.rate / 3, 0
        P0[6], P0[7], P0[8] = -p.rate * p.rate / 3, 0, p.rate * p.rate * p.rate * p.rate


cdef inline void weights(const part* p, double c, double d, double* w, double* by_phase) noexcept nogil:
    """w and its derivative by phase; ``c`` and ``d`` are cos and sin of harmonic times phase."""
    cdef int a
    if p.kind == CYCLE:
        w[0], w[1] = c, d
        by_phase[0], by_phase[1] = -p.harmonic * d, p.harmonic * c
        return
    for a in range(size_of(p)):
        w[a] = by_phase[a] = 0
    w[0] = 1


cdef inline void renewed(const part* p, const double* G, double* Q) noexcept nogil:
    """What is new of coupled states: the lower triangle of P0 - G P0 G^T."""
    cdef int i, j, k, l, at = 0, n = size_of(p)
    cdef double total
    cdef double P0[WIDEST_PART * WIDEST_PART]
    prior(p, P0)
    for i in range(n):
        for j in range(i + 1):
            total = P0[i * n + j]
            for k in range(n):
                for l in range(n):
                    total -= G[i * n + k] * P0[k * n + l] * G[j * n + l]
            Q[at] = total
            at += 1


cdef inline double ahead(const part* p, double t, double left, const double* w, double* s,
                         double* by_time) noexcept nogil:
    """How the present states enter an observation a time ahead, s = G^T w and ds/dt = F^T s; returns how much of the
    part is new by then, w^T P0 w - s^T P0 s."""
    cdef int a, b, n = size_of(p)
    cdef double fresh = 1
    cdef double G[WIDEST_PART * WIDEST_PART]
    cdef double F[WIDEST_PART * WIDEST_PART]
    cdef double P0[WIDEST_PART * WIDEST_PART]
    if not is_coupled(p):
        for a in range(n):
            s[a] = left * w[a]
            by_time[a] = -p.rate * s[a]
        return 1 - left * left
    transition(p, t, left, G)
    generator(p, F)
    prior(p, P0)
    for a in range(n):
        s[a] = 0
        for b in range(n):
            s[a] += G[b * n + a] * w[b]
    for a in range(n):
        by_time[a] = 0
        for b in range(n):
            by_time[a] += F[b * n + a] * s[b]
            fresh -= s[a] * P0[a * n + b] * s[b]
    return fresh


cdef class Part:
    cdef part p
