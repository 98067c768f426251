"""Rotation kernels of `JointSpace`: Euler angles to rotation vectors about a home rotation and back, with rates.

Of a ball joint, angles (x, y, z) and an order (first, second, third axis about which it turns, fixed axes) give the
rotation ``R = R_third R_second R_first``. Its coordinates q are those of the rotation vector of ``home^T R`` in the
frame F: ``R = home exp(F q)``.
"""
import numpy as np

from libc.math cimport NAN, atan2, cos, fabs, isfinite, rint, sin, sqrt

__all__ = ['Border', 'encode', 'decode']

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


cdef inline void exponential(const double* v, double* r, double* jacobian) noexcept nogil:
    """Rotation of a vector, and the angular velocity in the turned frame by the rate of the vector."""
    cdef double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], angle = sqrt(square), one, two, three, s, half
    cdef int i, j
    if angle < 1e-3:  # series, exact to rounding here
        one, two, three = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        half = sin(0.5 * angle)
        s = sin(angle)
        one, two, three = s / angle, 2.0 * half * half / square, (angle - s) / (square * angle)
    for i in range(3):
        for j in range(3):
            r[3 * i + j] = two * v[i] * v[j]
            jacobian[3 * i + j] = three * v[i] * v[j]
        r[4 * i] += 1.0 - two * square
        jacobian[4 * i] += 1.0 - three * square
    for i in range(3):
        j = (i + 1) % 3
        r[3 * i + j] -= one * v[3 - i - j]
        r[3 * j + i] += one * v[3 - i - j]
        jacobian[3 * i + j] += two * v[3 - i - j]
        jacobian[3 * j + i] -= two * v[3 - i - j]


cdef inline double nearest_turn(double angle, double near) noexcept nogil:
    return angle + TWO_PI * rint((near - angle) / TWO_PI)


cdef void angles_of(const double* r, const int* order, const double* near, double* angles, double* trig) noexcept nogil:
    """Of all angles that give the rotation, those nearest to ``near``; and s sin(first), cos(first), s sin(second),
    cos(second) of them, s = -1 for a left-handed order."""
    cdef int i = order[0], j = order[1], k = order[2]
    cdef double sign = 1.0 if (j - i + 3) % 3 == 1 else -1.0
    cdef double across = sqrt(r[3 * i + i] * r[3 * i + i] + r[3 * j + i] * r[3 * j + i])
    cdef double first, second, third, one = 0.0, other = 0.0
    cdef double turned[3]
    cdef double rest[9]
    cdef int n
    trig[2], trig[3] = -r[3 * k + i], across
    second = sign * atan2(trig[2], across)
    if across > 1e-8:
        trig[0], trig[1] = r[3 * k + j] / across, r[3 * k + k] / across
        first = sign * atan2(r[3 * k + j], r[3 * k + k])
        third = sign * atan2(r[3 * j + i], r[3 * i + i])
    else:  # the first angle may be chosen: it stays, and the third follows
        first = near[i]
        trig[0], trig[1] = sign * sin(first), cos(first)
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
        trig[0], trig[1], trig[3] = -trig[0], -trig[1], -trig[3]


cdef inline void rates_of(const double* trig, const int* order, const double* moved, double* jacobian) noexcept nogil:
    """Rates of the angles by rates of the coordinates; ``moved`` is the angular velocity in the body by the latter.

    The angular velocity is e_i a' + R_i^T e_j b' + R_i^T R_j^T e_k c' for the angles a, b, c of the order i, j, k.
    """
    cdef int n, i = order[0], j = order[1], k = order[2]
    cdef double bottom = trig[3]
    if fabs(bottom) < LOCK:
        bottom = LOCK if bottom >= 0 else -LOCK
    for n in range(3):
        jacobian[3 * k + n] = (trig[0] * moved[3 * j + n] + trig[1] * moved[3 * k + n]) / bottom
        jacobian[3 * j + n] = trig[1] * moved[3 * j + n] - trig[0] * moved[3 * k + n]
        jacobian[3 * i + n] = moved[3 * i + n] + trig[2] * jacobian[3 * k + n]


