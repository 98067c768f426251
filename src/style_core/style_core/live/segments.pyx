# cython: language_level=3
"""Evaluation of piecewise polynomials of joint positions: one call a tick."""


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
    cdef Py_ssize_t n = coefficients.shape[0], d = coefficients.shape[1], i, k = hint
    cdef double s, rest = 1.0
    if k < 0 or k >= n:
        k = 0
    while k + 1 < n and time >= knots[k + 1]:
        k += 1
    while k > 0 and time < knots[k]:
        k -= 1
    s = time - knots[k]
    if s < 0.0:
        s = 0.0
        rest = 0.0
    elif time > knots[k + 1]:
        s = knots[k + 1] - knots[k]
        rest = 0.0
    for i in range(d):
        position[i] = ((((coefficients[k, i, 5] * s + coefficients[k, i, 4]) * s + coefficients[k, i, 3]) * s
                        + coefficients[k, i, 2]) * s + coefficients[k, i, 1]) * s + coefficients[k, i, 0]
        velocity[i] = rest * ((((5.0 * coefficients[k, i, 5] * s + 4.0 * coefficients[k, i, 4]) * s
                                + 3.0 * coefficients[k, i, 3]) * s + 2.0 * coefficients[k, i, 2]) * s
                              + coefficients[k, i, 1])
    return k


def add_decay(const double[:, ::1] coefficients, double elapsed, double[::1] position, double[::1] velocity):
    """Add a decaying offset, a quintic of the time since it began (``coefficients``: shape (D, 6)), in place."""
    cdef Py_ssize_t i
    cdef double s = elapsed
    for i in range(coefficients.shape[0]):
        position[i] += ((((coefficients[i, 5] * s + coefficients[i, 4]) * s + coefficients[i, 3]) * s
                         + coefficients[i, 2]) * s + coefficients[i, 1]) * s + coefficients[i, 0]
        velocity[i] += ((((5.0 * coefficients[i, 5] * s + 4.0 * coefficients[i, 4]) * s
                          + 3.0 * coefficients[i, 3]) * s + 2.0 * coefficients[i, 2]) * s + coefficients[i, 1])


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
