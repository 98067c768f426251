"""Rotation kernels of `JointSpace`: Euler angles to rotation vectors about a home rotation and back, with rates.

Of a ball joint, angles (x, y, z) and an order (first, second, third axis about which it turns, fixed axes) give the
rotation ``R = R_third R_second R_first``. Its coordinates q are those of the rotation vector of ``home^T R`` in the
frame F: ``R = home exp(F q)``.
"""
from libc.math cimport NAN, atan2, cos, fabs, isfinite, rint, sin, sqrt

__all__ = ['encode', 'decode']

cdef double PI = 3.141592653589793
cdef double TWO_PI = 6.283185307179586
#: angles beyond this are no pose of a joint, rad
cdef double MOST = 12.566370614359172
#: nearer to the gimbal lock the rates of the outer angles are those at this distance from it (sine)
cdef double LOCK = 0.02


cdef inline void turn_left(double* r, int axis, double angle) noexcept nogil:
    """r := rotation about a fixed axis times r (3 x 3, by rows)."""
    cdef int column, one = 3 * ((axis + 1) % 3), two = 3 * ((axis + 2) % 3)
    cdef double s = sin(angle), c = cos(angle), a
    for column in range(3):
        a = r[one + column]
        r[one + column] = c * a - s * r[two + column]
        r[two + column] = s * a + c * r[two + column]


cdef inline void product(const double* a, const double* b, double* out) noexcept nogil:
    cdef int i, j
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j]


cdef inline void left_transposed(const double* a, const double* b, double* out) noexcept nogil:
    """out := a^T b."""
    cdef int i, j
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = a[i] * b[j] + a[3 + i] * b[3 + j] + a[6 + i] * b[6 + j]


cdef inline void matrix_of(const double* angles, const int* order, double* r) noexcept nogil:
    cdef int k
    for k in range(9):
        r[k] = 1.0 if k % 4 == 0 else 0.0
    for k in range(3):
        turn_left(r, order[k], angles[order[k]])


cdef inline void vector_of(const double* r, double* v) noexcept nogil:
    """Rotation vector of a matrix, at most half a turn long, by the quaternion with the largest pivot."""
    cdef double q[4]
    cdef double trace = r[0] + r[4] + r[8], largest, length, angle, factor
    cdef int i = 0, j, k
    if trace > r[0] and trace > r[4] and trace > r[8]:
        q[0], q[1], q[2], q[3] = 1.0 + trace, r[7] - r[5], r[2] - r[6], r[3] - r[1]
    else:
        if r[4] > r[0]:
            i = 1
        if r[8] > r[4 * i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        largest = 1.0 + r[4 * i] - r[4 * j] - r[4 * k]
        q[0] = r[3 * k + j] - r[3 * j + k]
        q[1 + i] = largest
        q[1 + j] = r[3 * j + i] + r[3 * i + j]
        q[1 + k] = r[3 * k + i] + r[3 * i + k]
    if q[0] < 0:
        for k in range(4):
            q[k] = -q[k]
    length = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    angle = 2.0 * atan2(length, q[0])
    factor = angle / length if length > 1e-300 else 0.0
    for k in range(3):
        v[k] = factor * q[1 + k]


cdef inline void exponential(const double* v, double* r) noexcept nogil:
    cdef double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], angle = sqrt(square), one, two, half
    cdef int i, j
    if angle < 1e-4:  # series, exact to rounding here
        one, two = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        half = sin(0.5 * angle)
        one, two = sin(angle) / angle, 2.0 * half * half / square
    for i in range(3):
        for j in range(3):
            r[3 * i + j] = two * v[i] * v[j]
        r[4 * i] += 1.0 - two * square
    r[1] -= one * v[2]
    r[3] += one * v[2]
    r[2] += one * v[1]
    r[6] -= one * v[1]
    r[5] -= one * v[0]
    r[7] += one * v[0]