cdef inline void coordinates_of(const double* triple, const int* order, const double* home, const double* frame,
                                double* values) noexcept nogil:
    cdef double r[9]
    cdef double relative[9]
    cdef double v[3]
    cdef int n
    matrix_of(triple, order, r)
    left_transposed(home, r, relative)
    vector_of(relative, v)
    for n in range(3):
        values[n] = frame[n] * v[0] + frame[3 + n] * v[1] + frame[6 + n] * v[2]


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
    cdef double values[3]
    with nogil:
        for t in range(angles.shape[0]):
            for k in range(columns.shape[0]):
                whole = 1
                for n in range(3):
                    triple[n] = angles[t, columns[k, n]]
                    if not (fabs(triple[n]) <= MOST):
                        whole = 0
                if whole:
                    coordinates_of(triple, &orders[k, 0], &homes[k, 0, 0], &frames[k, 0, 0], values)
                for n in range(3):
                    out[t, columns[k, n]] = values[n] if whole else NAN


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
    with nogil:
        decode_rows(values, columns, orders, homes, frames, near, out, std, velocity, std is not None,
                    velocity is not None)


cdef void decode_rows(const double[:, ::1] values, const int[:, ::1] columns, const int[:, ::1] orders,
                      const double[:, :, ::1] homes, const double[:, :, ::1] frames, double[::1] near,
                      double[:, ::1] out, double[:, ::1] std, double[:, ::1] velocity, bint spread,
                      bint rates) noexcept nogil:
    cdef Py_ssize_t t, k
    cdef int n, m
    cdef double v[3]
    cdef double r[9]
    cdef double turned[9]
    cdef double moved[9]
    cdef double here[3]
    cdef double angles[3]
    cdef double given[3]
    cdef double trig[4]
    cdef double jacobian[9]
    cdef double total
    for t in range(values.shape[0]):
        for k in range(columns.shape[0]):
            for n in range(3):
                v[n] = (frames[k, n, 0] * values[t, columns[k, 0]] + frames[k, n, 1] * values[t, columns[k, 1]]
                        + frames[k, n, 2] * values[t, columns[k, 2]])
                here[n] = near[columns[k, n]]
            if not (isfinite(v[0]) and isfinite(v[1]) and isfinite(v[2])):
                for n in range(3):
                    out[t, columns[k, n]] = NAN
                    if spread:
                        std[t, columns[k, n]] = NAN
                    if rates:
                        velocity[t, columns[k, n]] = NAN
                continue
            exponential(v, turned, jacobian)
            product(&homes[k, 0, 0], turned, r)
            angles_of(r, &orders[k, 0], here, angles, trig)
            for n in range(3):
                out[t, columns[k, n]] = angles[n]
                near[columns[k, n]] = angles[n]
            if not (spread or rates):
                continue
            product(jacobian, &frames[k, 0, 0], moved)
            rates_of(trig, &orders[k, 0], moved, jacobian)
            if spread:
                for n in range(3):
                    given[n] = std[t, columns[k, n]]
                for n in range(3):
                    total = 0.0
                    for m in range(3):
                        total += jacobian[3 * n + m] * jacobian[3 * n + m] * given[m] * given[m]
                    std[t, columns[k, n]] = PI if total > PI * PI else sqrt(total)
            if rates:
                for n in range(3):
                    given[n] = velocity[t, columns[k, n]]
                for n in range(3):
                    velocity[t, columns[k, n]] = (jacobian[3 * n] * given[0] + jacobian[3 * n + 1] * given[1]
                                                  + jacobian[3 * n + 2] * given[2])


