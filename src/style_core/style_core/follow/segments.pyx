"""Piecewise polynomials of joint positions: made and replaced once a trajectory, evaluated once a tick."""
from libc.math cimport fabs, sqrt

# peak speed and peak acceleration of the quintic step from 0 to 1 in unit time
cdef double SPEED = 1.875, BEND = 10.0 / sqrt(3.0)
PEAK_SPEED, PEAK_ACCELERATION = SPEED, BEND


cdef inline void write_cubic(double* c, double t, double p0, double v0, double p1, double v1) noexcept nogil:
    cdef double slope = (p1 - p0) / t
    c[0] = p0
    c[1] = v0
    c[2] = (3 * slope - 2 * v0 - v1) / t
    c[3] = (v0 + v1 - 2 * slope) / (t * t)
    c[4] = 0.0
    c[5] = 0.0


cdef inline void write_quintic(double* c, double t, double p0, double v0, double a0, double p1, double v1,
                               double a1) noexcept nogil:
    cdef double half = 0.5 * a0, cube = t * t * t
    cdef double rise = p1 - p0 - (v0 + half * t) * t
    cdef double slope = (v1 - v0 - a0 * t) * t
    cdef double bend = (a1 - a0) * t * t
    c[0] = p0
    c[1] = v0
    c[2] = half
    c[3] = (10 * rise - 4 * slope + 0.5 * bend) / cube
    c[4] = (-15 * rise + 7 * slope - bend) / (cube * t)
    c[5] = (6 * rise - 3 * slope + 0.5 * bend) / (cube * t * t)


cdef inline void look(const double* c, double s, double* p, double* v, double* a) noexcept nogil:
    """Value, rate and acceleration at ``s`` of the polynomial with coefficients ``c``."""
    p[0] = ((((c[5] * s + c[4]) * s + c[3]) * s + c[2]) * s + c[1]) * s + c[0]
    v[0] = (((5.0 * c[5] * s + 4.0 * c[4]) * s + 3.0 * c[3]) * s + 2.0 * c[2]) * s + c[1]
    a[0] = ((20.0 * c[5] * s + 12.0 * c[4]) * s + 6.0 * c[3]) * s + 2.0 * c[2]


def quintics(const double[::1] duration, const double[:, ::1] states, double[:, ::1] coefficients):
    """Write the coefficients (N, 6) of quintics between ``states`` (6, N): p0, v0, a0, p1, v1, a1."""
    cdef Py_ssize_t i
    for i in range(coefficients.shape[0]):
        write_quintic(&coefficients[i, 0], duration[i], states[0, i], states[1, i], states[2, i], states[3, i],
                      states[4, i], states[5, i])


def join(const double[::1] times, const double[:, ::1] positions, const double[:, ::1] velocities,
         const double[:, ::1] accelerations, double coast, double[:, :, ::1] coefficients):
    """Write the coefficients (K - 1, D, 6) of the segments between points: cubics, with accelerations quintics.

    Where ``coefficients`` has one segment more, that one comes to rest within ``coast``.
    """
    cdef Py_ssize_t k, i, n = times.shape[0], d = positions.shape[1]
    cdef double t
    for k in range(n - 1):
        t = times[k + 1] - times[k]
        for i in range(d):
            if accelerations is None:
                write_cubic(&coefficients[k, i, 0], t, positions[k, i], velocities[k, i], positions[k + 1, i],
                            velocities[k + 1, i])
            else:
                write_quintic(&coefficients[k, i, 0], t, positions[k, i], velocities[k, i], accelerations[k, i],
                              positions[k + 1, i], velocities[k + 1, i], accelerations[k + 1, i])
    if coefficients.shape[0] == n:
        for i in range(d):
            write_quintic(&coefficients[n - 1, i, 0], coast, positions[n - 1, i], velocities[n - 1, i], 0.0,
                          positions[n - 1, i] + 0.5 * coast * velocities[n - 1, i], 0.0, 0.0)