cdef inline void right_jacobian(const double* v, double* jacobian) noexcept nogil:
    """Angular velocity in the turned frame by rate of the rotation vector."""
    cdef double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], angle = sqrt(square), two, three, half
    cdef int i, j
    if angle < 1e-3:
        two, three = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        half = sin(0.5 * angle)
        two, three = 2.0 * half * half / square, (angle - sin(angle)) / (square * angle)
    for i in range(3):
        for j in range(3):
            jacobian[3 * i + j] = three * v[i] * v[j]
        jacobian[4 * i] += 1.0 - three * square
    jacobian[1] += two * v[2]
    jacobian[3] -= two * v[2]
    jacobian[2] -= two * v[1]
    jacobian[6] += two * v[1]
    jacobian[5] += two * v[0]
    jacobian[7] -= two * v[0]


cdef inline double nearest_turn(double angle, double near) noexcept nogil:
    return angle + TWO_PI * rint((near - angle) / TWO_PI)


cdef void angles_of(const double* r, const int* order, const double* near, double* angles) noexcept nogil:
    """Of all angles that give the rotation, those nearest to ``near``."""
    cdef int i = order[0], j = order[1], k = order[2]
    cdef double sign = 1.0 if (j - i + 3) % 3 == 1 else -1.0
    cdef double across = sqrt(r[3 * i + i] * r[3 * i + i] + r[3 * j + i] * r[3 * j + i])
    cdef double first, second, third, one = 0.0, other = 0.0, rest[9]
    cdef double turned[3]
    cdef int n
    second = sign * atan2(-r[3 * k + i], across)
    if across > 1e-8:
        first = sign * atan2(r[3 * k + j], r[3 * k + k])
        third = sign * atan2(r[3 * j + i], r[3 * i + i])
    else:  # the first angle may be chosen: it stays, and the third follows
        first = near[i]
        for n in range(9):
            rest[n] = 1.0 if n % 4 == 0 else 0.0
        turn_left(rest, i, first)
        turn_left(rest, j, second)
        # R_third = R rest^T; only the entries that hold its sine and cosine
        third = sign * atan2(r[3 * j] * rest[3 * i] + r[3 * j + 1] * rest[3 * i + 1] + r[3 * j + 2] * rest[3 * i + 2],
                             r[3 * i] * rest[3 * i] + r[3 * i + 1] * rest[3 * i + 1] + r[3 * i + 2] * rest[3 * i + 2])
    angles[i], angles[j], angles[k] = first, second, third
    turned[i], turned[j], turned[k] = first + PI, PI - second, third + PI
    for n in range(3):
        angles[n] = nearest_turn(angles[n], near[n])
        turned[n] = nearest_turn(turned[n], near[n])
        one += (angles[n] - near[n]) * (angles[n] - near[n])
        other += (turned[n] - near[n]) * (turned[n] - near[n])
    if other < one:
        for n in range(3):
            angles[n] = turned[n]


cdef void rates_of(const double* angles, const int* order, const double* frame, const double* v,
                   double* jacobian) noexcept nogil:
    """Rates of the angles by rates of the coordinates; v = frame q."""
    cdef double axes[9]
    cdef double inverse[9]
    cdef double turned[9]
    cdef double determinant
    cdef int n, row, i, j
    # columns: what each angle's rate does to the angular velocity in the body's frame
    for n in range(9):
        turned[n] = 1.0 if n % 4 == 0 else 0.0
    for n in range(3):
        for row in range(3):
            axes[3 * row + order[n]] = turned[3 * order[n] + row]
        turn_left(turned, order[n], angles[order[n]])
    for i in range(3):
        for j in range(3):
            inverse[3 * j + i] = (axes[3 * ((i + 1) % 3) + (j + 1) % 3] * axes[3 * ((i + 2) % 3) + (j + 2) % 3]
                                  - axes[3 * ((i + 1) % 3) + (j + 2) % 3] * axes[3 * ((i + 2) % 3) + (j + 1) % 3])
    determinant = axes[0] * inverse[0] + axes[1] * inverse[3] + axes[2] * inverse[6]
    if fabs(determinant) < LOCK:
        determinant = LOCK if determinant >= 0 else -LOCK
    for n in range(9):
        inverse[n] /= determinant
    right_jacobian(v, axes)
    product(inverse, axes, turned)
    product(turned, frame, jacobian)