cdef class Border:
    """Between the angles of sensors and the coordinates of a predictor, sample by sample.

    A ball joint of which some angles are missing counts by the coordinates of those that are there, the others taken as
    last estimated (at home before the first estimate); this is exact to first order about home. Where the joint's
    home is so near the gimbal lock that single angles say nothing (more than 37 degrees of middle angle), the joint
    counts as missing. Angles that come out take the turn and, of equivalent triples, the branch of those observed last.

    Parameters
    ----------
    space : JointSpace
    """

    cdef readonly object space
    cdef object _rest
    cdef int[:, ::1] _columns, _orders
    cdef double[:, :, ::1] _homes, _frames
    cdef double[::1] _centres, _near, _turns, _work
    cdef unsigned char[::1] _folds, _apart, _seen
    cdef Py_ssize_t _channels

    def __init__(self, space):
        self.space = space
        self._columns, self._orders = space.columns, space.axes
        self._homes, self._frames, self._centres = space.homes, space.frames, space.centres
        self._folds, self._apart = space.folds.astype(np.uint8), space.apart.astype(np.uint8)
        self._channels = len(space.joint_names)
        self._seen = np.zeros(self._channels, dtype=np.uint8)
        self.reset()

    def reset(self):
        """Forget all samples."""
        self._near, self._work = self.space.home.copy(), self.space.home.copy()
        self._turns = np.zeros(self._channels)
        self._seen[:] = 0

    def enter(self, y, mask):
        """Coordinates of a sample.

        Parameters
        ----------
        y : ndarray, shape (D,)
            Rad; NaN is missing.
        mask : ndarray of bool, shape (D,), optional

        Returns
        -------
        ndarray, shape (D,)
            NaN where a coordinate is not observed.

        Raises
        ------
        ValueError
            If a shape is wrong, a value is infinite, or a mask is not boolean.
        """
        cdef Py_ssize_t d, k
        cdef int n, whole
        cdef double triple[3]
        cdef double values[3]
        cdef double value, turn
        result = np.array(y, dtype=np.float64)
        if result.ndim != 1 or len(result) != self._channels or (mask is not None and np.shape(mask) != result.shape):
            raise ValueError(f'an observation has shape ({self._channels},), got {result.shape}'
                             + ('' if mask is None else f' with a mask of shape {np.shape(mask)}'))
        if np.isinf(result).any():
            raise ValueError('observation holds an infinite value')
        if mask is not None:
            mask = np.asarray(mask)
            if mask.dtype != bool:
                raise ValueError(f'mask must be boolean, got {mask.dtype}')
            result[~mask] = NAN
        cdef double[::1] out = result
        for d in range(self._channels):
            value = out[d]
            self._seen[d] = value == value
            if self._folds[d] and fabs(value) <= MOST:
                turn = TWO_PI * rint((self._centres[d] - value) / TWO_PI)
                self._turns[d] = turn
                out[d] = value + turn
        for k in range(self._columns.shape[0]):
            whole = 0
            for n in range(3):
                d = self._columns[k, n]
                triple[n] = out[d]
                if fabs(out[d]) <= MOST:
                    whole += 1
                else:
                    triple[n] = self._near[d]
            if whole == 3 or (whole > 0 and self._apart[k]):
                coordinates_of(triple, &self._orders[k, 0], &self._homes[k, 0, 0], &self._frames[k, 0, 0], values)
            else:
                values[0] = values[1] = values[2] = NAN
            for n in range(3):
                d = self._columns[k, n]
                if whole == 3:
                    self._near[d] = triple[n]
                out[d] = values[n] if fabs(out[d]) <= MOST else NAN
        return result

    def leave(self, mean, std):
        """Mean and standard deviation (D,) of an estimate, in angles; they are near the next ones."""
        mean, std = self._decoded(np.array(mean, dtype=np.float64)[None], np.array(std, dtype=np.float64)[None], None)
        cdef Py_ssize_t k
        cdef int n
        for k in range(self._columns.shape[0]):
            if isfinite(self._work[self._columns[k, 0]]):
                for n in range(3):
                    self._near[self._columns[k, n]] = self._work[self._columns[k, n]]
        return mean[0], std[0]

    def ahead(self, mean, std, velocity):
        """Predictions (H, D) in angles; every horizon follows the one before it."""
        mean, std, velocity = (np.array(one, dtype=np.float64, order='C') for one in (mean, std, velocity))
        return self._decoded(mean, std, velocity)

    def flags(self, observed):
        """Which angles were given and used: those whose coordinate the predictor observed."""
        return np.asarray(observed, dtype=bool) & np.asarray(self._seen).view(bool)

    cdef object _decoded(self, values, std, velocity):
        cdef Py_ssize_t t, d
        cdef double[:, ::1] out
        result = values.copy()
        out = result
        self._work[:] = self._near
        decode_rows(values, self._columns, self._orders, self._homes, self._frames, self._work, out, std, velocity, True,
                    velocity is not None)
        for d in range(self._channels):
            if self._turns[d] != 0:
                for t in range(out.shape[0]):
                    out[t, d] -= self._turns[d]
        return (result, std) if velocity is None else (result, std, velocity)
