"""Kernels of the locomotion model: cyclic Gaussian chains and banded cyclic hidden Markov chains, linear in their length.

Every function takes C-contiguous float64 arrays and writes into the arrays it is given; the shapes are the caller's
business (`style_core.locomotion.learn` and `.infer`).
"""
from libc.math cimport exp, log, INFINITY
from libc.stdlib cimport free, malloc

# exp(-46) < 2**-66: what lies further below the largest term of a sum cannot change the sum in double precision
cdef double NEGLIGIBLE = -46.0
# what paths through a cell of less posterior than exp(-80) add to the posterior of any cell before it is less still
cdef double UNREACHED = -80.0


def cyclic_chain(const double[:, ::1] diagonal, const double[::1] coupling, const double[:, ::1] potential,
                 double[:, ::1] mean, double[:, ::1] variance, double[:, ::1] neighbour, double[::1] log_det):
    """Moments of B Gaussians whose precision is cyclic tridiagonal, in O(M B).

    System b has ``diagonal[:, b]`` on its diagonal and ``-coupling[b]`` between neighbours, the last and the first
    included. Cutting the ring between them leaves T with S = T + coupling v v^T, v = e_first - e_last: T is factored
    as L D L^T, the moments of T^-1 follow by the backward recursion of its pivots, and the Sherman-Morrison formula
    closes the ring.

    Parameters
    ----------
    diagonal, potential : (M, B), M >= 3
    coupling : (B,), >= 0; ``diagonal >= 2 coupling`` with a strict sign somewhere
    mean, variance : (M, B), out
        S^-1 potential and the diagonal of S^-1.
    neighbour : (M, B), out
        Covariance of m and m - 1; row 0 that of the first with the last.
    log_det : (B,), out
        Of S.
    """
    cdef Py_ssize_t M = diagonal.shape[0], B = diagonal.shape[1], m, b
    cdef double s, l, gain, last
    cdef double *work = <double *> malloc((2 * M * B + 2 * B) * sizeof(double))
    if work == NULL:
        raise MemoryError()
    cdef double *pivot = work               # 1 / d_m
    cdef double *close = work + M * B       # T^-1 v
    cdef double *jump = work + 2 * M * B    # (T^-1)_{first, last}
    cdef double *gap = jump + B             # v^T T^-1 potential
    with nogil:
        for b in range(B):
            pivot[b] = 1.0 / (diagonal[0, b] - coupling[b])
            mean[0, b] = potential[0, b]
            close[b] = 1.0
            log_det[b] = -log(pivot[b])
        for m in range(1, M):
            for b in range(B):
                s = coupling[b]
                last = s if m == M - 1 else 0.0
                l = s * pivot[(m - 1) * B + b]                    # minus the factor of L
                pivot[m * B + b] = 1.0 / (diagonal[m, b] - last - s * l)
                mean[m, b] = potential[m, b] + l * mean[m - 1, b]
                close[m * B + b] = l * close[(m - 1) * B + b] - (1.0 if m == M - 1 else 0.0)
            for b in range(B):
                log_det[b] -= log(pivot[m * B + b])
        for b in range(B):
            variance[M - 1, b] = pivot[(M - 1) * B + b]
            mean[M - 1, b] *= pivot[(M - 1) * B + b]
            close[(M - 1) * B + b] *= pivot[(M - 1) * B + b]
            jump[b] = pivot[(M - 1) * B + b]
        for m in range(M - 2, -1, -1):
            for b in range(B):
                l = coupling[b] * pivot[m * B + b]
                neighbour[m + 1, b] = l * variance[m + 1, b]
                variance[m, b] = pivot[m * B + b] + l * neighbour[m + 1, b]
                mean[m, b] = pivot[m * B + b] * mean[m, b] + l * mean[m + 1, b]
                close[m * B + b] = pivot[m * B + b] * close[m * B + b] + l * close[(m + 1) * B + b]
                jump[b] *= l
        for b in range(B):
            s = 1.0 + coupling[b] * (close[b] - close[(M - 1) * B + b])
            log_det[b] += log(s)
            gap[b] = mean[0, b] - mean[M - 1, b]
            neighbour[0, b] = jump[b]
        for m in range(M):
            for b in range(B):
                gain = coupling[b] / (1.0 + coupling[b] * (close[b] - close[(M - 1) * B + b])) * close[m * B + b]
                mean[m, b] -= gain * gap[b]
                variance[m, b] -= gain * close[m * B + b]
                neighbour[m, b] -= gain * (close[(m - 1) * B + b] if m > 0 else close[(M - 1) * B + b])
    free(work)


cdef inline double log_sum(const double *terms, Py_ssize_t n) noexcept nogil:
    """log sum exp of a few terms; -inf where all are."""
    cdef double top = terms[0], total = 0.0, d
    cdef Py_ssize_t j
    for j in range(1, n):
        if terms[j] > top:
            top = terms[j]
    if top == -INFINITY:
        return top
    for j in range(n):
        d = terms[j] - top
        if d == 0.0:
            total += 1.0
        elif d > NEGLIGIBLE:
            total += exp(d)
    return top if total == 1.0 else top + log(total)


