"""Small dense matrices, row by row in memory: Cholesky factor, solution and inverse."""
from libc.math cimport log, sqrt


cdef inline int cholesky(double* a, int n) noexcept nogil:
    """Lower Cholesky factor in place of the symmetric (n, n) ``a``; 1 if it is not positive definite."""
    cdef int i, j, k
    cdef double total
    for j in range(n):
        total = a[j * n + j]
        for k in range(j):
            total -= a[j * n + k] * a[j * n + k]
        if not total > 0:
            return 1
        a[j * n + j] = sqrt(total)
        for i in range(j + 1, n):
            total = a[i * n + j]
            for k in range(j):
                total -= a[i * n + k] * a[j * n + k]
            a[i * n + j] = total / a[j * n + j]
        for i in range(j):
            a[i * n + j] = 0
    return 0


cdef inline void cholesky_solve(const double* factor, double* b, int n) noexcept nogil:
    """Solve in place with a lower Cholesky factor."""
    cdef int i, k
    for i in range(n):
        for k in range(i):
            b[i] -= factor[i * n + k] * b[k]
        b[i] /= factor[i * n + i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= factor[k * n + i] * b[k]
        b[i] /= factor[i * n + i]


cdef inline double cholesky_inverse(const double* factor, double* out, int n) noexcept nogil:
    """Inverse of the matrix with a lower Cholesky factor, symmetric to the bit; returns the log of its determinant."""
    cdef int i, j, k
    cdef double total, over, logs = 0
    for i in range(n):  # the factor's inverse
        logs -= 2 * log(factor[i * n + i])
        over = 1 / factor[i * n + i]
        for j in range(i):
            total = 0
            for k in range(j, i):
                total += factor[i * n + k] * out[k * n + j]
            out[i * n + j] = -total * over
        out[i * n + i] = over
    for i in range(n):  # its transpose times itself, above the diagonal
        for j in range(n - 1, i - 1, -1):
            total = 0
            for k in range(j, n):
                total += out[k * n + i] * out[k * n + j]
            out[i * n + j] = total
    for i in range(n):
        for j in range(i):
            out[i * n + j] = out[j * n + i]
    return logs