def encode(const double[:, ::1] angles, const int[:, ::1] columns, const int[:, ::1] orders,
           const double[:, :, ::1] homes, const double[:, :, ::1] frames, double[:, ::1] out):
    """Coordinates of ball joints.

    Parameters
    ----------
    angles : memoryview, shape (T, D)
        Rad.
    columns : memoryview of int, shape (K, 3)
        Of each joint's angles about x, y and z.
    orders : memoryview of int, shape (K, 3)
        Axes (0, 1, 2) in the order in which it turns.
    homes, frames : memoryview, shape (K, 3, 3)
    out : memoryview, shape (T, D)
        Columns of ball joints are written; NaN where an angle is not finite or beyond two turns.
    """
    cdef Py_ssize_t t, k
    cdef int n, whole
    cdef double triple[3]
    cdef double r[9]
    cdef double relative[9]
    cdef double v[3]
    with nogil:
        for t in range(angles.shape[0]):
            for k in range(columns.shape[0]):
                whole = 1
                for n in range(3):
                    triple[n] = angles[t, columns[k, n]]
                    if not (fabs(triple[n]) <= MOST):
                        whole = 0
                if not whole:
                    for n in range(3):
                        out[t, columns[k, n]] = NAN
                    continue
                matrix_of(triple, &orders[k, 0], r)
                left_transposed(&homes[k, 0, 0], r, relative)
                vector_of(relative, v)
                for n in range(3):
                    out[t, columns[k, n]] = (frames[k, 0, n] * v[0] + frames[k, 1, n] * v[1] + frames[k, 2, n] * v[2])


def decode(const double[:, ::1] values, const int[:, ::1] columns, const int[:, ::1] orders,
           const double[:, :, ::1] homes, const double[:, :, ::1] frames, double[::1] near, double[:, ::1] out,
           double[:, ::1] std=None, double[:, ::1] velocity=None):
    """Angles of ball joints, each row's nearest to the row's before it; the first row's nearest to ``near``.

    Parameters
    ----------
    values : memoryview, shape (T, D)
        Coordinates, rad.
    near : memoryview, shape (D,)
        Rad; holds the last row's angles afterwards.
    out : memoryview, shape (T, D)
        Columns of ball joints are written.
    std, velocity : memoryview, shape (T, D), optional
        Standard deviations (at most half a turn afterwards) and rates of the coordinates; those of the angles
        afterwards, to first order.
    """
    cdef Py_ssize_t t, k
    cdef int n, m
    cdef double v[3]
    cdef double r[9]
    cdef double turned[9]
    cdef double here[3]
    cdef double angles[3]
    cdef double given[3]
    cdef double jacobian[9]
    cdef double total
    with nogil:
        for t in range(values.shape[0]):
            for k in range(columns.shape[0]):
                for n in range(3):
                    v[n] = (frames[k, n, 0] * values[t, columns[k, 0]] + frames[k, n, 1] * values[t, columns[k, 1]]
                            + frames[k, n, 2] * values[t, columns[k, 2]])
                    here[n] = near[columns[k, n]]
                if not (isfinite(v[0]) and isfinite(v[1]) and isfinite(v[2])):
                    for n in range(3):
                        out[t, columns[k, n]] = NAN
                        if std is not None:
                            std[t, columns[k, n]] = NAN
                        if velocity is not None:
                            velocity[t, columns[k, n]] = NAN
                    continue
                exponential(v, turned)
                product(&homes[k, 0, 0], turned, r)
                angles_of(r, &orders[k, 0], here, angles)
                for n in range(3):
                    out[t, columns[k, n]] = angles[n]
                    near[columns[k, n]] = angles[n]
                if std is None and velocity is None:
                    continue
                rates_of(angles, &orders[k, 0], &frames[k, 0, 0], v, jacobian)
                if std is not None:
                    for n in range(3):
                        given[n] = std[t, columns[k, n]]
                    for n in range(3):
                        total = 0.0
                        for m in range(3):
                            total += jacobian[3 * n + m] * jacobian[3 * n + m] * given[m] * given[m]
                        std[t, columns[k, n]] = PI if total > PI * PI else sqrt(total)
                if velocity is not None:
                    for n in range(3):
                        given[n] = velocity[t, columns[k, n]]
                    for n in range(3):
                        velocity[t, columns[k, n]] = (jacobian[3 * n] * given[0] + jacobian[3 * n + 1] * given[1]
                                                      + jacobian[3 * n + 2] * given[2])
