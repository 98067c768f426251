"""The trajectory within velocity and acceleration limits that is nearest to a given one, joint by joint."""
from libc.math cimport fabs, sqrt


cdef inline double between(double low, double value, double high) noexcept nogil:
    return low if value < low else (high if value > high else value)


cdef inline double fastest(double gap, double step, double bend) noexcept nogil:
    """Largest velocity at the end of a step that still lets a joint stop before a limit.

    ``gap`` is what is left to the limit, less half a step at the old velocity; braking from v in whole steps takes at
    most v^2 / (2 bend) + v step / 2.
    """
    if gap < 0:
        return 2.0 * gap / step
    return bend * (sqrt(step * step + 2.0 * gap / bend) - step)


def plan(const double[:, ::1] solve, const double[:, ::1] pull, const double[::1] steps, const double[::1] begin,
         const double[::1] velocity, const double[::1] acceleration, double scale, double rho, int iterations,
         double tolerance, double[:, ::1] x, double[:, ::1] y):
    """Minimise 1/2 x'Hx + pull'x over velocities within limits (alternating directions, over-relaxed).

    Parameters
    ----------
    solve : ndarray, shape (N, N)
        Inverse of H + rho C'C; C takes velocities at the nodes to themselves and to ``scale`` times accelerations.
    pull : ndarray, shape (J, N)
    steps : ndarray, shape (N,)
        Time between nodes, s.
    begin, velocity, acceleration : ndarray, shape (J,)
        Velocity at the first node, and limits; rad/s, rad/s^2.
    scale : float
        S.
    rho : float
    iterations : int
        At most.
    tolerance : float
        Of velocities, as a fraction of the tighter limit.
    x : ndarray, shape (J, N)
        In: a guess; out: velocities at the nodes after the first, nearly within the limits.
    y : ndarray, shape (J, 2 N)
        Multipliers; in and out.

    Returns
    -------
    iterations : int
        The most that a joint took.
    """
    cdef Py_ssize_t j, k, i, n = steps.shape[0], most = 0
    cdef int turn
    cdef double v, a, before, own, mixed, kept, wrong, moved, total
    cdef double[::1] z = _zeros(2 * n), right = _zeros(n)
    for j in range(x.shape[0]):
        v, a = velocity[j], scale * acceleration[j]
        before = begin[j]
        for k in range(n):
            z[k] = between(-v, x[j, k], v)
            z[n + k] = between(-a, scale * (x[j, k] - before) / steps[k], a)
            before = x[j, k]
        for turn in range(iterations):
            for k in range(n):
                right[k] = -pull[j, k] + rho * z[k] - y[j, k]
            for k in range(n):
                own = rho * z[n + k] - y[j, n + k]
                if k == 0:
                    own += rho * scale * begin[j] / steps[0]
                else:
                    right[k - 1] -= own * scale / steps[k]
                right[k] += own * scale / steps[k]
            for k in range(n):
                total = 0.0
                for i in range(n):
                    total += solve[k, i] * right[i]
                x[j, k] = total
            wrong = moved = 0.0
            before = begin[j]
            for k in range(n):
                for i in range(2):
                    own = x[j, k] if i == 0 else scale * (x[j, k] - before) / steps[k]
                    mixed = 1.6 * own - 0.6 * z[i * n + k]
                    kept = mixed + y[j, i * n + k] / rho
                    kept = between(-v, kept, v) if i == 0 else between(-a, kept, a)
                    y[j, i * n + k] += rho * (mixed - kept)
                    wrong = max(wrong, fabs(own - kept))
                    moved = max(moved, fabs(kept - z[i * n + k]))
                    z[i * n + k] = kept
                before = x[j, k]
            if wrong < tolerance * min(v, a) and moved < tolerance * min(v, a):
                break
        most = max(most, turn + 1)
    return most


cdef double[::1] _zeros(Py_ssize_t n):
    from array import array
    return array('d', bytes(8 * n))


def obey(const double[::1] steps, const double[:, ::1] wanted, const double[::1] velocity,
         const double[::1] acceleration, const double[::1] lower, const double[::1] upper, double[:, ::1] positions,
         double[:, ::1] velocities):
    """Go as ``wanted``, a step after the other with constant acceleration in each, but never outside the limits.

    Parameters
    ----------
    steps : ndarray, shape (N,)
    wanted : ndarray, shape (J, N)
        Velocities after each step, rad/s.
    velocity, acceleration, lower, upper : ndarray, shape (J,)
    positions, velocities : ndarray, shape (J, N + 1)
        Column 0 is given, the others are written; rad and rad/s.
    """
    cdef Py_ssize_t j, k, n = steps.shape[0]
    cdef double h, v, a, base, u, low, high
    for j in range(positions.shape[0]):
        v, a = velocity[j], acceleration[j]
        for k in range(n):
            h, u = steps[k], velocities[j, k]
            base = positions[j, k] + 0.5 * h * u
            low = -fastest(base - lower[j], h, a)
            high = fastest(upper[j] - base, h, a)
            u = between(u - a * h, between(-v, between(low, wanted[j, k], high), v), u + a * h)
            velocities[j, k + 1] = u
            positions[j, k + 1] = base + 0.5 * h * u
