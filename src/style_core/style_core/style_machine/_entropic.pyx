"""Maximum a posteriori multinomials under an entropic prior: the Lambert-W fix point, one row at a time."""
from libc.math cimport exp, log, sqrt, fabs


cdef double upper_w(double c) noexcept nogil:
    """Solve w - log w = c for w >= 1 (c >= 1): minus the lower branch of Lambert's W at -exp(-c)."""
    cdef double w, step
    cdef int k
    if c <= 1.0:
        return 1.0
    w = 1.0 + sqrt(2.0 * (c - 1.0)) + (c - 1.0) if c < 3.0 else c + log(c)
    for k in range(50):
        step = w * (w - log(w) - c) / (w - 1.0)
        w -= step
        if w < 1.0:
            w = 1.0 + 1e-15
        if fabs(step) <= 1e-15 * w:
            break
    return w


cdef double positive_w(double c) noexcept nogil:
    """Solve w + log w = c for w > 0: Lambert's W at exp(c)."""
    cdef double w, step
    cdef int k
    w = c - log(c) if c > 2.0 else exp(c) if c < -2.0 else 1.0 + 0.5 * (c - 1.0)
    if w <= 0.0:
        w = 1e-3
    for k in range(50):
        step = w * (w + log(w) - c) / (w + 1.0)
        if step >= w:
            step = 0.5 * w
        w -= step
        if fabs(step) <= 1e-15 * w:
            break
    return w


cdef double cold_sum(const double[::1] counts, double z, double top, double u, double[::1] row) noexcept nogil:
    """Fill ``row`` for a positive exponent; u is -W of the largest count (below 1: the principal branch)."""
    cdef Py_ssize_t i
    cdef double total = 0.0, base = u - log(u) + log(top)
    cdef int largest = 1
    for i in range(counts.shape[0]):
        if counts[i] <= 0.0:
            row[i] = 0.0
        elif largest and counts[i] == top:
            row[i] = top / (z * u)
            largest = 0
        else:
            row[i] = counts[i] / (z * upper_w(base - log(counts[i])))
        total += row[i]
    return total


cdef double hot_sum(const double[::1] counts, double strength, double s, double[::1] row) noexcept nogil:
    """Fill ``row`` for a negative exponent -strength and multiplier lambda = s * strength."""
    cdef Py_ssize_t i
    cdef double total = 0.0
    for i in range(counts.shape[0]):
        if counts[i] > 0.0:
            row[i] = counts[i] / (strength * positive_w(log(counts[i] / strength) + 1.0 + s))
        else:
            row[i] = exp(-s - 1.0)
        total += row[i]
    return total


def entropic_row(const double[::1] counts, double z, double[::1] row):
    """Maximise sum(counts * log p) + z * sum(p * log p) over the simplex; fills ``row`` (left alone if no counts)."""
    cdef Py_ssize_t i, n = counts.shape[0]
    cdef double total = 0.0, top = 0.0, low, high, middle, value
    cdef int k
    with nogil:
        for i in range(n):
            total += counts[i]
            if counts[i] > top:
                top = counts[i]
        if total > 0.0:
            if fabs(z) < 1e-9 * total:
                for i in range(n):
                    row[i] = counts[i] / total
            else:
                if z > 0.0:  # the sum falls as u rises
                    low = top / z
                    high = total / z if total > z else 1.0
                    if low > high:
                        low = high
                else:
                    low = log(<double>n) - 1.0
                    high = top * n / -z + low
                for k in range(200):
                    middle = 0.5 * (low + high)
                    value = cold_sum(counts, z, top, middle, row) if z > 0.0 else hot_sum(counts, -z, middle, row)
                    if value > 1.0:
                        low = middle
                    else:
                        high = middle
                    if fabs(value - 1.0) < 1e-14 or high - low <= 1e-16 * fabs(high):
                        break
                value = 0.0
                for i in range(n):
                    value += row[i]
                for i in range(n):
                    row[i] /= value
