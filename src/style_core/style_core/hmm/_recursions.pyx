"""Compiled recursions of hidden Markov models: scaled and logarithmic forward-backward, Viterbi."""
from libc.math cimport exp, log, INFINITY


def gaussian_log_density(const double[:, ::1] white, const double[:, ::1] offset, const double[::1] constant,
                         double[:, ::1] out):
    """out[t, i] = constant[i] - |white[t, i block] - offset[i]|^2 / 2 in one pass; ``offset`` is (N, D)."""
    cdef Py_ssize_t n_frames = out.shape[0], n = offset.shape[0], d = offset.shape[1], t, i, k
    cdef double gap, total
    with nogil:
        for t in range(n_frames):
            for i in range(n):
                total = 0.0
                for k in range(d):
                    gap = white[t, i * d + k] - offset[i, k]
                    total += gap * gap
                out[t, i] = constant[i] - 0.5 * total


def forward_backward_scaled(const double[:, ::1] log_b, const double[::1] start, const double[:, ::1] trans,
                            const double[:, ::1] trans_t, double[:, ::1] alpha, double[:, ::1] beta,
                            double[:, ::1] weight):
    """Fill ``alpha`` (filtered probabilities), ``beta`` (scaled so that alpha * beta is the occupancy) and
    ``weight`` (scaled density times beta: transition counts are ``trans * (alpha[:-1].T @ weight[1:])``).

    Returns the log likelihood and 1 if a path whose probability underflowed might have mattered, else 0.
    """
    cdef Py_ssize_t n_frames = log_b.shape[0], n = log_b.shape[1], t, i, j
    cdef double best, total, a, likelihood = 0.0
    cdef int doubtful = 0
    with nogil:
        for t in range(n_frames):
            if t == 0:
                for i in range(n):
                    alpha[0, i] = start[i]
            else:
                for i in range(n):
                    alpha[t, i] = 0.0
                for j in range(n):
                    a = alpha[t - 1, j]
                    if a != 0.0:
                        for i in range(n):
                            alpha[t, i] += a * trans[j, i]
            best = -INFINITY
            for i in range(n):
                if alpha[t, i] > 1e-280 and log_b[t, i] > best:
                    best = log_b[t, i]
            total = 0.0
            for i in range(n):
                if alpha[t, i] > 1e-280:
                    weight[t, i] = exp(log_b[t, i] - best)
                    alpha[t, i] *= weight[t, i]
                    total += alpha[t, i]
                else:
                    if log_b[t, i] > best + 100.0:
                        doubtful = 1
                    weight[t, i] = 0.0
                    alpha[t, i] = 0.0
            if not total > 0.0:
                doubtful = 1
                break
            for i in range(n):
                alpha[t, i] /= total
                weight[t, i] /= total
            likelihood += log(total) + best
        if not doubtful:
            for i in range(n):
                beta[n_frames - 1, i] = 1.0
            for t in range(n_frames - 1, 0, -1):
                for i in range(n):
                    beta[t - 1, i] = 0.0
                for i in range(n):
                    a = weight[t, i] * beta[t, i]
                    weight[t, i] = a
                    if a != 0.0:
                        for j in range(n):
                            beta[t - 1, j] += a * trans_t[i, j]
    return likelihood, doubtful


def forward_backward_log(const double[:, ::1] log_b, const double[::1] log_start, const double[::1] log_p,
                         const int[::1] source, const int[::1] target, double[:, ::1] gamma,
                         double[:, ::1] counts):
    """The same in logarithms over the possible transitions only: slower when they are many, never underflows.

    Transition k leads from ``source[k]`` to ``target[k]`` with log probability ``log_p[k]``. ``counts`` is
    added to. Returns the log likelihood (minus infinity if no path can have produced the data).
    """
    cdef Py_ssize_t n_frames = log_b.shape[0], n = log_b.shape[1], n_arcs = log_p.shape[0], t, i, k
    cdef double value, likelihood, peak
    import numpy
    cdef double[:, ::1] forward = numpy.empty((n_frames, n))
    cdef double[:, ::1] backward = numpy.zeros((n_frames, n))
    cdef double[::1] top = numpy.empty(n)
    cdef double[::1] total = numpy.empty(n)
    with nogil:
        for i in range(n):
            forward[0, i] = log_start[i] + log_b[0, i]
        for t in range(1, n_frames):
            for i in range(n):
                top[i] = -INFINITY
                total[i] = 0.0
            for k in range(n_arcs):
                value = forward[t - 1, source[k]] + log_p[k]
                if value > top[target[k]]:
                    top[target[k]] = value
            for k in range(n_arcs):
                value = forward[t - 1, source[k]] + log_p[k]
                if value > -INFINITY:
                    total[target[k]] += exp(value - top[target[k]])
            for i in range(n):
                forward[t, i] = -INFINITY
                if total[i] > 0.0:
                    forward[t, i] = top[i] + log(total[i]) + log_b[t, i]
        peak = -INFINITY
        for i in range(n):
            if forward[n_frames - 1, i] > peak:
                peak = forward[n_frames - 1, i]
        likelihood = peak
        if peak > -INFINITY:
            value = 0.0
            for i in range(n):
                value += exp(forward[n_frames - 1, i] - peak)
            likelihood = peak + log(value)
            for t in range(n_frames - 1, 0, -1):
                for i in range(n):
                    top[i] = -INFINITY
                    total[i] = 0.0
                for k in range(n_arcs):
                    value = backward[t, target[k]] + log_p[k] + log_b[t, target[k]]
                    if value > top[source[k]]:
                        top[source[k]] = value
                for k in range(n_arcs):
                    value = backward[t, target[k]] + log_p[k] + log_b[t, target[k]]
                    if value > -INFINITY:
                        total[source[k]] += exp(value - top[source[k]])
                        counts[source[k], target[k]] += exp(value + forward[t - 1, source[k]] - likelihood)
                for i in range(n):
                    backward[t - 1, i] = -INFINITY
                    if total[i] > 0.0:
                        backward[t - 1, i] = top[i] + log(total[i])
            for t in range(n_frames):
                for i in range(n):
                    gamma[t, i] = exp(forward[t, i] + backward[t, i] - likelihood)
    return likelihood


def viterbi_path(const double[:, ::1] log_b, const double[::1] log_start, const double[::1] log_p,
                 const int[::1] source, const int[::1] target, int[::1] path):
    """Fill ``path`` with the most probable states; returns its log probability (with the data)."""
    cdef Py_ssize_t n_frames = log_b.shape[0], n = log_b.shape[1], n_arcs = log_p.shape[0], t, i, k
    cdef double value, best = -INFINITY
    import numpy
    cdef double[::1] score = numpy.empty(n)
    cdef double[::1] new = numpy.empty(n)
    cdef double[::1] swap
    cdef int[:, ::1] origin = numpy.zeros((n_frames, n), dtype=numpy.int32)
    for i in range(n):
        score[i] = log_start[i] + log_b[0, i]
    for t in range(1, n_frames):
        for i in range(n):
            new[i] = -INFINITY
        for k in range(n_arcs):
            value = score[source[k]] + log_p[k]
            if value > new[target[k]]:
                new[target[k]] = value
                origin[t, target[k]] = source[k]
        for i in range(n):
            new[i] += log_b[t, i]
        swap = score
        score = new
        new = swap
    for i in range(n):
        if score[i] > best:
            best = score[i]
            path[n_frames - 1] = i
    if best > -INFINITY:
        for t in range(n_frames - 1, 0, -1):
            path[t - 1] = origin[t, path[t]]
    return best