def forward_backward(const double[:, ::1] emission, const double[::1] log_jump,
                     double[:, ::1] occupancy, double[::1] counts):
    """Posterior of a cyclic left-to-right chain, uniform at its start, in O(T M J).

    The whole recursion runs on logarithms: with sixty channels two positions easily differ by more than the range
    of a double in a few frames, and scaled probabilities would lose the path that later frames ask for.

    Parameters
    ----------
    emission : (T, M)
        Log likelihood of each frame at each position (up to a constant a frame).
    log_jump : (J,)
        Log probability of advancing by 1 .. J positions, J <= M.
    occupancy : (T, M), out
    counts : (J,), out
        Expected number of advances by 1 .. J.

    Returns
    -------
    log_likelihood, expected_emission : float
        log sum over paths, and sum of occupancy times emission.
    """
    cdef Py_ssize_t T = emission.shape[0], M = emission.shape[1], J = log_jump.shape[0], i, m, j, n
    cdef double total, d, fit = 0.0, row
    # both work rows are padded by J so that a neighbour around the ring needs no modulo
    cdef double *work = <double *> malloc((2 * (M + J) + J) * sizeof(double))
    if work == NULL:
        raise MemoryError()
    cdef double *past = work                # past[J + m] = log alpha of the frame before, past[0:J] its tail
    cdef double *ahead = work + M + J       # ahead[m] = emission + log beta of the frame after, then its head
    cdef double *terms = work + 2 * (M + J)
    with nogil:
        for m in range(M):
            occupancy[0, m] = emission[0, m] - log(<double> M)
        for i in range(1, T):
            for m in range(M):
                past[J + m] = occupancy[i - 1, m]
            for j in range(J):
                past[j] = past[M + j]
            for m in range(M):
                for j in range(J):
                    terms[j] = past[J + m - 1 - j] + log_jump[j]
                occupancy[i, m] = log_sum(terms, J) + emission[i, m]
        total = occupancy[T - 1, 0]
        for m in range(1, M):
            if occupancy[T - 1, m] > total:
                total = occupancy[T - 1, m]
        if total > -INFINITY:
            row = 0.0
            for m in range(M):
                d = occupancy[T - 1, m] - total
                if d > NEGLIGIBLE:
                    row += exp(d)
            total += log(row)
        for j in range(J):
            counts[j] = 0.0
        if total > -INFINITY:
            for i in range(T - 1, -1, -1):
                if i < T - 1:
                    for j in range(J):
                        ahead[M + j] = ahead[j]
                row = 0.0
                for m in range(M):
                    d = 0.0
                    if i < T - 1:
                        for j in range(J):
                            terms[j] = ahead[m + 1 + j] + log_jump[j]
                        d = log_sum(terms, J)
                    # the row of ahead is read m + 1 onwards only, so that entry m may be replaced, but entry 0 .. J
                    # are read again through the padding, which was copied above
                    past[m] = d
                    d = occupancy[i, m] + d - total
                    if d > UNREACHED:
                        if i < T - 1:
                            for j in range(J):
                                counts[j] += exp(occupancy[i, m] + terms[j] - total)
                        occupancy[i, m] = exp(d)
                        row += occupancy[i, m]
                    else:
                        past[m] = -INFINITY
                        occupancy[i, m] = 0.0
                for m in range(M):
                    ahead[m] = past[m] + emission[i, m]
                    occupancy[i, m] /= row
                    if occupancy[i, m] > 0.0:
                        fit += occupancy[i, m] * emission[i, m]
    free(work)
    return total, fit


def viterbi(const double[:, ::1] emission, const double[::1] log_jump, long long[::1] path):
    """Most probable path of the chain of `forward_backward`; returns its log probability with the data."""
    cdef Py_ssize_t T = emission.shape[0], M = emission.shape[1], J = log_jump.shape[0], i, m, j, best
    cdef double value, top
    cdef double *past = <double *> malloc((M + J) * sizeof(double))
    cdef unsigned char *back = <unsigned char *> malloc(T * M)
    cdef double *now = <double *> malloc(M * sizeof(double))
    if past == NULL or back == NULL or now == NULL:
        free(past)
        free(back)
        free(now)
        raise MemoryError()
    with nogil:
        for m in range(M):
            now[m] = emission[0, m] - log(<double> M)
        for i in range(1, T):
            for m in range(M):
                past[J + m] = now[m]
            for j in range(J):
                past[j] = past[M + j]
            for m in range(M):
                top = -INFINITY
                best = 0
                for j in range(J):
                    value = past[J + m - 1 - j] + log_jump[j]
                    if value > top:
                        top = value
                        best = j
                now[m] = top + emission[i, m]
                back[i * M + m] = <unsigned char> best
        best = 0
        for m in range(1, M):
            if now[m] > now[best]:
                best = m
        top = now[best]
        path[T - 1] = best
        for i in range(T - 1, 0, -1):
            best = best - 1 - back[i * M + best]
            if best < 0:
                best += M
            path[i - 1] = best
    free(past)
    free(back)
    free(now)
    return top
