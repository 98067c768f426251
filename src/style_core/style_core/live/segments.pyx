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
