"""Block-tridiagonal systems of the most likely trajectory: elimination and back-substitution, one small block a frame."""
from style_core.small_matrices cimport cholesky, cholesky_solve


cdef void solve_matrix(const double[:, ::1] low, double[:, ::1] x, Py_ssize_t n) noexcept nogil:
    """Solve for n right-hand sides standing in the columns of x (rows are contiguous: inner loops vectorise)."""
    cdef Py_ssize_t i, j, k
    cdef double a
    for i in range(n):
        for k in range(i):
            a = low[i, k]
            for j in range(n):
                x[i, j] -= a * x[k, j]
        a = 1.0 / low[i, i]
        for j in range(n):
            x[i, j] *= a
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            a = low[k, i]
            for j in range(n):
                x[i, j] -= a * x[k, j]
        a = 1.0 / low[i, i]
        for j in range(n):
            x[i, j] *= a


cdef int eliminate(double[:, ::1] s, double[::1] r, const double[:, ::1] own, const double[:, ::1] cross,
                   const double[:, ::1] previous, double[:, ::1] w, double[::1] h, double[:, ::1] low,
                   Py_ssize_t n) noexcept nogil:
    """Take in one frame. (s, r): information about the frame before, overwritten by that about the new one.

    ``r`` comes with the right-hand side of the frame before complete and leaves without the new frame's own part.
    The frame before is then h + w @ (new frame).
    """
    cdef Py_ssize_t i, j, k
    cdef double a
    for i in range(n):
        h[i] = r[i]
        for j in range(n):
            low[i, j] = s[i, j] + previous[i, j]
            w[i, j] = cross[j, i]
    if cholesky(&low[0, 0], <int>n):
        return 1
    cholesky_solve(&low[0, 0], &h[0], <int>n)
    solve_matrix(low, w, n)
    for i in range(n):
        for j in range(n):
            s[i, j] = own[i, j]
        r[i] = 0.0
        for k in range(n):
            a = cross[i, k]
            r[i] += a * h[k]
            for j in range(n):
                s[i, j] -= a * w[k, j]
    return 0


def solve_trajectory(const double[:, :, ::1] own, const double[:, :, ::1] cross, const double[:, :, ::1] previous,
                     const int[::1] index, const double[:, ::1] first, double[:, ::1] rhs, double[:, :, ::1] w,
                     double[:, ::1] low, double[:, ::1] s, double[::1] r):
    """Solve in place of ``rhs`` (T, n). Frame t > 0 uses the blocks ``index[t]``; frame 0 has own block ``first``.

    ``w`` (T, n, n), ``low``, ``s`` (n, n) and ``r`` (n,) are scratch. Returns 1 if the system is not definite.
    """
    cdef Py_ssize_t n_frames = rhs.shape[0], n = rhs.shape[1], t, i, k
    cdef int failed = 0
    with nogil:
        for i in range(n):
            r[i] = rhs[0, i]
            for k in range(n):
                s[i, k] = first[i, k]
        for t in range(1, n_frames):
            if eliminate(s, r, own[index[t]], cross[index[t]], previous[index[t]], w[t], rhs[t - 1], low, n):
                failed = 1
                break
            for i in range(n):
                r[i] += rhs[t, i]
        if not failed:
            for i in range(n):
                for k in range(n):
                    low[i, k] = s[i, k]
            failed = cholesky(&low[0, 0], <int>n)
            if not failed:
                cholesky_solve(&low[0, 0], &r[0], <int>n)
                for i in range(n):
                    rhs[n_frames - 1, i] = r[i]
                for t in range(n_frames - 1, 0, -1):
                    for i in range(n):
                        for k in range(n):
                            rhs[t - 1, i] += w[t, i, k] * rhs[t, k]
    return failed


def solve_scalars(const double[:, ::1] own, const double[:, ::1] cross, const double[:, ::1] previous,
                  const int[::1] index, const double[::1] first, double[:, ::1] rhs, double[:, ::1] w, double[::1] s):
    """The same for m independent scalar systems side by side: ``own`` and the others (M, m), ``rhs`` (T, m)."""
    cdef Py_ssize_t n_frames = rhs.shape[0], m = rhs.shape[1], t, i, j
    cdef double d
    with nogil:
        for i in range(m):
            s[i] = first[i]
        for t in range(1, n_frames):
            j = index[t]
            for i in range(m):
                d = s[i] + previous[j, i]
                rhs[t - 1, i] /= d
                w[t, i] = cross[j, i] / d
                s[i] = own[j, i] - cross[j, i] * w[t, i]
                rhs[t, i] += cross[j, i] * rhs[t - 1, i]
        for i in range(m):
            rhs[n_frames - 1, i] /= s[i]
        for t in range(n_frames - 1, 0, -1):
            for i in range(m):
                rhs[t - 1, i] += w[t, i] * rhs[t, i]


def push_frame(double[:, ::1] s, double[::1] r, double[::1] s_tail, double[::1] r_tail,
               const double[:, ::1] own, const double[:, ::1] cross, const double[:, ::1] previous,
               const double[::1] ahead, const double[::1] behind,
               const double[::1] own_tail, const double[::1] cross_tail, const double[::1] previous_tail,
               const double[::1] ahead_tail, const double[::1] behind_tail,
               double[:, :, ::1] w, double[:, ::1] h, double[:, ::1] w_tail, double[:, ::1] h_tail,
               Py_ssize_t slot, double[:, ::1] low):
    """Take one frame into a running elimination; the way back to the frame before goes into ring slot ``slot``."""
    cdef Py_ssize_t n = r.shape[0], m = r_tail.shape[0], i
    cdef double d
    for i in range(n):
        r[i] -= behind[i]
    if eliminate(s, r, own, cross, previous, w[slot], h[slot], low, n):
        return 1
    for i in range(n):
        r[i] += ahead[i]
    for i in range(m):
        d = s_tail[i] + previous_tail[i]
        h_tail[slot, i] = (r_tail[i] - behind_tail[i]) / d
        w_tail[slot, i] = cross_tail[i] / d
        s_tail[i] = own_tail[i] - cross_tail[i] * w_tail[slot, i]
        r_tail[i] = ahead_tail[i] + cross_tail[i] * h_tail[slot, i]
    return 0


def look_back(const double[:, ::1] s, const double[::1] r, const double[::1] s_tail, const double[::1] r_tail,
              const double[:, :, ::1] w, const double[:, ::1] h, const double[:, ::1] w_tail,
              const double[:, ::1] h_tail, Py_ssize_t slot, Py_ssize_t steps, double[:, ::1] low, double[::1] x,
              double[:, ::1] out):
    """Most likely frames ``steps`` back given all up to now; ``out`` (2, n + m): that frame, and the one after it."""
    cdef Py_ssize_t n = r.shape[0], m = r_tail.shape[0], size = h.shape[0], i, k, step, j
    for i in range(n):
        x[i] = r[i]
        for k in range(n):
            low[i, k] = s[i, k]
    if cholesky(&low[0, 0], <int>n):
        return 1
    cholesky_solve(&low[0, 0], &x[0], <int>n)
    for i in range(n):
        out[0, i] = x[i]
    for i in range(m):
        out[0, n + i] = r_tail[i] / s_tail[i]
    for step in range(steps):
        j = (slot - step + size) % size
        for i in range(n + m):
            out[1, i] = out[0, i]
        for i in range(n):
            out[0, i] = h[j, i]
            for k in range(n):
                out[0, i] += w[j, i, k] * out[1, k]
        for i in range(m):
            out[0, n + i] = h_tail[j, i] + w_tail[j, i] * out[1, n + i]
    return 0