cdef bint within(const double* values, Py_ssize_t n, double most) noexcept nogil:
    cdef Py_ssize_t i
    for i in range(n):
        if not fabs(values[i]) < most:      # also where it is NaN
            return False
    return True


def fault_of(const double[::1] times, const double[:, ::1] positions, const double[:, ::1] velocities,
             const double[:, ::1] accelerations, double most, double closest):
    """What is wrong with points: '', the name of the argument with a value not below ``most``, or 'order'.

    'order' where times do not increase by more than ``closest``; velocities and accelerations may be None.
    """
    cdef Py_ssize_t k, n = positions.shape[0] * positions.shape[1]
    if not within(&times[0], times.shape[0], most):
        return 'times'
    if n:
        if not within(&positions[0, 0], n, most):
            return 'positions'
        if velocities is not None and not within(&velocities[0, 0], n, most):
            return 'velocities'
        if accelerations is not None and not within(&accelerations[0, 0], n, most):
            return 'accelerations'
    for k in range(times.shape[0] - 1):
        if times[k + 1] - times[k] <= closest:
            return 'order'
    return ''


cdef Py_ssize_t segment(const double[::1] knots, double time, Py_ssize_t hint) noexcept nogil:
    cdef Py_ssize_t n = knots.shape[0] - 1, k = hint
    if k < 0 or k >= n:
        k = 0
    while k + 1 < n and time >= knots[k + 1]:
        k += 1
    while k > 0 and time < knots[k]:
        k -= 1
    return k


cdef inline void state(const double[::1] knots, const double[:, :, ::1] coefficients, Py_ssize_t k, Py_ssize_t i,
                       double time, double* p, double* v, double* a) noexcept nogil:
    """Of joint ``i`` in segment ``k``; at rest before the first and after the last knot."""
    cdef double s = time - knots[k]
    if s < 0.0:
        look(&coefficients[k, i, 0], 0.0, p, v, a)
        v[0] = a[0] = 0.0
    elif time > knots[k + 1]:
        look(&coefficients[k, i, 0], knots[k + 1] - knots[k], p, v, a)
        v[0] = a[0] = 0.0
    else:
        look(&coefficients[k, i, 0], s, p, v, a)


def decay_between(old, new, double time, const double[:, ::1] fading, double elapsed, double left,
                  const double[::1] position, const double[::1] velocity, const double[::1] limit_v,
                  const double[::1] limit_a, double contradiction, double shortest, double[:, ::1] decay):
    """Write the quintic along which the difference decays when one track takes over from another.

    Parameters
    ----------
    old, new : pair of ndarray
        Knots (K + 1,) and coefficients (K, D, 6) of the tracks; ``old`` is None for a posture.
    time : float
        Of the change, s.
    fading : ndarray, shape (D, 6), or None
        A difference that is still decaying.
    elapsed, left : float
        Time since that began and until it ends, s.
    position, velocity : ndarray, shape (D,)
        The posture where ``old`` is None, rad and rad/s.
    limit_v, limit_a : ndarray, shape (D,)
        The difference decays within them where it can.
    contradiction : float
        What differs in velocity and acceleration by more than so many limits is left out.
    shortest : float
        S.
    decay : ndarray, shape (D, 6)
        Written.

    Returns
    -------
    duration : float
        S.
    """
    cdef const double[::1] old_knots = None, knots = new[0]
    cdef const double[:, :, ::1] old_coefficients = None, coefficients = new[1]
    cdef Py_ssize_t i, k = segment(knots, time, 0), old_k = 0
    cdef double p, v, a, p0, v0, a0, dp, dv, da, lv, la
    cdef double duration = shortest if shortest > left else left
    if old is not None:
        old_knots, old_coefficients = old
        old_k = segment(old_knots, time, 0)
    for i in range(decay.shape[0]):
        lv, la = limit_v[i], limit_a[i]
        state(knots, coefficients, k, i, time, &p, &v, &a)
        if old is None:
            p0, v0, a0 = position[i], velocity[i], 0.0
        else:
            state(old_knots, old_coefficients, old_k, i, time, &p0, &v0, &a0)
        duration = max(duration, SPEED * fabs(p0 - p) / lv)
        duration = max(duration, sqrt(BEND * fabs(p0 - p) / la))
        duration = max(duration, 2.0 * min(fabs(v0 - v), contradiction * lv) / la)
        dp = dv = da = 0.0
        if fading is not None:
            look(&fading[i, 0], elapsed, &dp, &dv, &da)
        decay[i, 0] = p0 + dp - p
        decay[i, 1] = max(-contradiction * lv, min(contradiction * lv, v0 + dv - v))
        decay[i, 2] = max(-contradiction * la, min(contradiction * la, a0 + da - a))
    for i in range(decay.shape[0]):
        write_quintic(&decay[i, 0], duration, decay[i, 0], decay[i, 1], decay[i, 2], 0.0, 0.0, 0.0)
    return duration


