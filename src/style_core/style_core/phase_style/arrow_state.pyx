"""State of the full filter: how it is laid out in memory, where it starts, what may be read of it.

Numbers of equations are those of docs/phase_style.md.
"""
import numpy as np

from libc.math cimport INFINITY, NAN, cos, sin

from style_core.phase_style.arrow cimport WIDEST, arrow_constants, arrow_fill, arrow_rows, arrow_u, arrow_v, coupled
from style_core.phase_style.basis_table cimport LANES, wrapped
from style_core.phase_style.memory cimport aligned
from style_core.phase_style.parts cimport LEVEL, is_coupled, prior
from style_core.small_matrices cimport cholesky, cholesky_inverse

__all__ = ['ArrowState', 'Filter']


cdef class Filter:
    """What a search asks of a filter; see `ArrowFilter`."""

    def __cinit__(self, *_, **__):
        self.c = np.zeros(2)

    cpdef start(self, double phase, double velocity, double phase_variance, double velocity_variance):
        """Begin anew."""
        raise NotImplementedError

    cpdef copy(self, Filter of):
        """Take over the state of another filter."""
        raise NotImplementedError

    cpdef gate(self, double limit=INFINITY, double few=0.0, double rest=INFINITY, bint whole=False):
        """What to leave out from now on."""
        raise NotImplementedError

    cpdef update(self, const double[::1] y, const unsigned char[::1] observed, double dt):
        """Advance and take one observation."""
        raise NotImplementedError

    cpdef double surprise(self, const double[::1] y, const unsigned char[::1] observed, double ahead) except? -1:
        """How unexpected a later observation is."""
        raise NotImplementedError

    @property
    def phase(self):
        return self.c[0]

    @property
    def velocity(self):
        return self.c[1]