def evaluate(const double[::1] knots, const double[:, :, ::1] coefficients, double time, Py_ssize_t hint,
             double[::1] position, double[::1] velocity):
    """Write position and velocity at ``time``; held at rest before the first and after the last knot.

    Parameters
    ----------
    knots : ndarray, shape (K + 1,), increasing
        S.
    coefficients : ndarray, shape (K, D, 6)
        Of the powers 0..5 of the time since the segment's first knot, rad.
    time : float
        S.
    hint : int
        Segment found by the call before (any value is safe); times mostly go forward.
    position, velocity : ndarray, shape (D,)
        Written, rad and rad/s.

    Returns
    -------
    segment : int
    """
    cdef Py_ssize_t i, k = segment(knots, time, hint)
    cdef double bend
    for i in range(coefficients.shape[1]):
        state(knots, coefficients, k, i, time, &position[i], &velocity[i], &bend)
    return k


def add_decay(const double[:, ::1] coefficients, double elapsed, double[::1] position, double[::1] velocity):
    """Add a decaying offset, a quintic of the time since it began (``coefficients``: shape (D, 6)), in place."""
    cdef Py_ssize_t i
    cdef double p, v, a
    for i in range(coefficients.shape[0]):
        look(&coefficients[i, 0], elapsed, &p, &v, &a)
        position[i] += p
        velocity[i] += v


def fade(const double[:, ::1] standing, double elapsed, double duration, double[::1] position, double[::1] velocity):
    """Turn a reference into one that starts from a braking posture: base + s (reference - base), in place.

    s goes from 0 to 1 within ``duration`` as a quintic without speed and acceleration at its ends. The result lies
    between base and reference at every moment.

    Parameters
    ----------
    standing : ndarray, shape (3, D)
        Of the base: position (rad) and velocity (rad/s) at the beginning, and the time (s) in which it comes to rest
        with constant deceleration.
    elapsed, duration : float
        S.
    position, velocity : ndarray, shape (D,)
        Of the reference; rewritten, rad and rad/s.
    """
    cdef Py_ssize_t i
    cdef double x = elapsed / duration, s, slope, t, base, pace
    if x >= 1.0:
        return
    s = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    slope = 30.0 * x * x * (1.0 - x) * (1.0 - x) / duration
    for i in range(position.shape[0]):
        t = min(elapsed, standing[2, i])
        base = standing[0, i]
        pace = 0.0
        if t > 0.0:
            base += standing[1, i] * t * (1.0 - 0.5 * t / standing[2, i])
            pace = standing[1, i] * (1.0 - t / standing[2, i])
        elif elapsed <= 0.0:
            pace = standing[1, i]
        velocity[i] = pace + s * (velocity[i] - pace) + slope * (position[i] - base)
        position[i] = base + s * (position[i] - base)