cdef class ArrowState(Filter):
    """State of an `ArrowFilter`; see there."""

    def __init__(self, Table table, parts, noise, double style_rate, double acceleration, bounds):
        cdef int m
        self.table, self.styles, self.channels = table, table.count - 1, table.channels
        self.style_rate, self.acceleration = style_rate, acceleration
        self.lowest, self.highest = bounds
        self.rejection = Rejection(table.channels)
        self.common = m = 2 + self.styles
        if m > MOST:
            raise ValueError(f'at most {MOST - 2} styles, got {self.styles}')
        self.level = -1
        for one, _ in parts:
            self._add(one)
        if self.level < 0:
            raise ValueError('a channel needs a LEVEL among its parts')
        self.f.m, self.f.n = m, self.states
        self.f.blocks, self.f.channels, self.f.width = table.blocks, table.channels, table.width
        self.f.rows = arrow_rows(&self.f)
        self.memory = aligned(table.blocks * self.f.rows * LANES)
        self.sums = aligned(4 * (m * (m + 1) // 2 + m + 1))
        self.rows = aligned(KNOTS * (1 + self.styles) * table.width)
        self.f.states, self.f.sums = &self.memory[0], &self.sums[0]
        for row, values in enumerate([noise, *(variance for _, variance in parts)]):
            self._row(arrow_constants(&self.f) + row)[...] = 0.0 if row else 1.0  # channels that fill the last block up
            self._put(arrow_constants(&self.f) + row, values)
        self.c, self.work, self.pose = np.zeros(m), np.zeros(m), np.empty(2 * self.channels)
        self.age = np.zeros(max(self.styles, 1))
        self.P, self.precision, self.matrix = (np.zeros((m, m)) for _ in range(3))
        self.one_plan = np.empty(2 + 2 * self.f.parts + 2 * self.states)
        self.turn = self.planned = 0
        self.start(0.0, 0.5 * (self.lowest + self.highest), 1.0, 1.0)

    cdef int _add(self, Part one) except -1:
        """Add a part to those of a channel."""
        cdef int a, i, j, p = self.f.parts, size = one.size
        cdef coupled* c
        cdef double P0[WIDEST * WIDEST]
        if self.states + size > MOST:
            raise ValueError(f'at most {MOST} states of a channel')
        self.parts[p] = one.p
        self.parts[p].first = self.states
        if one.p.kind == LEVEL and self.level < 0:
            self.level = self.states
        self.harmonics = max(self.harmonics, one.p.harmonic)
        for a in range(self.states, self.states + size):
            self.f.part[a] = p
        if is_coupled(&one.p):
            c = &self.f.couple[self.f.couples]
            c.first, c.size = self.states, size
            prior(&one.p, P0)
            for i in range(size):
                for j in range(i + 1):
                    c.prior[i * (i + 1) // 2 + j] = P0[i * size + j]
            self.f.couples += 1
        self.f.parts += 1
        self.states += size
        return 0

    def _row(self, row):
        """View of a row of every block, shape (blocks, 8)."""
        return np.asarray(self.memory).reshape(self.f.blocks, self.f.rows, LANES)[:, row]

    def _put(self, row, values):
        """Set a row by channel."""
        padded = np.array(self._row(row)).reshape(-1)
        padded[:self.channels] = values
        self._row(row)[...] = padded.reshape(-1, LANES)

    cpdef start(self, double phase, double velocity, double phase_variance, double velocity_variance):
        """Begin anew: style and residual states at their priors, a covariance of any correlation forgotten."""
        cdef int a
        self.c[:] = 0
        self.P[:, :] = 0
        for a in range(self.common):
            self.P[a, a] = 1
        self.c[0], self.c[1] = phase, velocity
        self.P[0, 0], self.P[1, 1] = phase_variance, velocity_variance
        self.age[:] = 0
        self.f.blank = 1  # the first update fills the states in: they may lie in no cache
        self.innovation, self.log_likelihood = NAN, 0
        self.rejected = 0
        self.rejection.reset()
        self.fresh = self.rooted = False
        self.turn = 0
        self._bound()

    cpdef copy(self, Filter of):
        """Take over the state of another filter of the same behaviour."""
        cdef ArrowState other = of
        other._fill()
        self.f.blank = 0
        self.memory[:] = other.memory
        self.c[:], self.P[:, :], self.precision[:, :] = other.c, other.P, other.precision
        self.age[:] = other.age
        self.innovation, self.log_likelihood, self.log_determinant = \
            other.innovation, other.log_likelihood, other.log_determinant
        self.seen, self.rejected, self.turn = other.seen, other.rejected, other.turn
        self.rejection.copy(other.rejection)
        self.log_precision, self.fresh, self.rooted = other.log_precision, other.fresh, False

    @property
    def state(self):
        """Mean of the common state, shape (2 + J,)."""
        return np.array(self.c)

    @property
    def covariance(self):
        """Covariance of the common state, shape (2 + J, 2 + J)."""
        return np.array(self.P)

    @property
    def residuals(self):
        """Mean of the channels' own states, shape (n, D)."""
        self._fill()
        first = arrow_u(&self.f)
        return np.array([self._row(first + a).reshape(-1)[:self.channels] for a in range(self.states)])

    def marginal(self, int channel):
        """Mean and covariance of (c, u_d), of length 2 + J + n."""
        self._fill()
        n, m = self.states, self.common
        first = arrow_v(&self.f)
        block = np.asarray(self.memory).reshape(self.f.blocks, self.f.rows, LANES)[channel // LANES, :,
                                                                                  channel % LANES]
        A = block[:first].reshape(n, m)
        V = np.zeros((n, n))
        V[np.tril_indices(n)] = block[first:arrow_u(&self.f)]
        V = V + np.tril(V, -1).T
        u = block[arrow_u(&self.f):][:n]
        P = self.covariance
        cross = A @ P
        return np.concatenate([self.state, u]), np.block([[P, cross.T], [cross, V + cross @ A.T]])

    cdef double _bounded(self, double phase) noexcept nogil:
        return wrapped(phase) if self.table.rhythmic else min(max(phase, 0.0), 1.0)

    cdef void _bound(self) noexcept nogil:
        self.c[0] = self._bounded(self.c[0])
        if self.c[1] < self.lowest:
            self.c[1] = self.lowest
        elif self.c[1] > self.highest:
            self.c[1] = self.highest

    cdef int _invert(self) noexcept nogil:
        """Precision of the common state from its covariance."""
        cdef int i, j, m = self.common
        for i in range(m):
            for j in range(m):
                self.matrix[i, j] = self.P[i, j]
        if cholesky(&self.matrix[0, 0], m):
            return 1
        self.log_precision = cholesky_inverse(&self.matrix[0, 0], &self.precision[0, 0], m)
        return 0

    cdef void _multiples(self, double phase, double* c, double* d) noexcept nogil:
        """cos and sin of multiples of the phase, from none up to the highest harmonic."""
        cdef int k
        c[0], d[0], c[1], d[1] = 1, 0, cos(phase), sin(phase)
        for k in range(2, self.harmonics + 1):
            c[k] = c[k - 1] * c[1] - d[k - 1] * d[1]
            d[k] = d[k - 1] * c[1] + c[k - 1] * d[1]

    cdef void _fill(self) noexcept nogil:
        if self.f.blank:
            arrow_fill(&self.f)

    cdef int _root(self) noexcept nogil:
        """Get the covariance's root, and all states, ready for a prediction; returns 1 if it has none."""
        cdef int i, j, m = self.common
        self._fill()
        for i in range(m):
            for j in range(m):
                self.f.factor[i * m + j] = self.P[i, j]
        self.rooted = cholesky(self.f.factor, m) == 0
        return not self.rooted
