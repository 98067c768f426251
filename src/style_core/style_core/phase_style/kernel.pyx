"""Filters over phase and style, one call an update and one a prediction.

`PaperFilter` is the method of Matsubara et al. (2012): an EKF over phase and phase velocity, on-line EM for the
style. `ArrowFilter` is the full filter: phase, phase velocity and style are common to all channels, and every
channel has residual states of its own that are independent of the other channels' given the common state. The
joint precision then has the shape of an arrow, and everything costs a multiple of the number of channels.
The equations are derived in docs/phase_style.md.

Arrays run over channels in their last axis, so that the inner loops are element-wise and vectorise.
"""
import numpy as np

from libc.math cimport INFINITY, NAN, cos, exp, floor, log, sin, sqrt
from libc.stdint cimport uintptr_t
from libc.string cimport memcmp, memcpy

cdef extern from "blocks.h":
    enum: LANES, MOST
    ctypedef float cell
    ctypedef struct cubic:
        const cell *here
        const cell *next
        double h[8]
    ctypedef struct arrow:
        int m, n, harmonics, blocks, channels, width, rows, third, blank
        double *states
        double *sums
        double logs, worst
        const double *y
        const unsigned char *observed
        double dt, rho, f11, f12, f21, f22, fast_rate
        double load[3][3]
        double back[3][3]
        double mix[3][60]
        double decay[60]
        double renewal[3]
        double w[60]
        double s[60]
        double thin
        cubic at
        double delta[60]
        double factor[3600]
    ctypedef struct horizon:
        cubic at
        double w[60]
        double s[60]
        double ahead, speed, rho, f21, f22, offset_rate, personal_rate, style_rate
        double q_offset, q_fast, q_personal, wander
    ctypedef struct paper:
        int count, blocks, channels, width
        const double *noise
        double *seen
        double *clean
        double *sums
        double w[60]
        double spread[3600]
        double information, score, squares, logs
    void arrow_sense(arrow*, int) noexcept nogil
    void arrow_fill(arrow*) noexcept nogil
    void arrow_settle(arrow*) noexcept nogil
    void arrow_mean(const arrow*, const horizon*, double*, double*, double*) noexcept nogil
    void arrow_spread(const arrow*, const horizon*, int, const double*, double**) noexcept nogil
    void paper_sense(paper*, const cubic*, double, const double*, const unsigned char*) noexcept nogil
    void paper_learn(paper*, const cubic*) noexcept nogil
    void paper_ahead(const paper*, const cubic*, double, double, double, double*, double*, double*) noexcept nogil
    void between(double, const double*, const double*, double*, int) noexcept nogil

#: Time ahead and what is left of style, offset, personal cycle and fast residual after it.
cdef struct pace:
    double ahead, style, offset, personal, fast

cdef object empty = np.empty

#: Distance of the samples that the noise is a variance of, s: at higher rates it stays as dense in time.
cdef double NOISE_STEP_S = 1 / 60.0 - 1e-6
#: Standard deviations are evaluated at so many of the horizons, evenly chosen with both ends, and interpolated.
cdef int KNOTS = 9
cdef double LOG_TWO_PI = 1.8378770664093453


cdef int cholesky(double* a, int n) noexcept nogil:
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


cdef void cholesky_solve(const double* factor, double* b, int n) noexcept nogil:
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


cdef double cholesky_inverse(const double* factor, double* out, int n) noexcept nogil:
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


cdef double[::1] aligned(long count):
    """Zeros, `count` of them, from an address that is a multiple of a cache line on."""
    cdef double[::1] memory = np.zeros(count + 8)
    cdef long first = ((64 - <uintptr_t>&memory[0] % 64) % 64) // 8
    return memory[first:first + count]


cdef float[::1] aligned_single(long count):
    """The same in single precision."""
    return np.asarray(aligned((count + 1) // 2)).view(np.float32)[:count]


cdef double total_of(const double* four) noexcept nogil:
    return (four[0] + four[1]) + (four[2] + four[3])


cdef int check(const double[::1] horizons) except -1:
    for h in range(horizons.shape[0]):
        if not horizons[h] >= 0:
            raise ValueError('horizons must be a one-dimensional array of times >= 0')
    return 0


cdef class Table:
    """A `BasisTable` ready for look-ups, its channels filled up to whole blocks."""

    cdef readonly int count, channels, nodes
    cdef readonly bint rhythmic
    cdef int blocks, width
    cdef cell[::1] memory
    cdef cell* cells                    # (nodes + 1, blocks, count, value and slope, 8)
    cdef const double[:, ::1] variances

    def __init__(self, table):
        self.variances = table.variance
        self.rhythmic = table.rhythmic
        self.nodes = table.values.shape[0] - 1
        self.count = table.values.shape[1]
        self.channels = table.values.shape[2]
        self.blocks = (self.channels + LANES - 1) // LANES
        self.width = self.blocks * LANES
        rows = np.zeros((self.nodes + 1, 2, self.count, self.width))
        rows[:, 0, :, :self.channels], rows[:, 1, :, :self.channels] = table.values, table.slopes
        rows = rows.reshape(self.nodes + 1, 2, self.count, self.blocks, LANES).transpose(0, 3, 2, 1, 4)
        self.memory = aligned_single(rows.size)
        self.cells = &self.memory[0]
        np.asarray(self.memory)[:] = rows.reshape(-1)

    cdef void place(self, double phase, int* node, double* part, double* rate) noexcept nogil:
        """Node below a phase, position between nodes in [0, 1], and nodes a unit of phase (0 when clamped)."""
        cdef double at
        if self.rhythmic:
            rate[0] = self.nodes / TWO_PI
            at = wrapped(phase) * rate[0]
        else:
            rate[0] = self.nodes
            at = phase * rate[0]
            if at <= 0 or at >= self.nodes:
                at = 0 if at <= 0 else self.nodes
                rate[0] = 0
        if not (at >= 0 and at <= self.nodes):  # not a number
            at = 0
        node[0] = <int>at
        if node[0] > self.nodes - 1:
            node[0] = self.nodes - 1
        part[0] = at - node[0]

    cdef void look_up(self, double phase, cubic* at) noexcept nogil:
        """The cubics around a phase."""
        cdef int node
        cdef long size = 2 * self.count * self.width
        cdef double u, rate
        self.place(phase, &node, &u, &rate)
        at.here = self.cells + node * size
        at.next = at.here + size
        at.h[0] = (1 + 2 * u) * (1 - u) * (1 - u)
        at.h[1] = u * (1 - u) * (1 - u)
        at.h[2] = u * u * (3 - 2 * u)
        at.h[3] = u * u * (u - 1)
        at.h[4] = 6 * u * (u - 1) * rate
        at.h[5] = (1 - u) * (1 - 3 * u) * rate
        at.h[6] = -at.h[4]
        at.h[7] = u * (3 * u - 2) * rate

    cdef double variance(self, double phase, const double* weight) noexcept nogil:
        """Eq. (13): ``sum_j weight_j^2 variance_j``, linear between nodes."""
        cdef int node, j
        cdef double u, rate, total = 0
        self.place(phase, &node, &u, &rate)
        for j in range(self.count):
            total += weight[j] * weight[j] * ((1 - u) * self.variances[node, j] + u * self.variances[node + 1, j])
        return total

    def evaluate(self, double phase):
        """Bases and derivatives at one phase, each (J, D)."""
        cdef cubic at
        cdef int j, d
        cdef long k
        cdef double p, q, r, s
        cdef double[:, ::1] value = np.empty((self.count, self.channels))
        cdef double[:, ::1] slope = np.empty((self.count, self.channels))
        self.look_up(phase, &at)
        for j in range(self.count):
            for d in range(self.channels):
                k = 2 * LANES * (self.count * (d // LANES) + j) + d % LANES
                p, q, r, s = at.here[k], at.here[k + LANES], at.next[k], at.next[k + LANES]
                value[j, d] = (at.h[0] * p + at.h[1] * q) + (at.h[2] * r + at.h[3] * s)
                slope[j, d] = (at.h[4] * p + at.h[5] * q) + (at.h[6] * r + at.h[7] * s)
        return np.asarray(value), np.asarray(slope)


cdef class Sheet:
    """Arrays of an estimate, in one piece of memory."""

    cdef object memory
    cdef int J, D
    cdef double *phases     # covariance of phase and velocity (2, 2)
    cdef double *style      # (J,)
    cdef double *covariance  # (J, J)
    cdef double *mean       # (D,)
    cdef double *std        # (D,)

    def __cinit__(self, int J, int D):
        cdef double[::1] memory
        self.J, self.D = J, D
        self.memory = memory = empty(4 + J + J * J + 2 * D)
        self.phases = &memory[0]
        self.style = self.phases + 4
        self.covariance = self.style + J
        self.mean = self.covariance + J * J
        self.std = self.mean + D

    cdef tuple parts(self):
        cdef int J = self.J, D = self.D, k = 4 + J + J * J
        memory = self.memory
        return (memory[:4].reshape(2, 2), memory[4:4 + J], memory[4 + J:k].reshape(J, J), memory[k:k + D],
                memory[k + D:])


cdef class PaperFilter:
    """EKF over phase and phase velocity with on-line EM of the style (Matsubara et al. 2012, appendix A).

    Parameters
    ----------
    table : Table
    noise : ndarray, shape (D,)
        R, rad^2.
    acceleration : float
        Density of the phase acceleration; Q follows from it and the time step.
    style : ndarray, shape (J,)
        Where the style starts.
    forgetting : float
        lambda for a time step of ``step`` seconds; a step of another length forgets accordingly.
    step : float
    """

    cdef readonly Table table
    cdef readonly double phase, velocity, innovation, log_likelihood
    cdef double p00, p01, p11, acceleration, log_forgetting, share
    cdef readonly double learning_rate
    cdef int count, channels
    cdef paper f
    cdef double[::1] memory, moment, scratch
    cdef double[:, ::1] normal, noisy, work, spread

    def __init__(self, Table table, noise, double acceleration, style, double forgetting, double step):
        cdef int j, width = table.width
        if table.count > MOST:
            raise ValueError(f'at most {MOST} styles, got {table.count}')
        self.table = table
        self.count, self.channels = table.count, table.channels
        self.acceleration = acceleration
        self.log_forgetting = log(forgetting) / step
        self.moment = np.zeros(self.count)
        self.normal = np.zeros((self.count, self.count))
        self.noisy = np.zeros((self.count, self.count))
        self.work = np.zeros((self.count, self.count))
        self.spread = np.zeros((self.count, self.count))
        self.scratch = np.zeros(self.count)
        self.learning_rate = 0
        self.share = 0
        self.memory = aligned(3 * width + 4 * self.count * (self.count + 2))
        np.asarray(self.memory)[:width] = 1
        np.asarray(self.memory)[:self.channels] = noise
        self.f.count, self.f.blocks, self.f.channels, self.f.width = table.count, table.blocks, table.channels, width
        self.f.noise = &self.memory[0]
        self.f.seen = &self.memory[width]
        self.f.clean = &self.memory[2 * width]
        self.f.sums = &self.memory[3 * width]
        for j in range(self.count):
            self.f.w[j] = style[j]

    def start(self, double phase, double velocity, double phase_variance, double velocity_variance):
        """Set the phase and its velocity, uncorrelated."""
        self.phase, self.velocity = phase, velocity
        self.p00, self.p01, self.p11 = phase_variance, 0, velocity_variance

    @property
    def covariance(self):
        return np.array([[self.p00, self.p01], [self.p01, self.p11]])

    @property
    def style(self):
        return np.array(<double[:self.count]>self.f.w)

    def update(self, const double[::1] y, const unsigned char[::1] observed, double dt, bint learn=True):
        """E-step (A.1)-(A.6) with the rows of missing channels left out, then on-line M-step (A.10)-(A.13).

        Parameters
        ----------
        y : ndarray, shape (D,)
        observed : ndarray of uint8, shape (D,)
        dt : float
            Since the last update, s; 0 for the first.
        learn : bool
            Without it the style stays as it is (E-step only).
        """
        cdef int d, i, j, k, seen = 0, J = self.count
        cdef double q = self.acceleration, gain, k0, k1, eta, squares
        cdef double* normal = self.f.sums
        cdef double* noisy = normal + 2 * J * (J + 1)
        cdef double* moment = noisy + 2 * J * (J + 1)
        cdef cubic at
        with nogil:
            self.phase += dt * self.velocity
            self.p00 += dt * (2 * self.p01 + dt * self.p11) + q * dt * dt * dt / 3
            self.p01 += dt * self.p11 + q * dt * dt / 2
            self.p11 += q * dt
            self._bound()
            for d in range(self.channels):
                seen += observed[d] != 0
            self.table.look_up(self.phase, &at)
            paper_sense(&self.f, &at, self.table.variance(self.phase, self.f.w), &y[0], &observed[0])
            gain = 1 / (1 + self.p00 * self.f.information)
            k0, k1 = self.p00 * gain, self.p01 * gain
            self.phase += k0 * self.f.score
            self.velocity += k1 * self.f.score
            self.p11 -= self.p01 * k1 * self.f.information
            self.p01 *= gain
            self.p00 *= gain
            squares = self.f.squares - k0 * self.f.score * self.f.score
            self.innovation = squares / seen if seen else NAN
            self.log_likelihood = -0.5 * (squares + self.f.logs - log(gain) + seen * LOG_TWO_PI)
            self._bound()
            if seen and learn:
                self.table.look_up(self.phase, &at)
                paper_learn(&self.f, &at)
                if self.learning_rate == 0:
                    eta = 1
                else:
                    eta = 1 / (1 + exp(self.log_forgetting * dt) / self.learning_rate)
                self.learning_rate = eta
                self.share = (1 - eta) * (1 - eta) * self.share + eta * eta
                k = 0
                for i in range(J):
                    self.moment[i] += eta * (total_of(moment + 4 * i) - self.moment[i])
                    for j in range(i + 1):
                        self.normal[i, j] += eta * (total_of(normal + 4 * k) - self.normal[i, j])
                        self.normal[j, i] = self.normal[i, j]
                        self.noisy[i, j] += eta * (total_of(noisy + 4 * k) - self.noisy[i, j])
                        self.noisy[j, i] = self.noisy[i, j]
                        k += 1
                self._solve_style()

    cdef void _bound(self) noexcept nogil:
        if self.table.rhythmic:
            self.phase = wrapped(self.phase)
        elif self.phase < 0:
            self.phase = 0
        elif self.phase > 1:
            self.phase = 1

    cdef void _solve_style(self) noexcept nogil:
        """(A.10); while too little is seen to fix every style, the directions not seen keep their value."""
        cdef int i, j, J = self.count
        cdef double ridge = 0
        for i in range(J):
            ridge += self.normal[i, i]
        ridge *= 1e-13
        for i in range(J):
            for j in range(J):
                self.work[i, j] = self.normal[i, j]
            self.work[i, i] += ridge
        if cholesky(&self.work[0, 0], J):
            return
        for i in range(J):
            self.scratch[i] = self.moment[i] + ridge * self.f.w[i]
        cholesky_solve(&self.work[0, 0], &self.scratch[0], J)
        for i in range(J):
            self.f.w[i] = self.scratch[i]
        # covariance of the weighted least squares: N^-1 (sum of weighted B R B^T) N^-1
        for i in range(J):
            for j in range(J):
                self.scratch[j] = self.noisy[i, j]
            cholesky_solve(&self.work[0, 0], &self.scratch[0], J)
            for j in range(J):
                self.spread[j, i] = self.scratch[j] * self.share
        for i in range(J):
            cholesky_solve(&self.work[0, 0], &self.spread[i, 0], J)

    def predict(self, const double[::1] horizons, double[:, ::1] mean, double[:, ::1] std,
                double[:, ::1] velocity):
        """Section 3.3 at any time ahead, with the spread of phase, style and residual.

        Parameters
        ----------
        horizons : ndarray, shape (H,)
            s.
        mean, std, velocity : ndarray, shape (H, D)
            Filled in.
        """
        check(horizons)
        if horizons.shape[0]:
            self._predict(horizons, &mean[0, 0], &std[0, 0], &velocity[0, 0])

    cdef void _predict(self, const double[::1] horizons, double* mean, double* std, double* velocity) noexcept nogil:
        cdef long h, D = self.channels
        self._pair_spread()
        for h in range(horizons.shape[0]):
            self._ahead(horizons[h], mean + h * D, std + h * D, velocity + h * D)

    def ahead(self, const double[::1] horizons):
        """`predict` into new arrays: mean, std and velocity."""
        cdef long H = horizons.shape[0]
        check(horizons)
        out = empty((3, H, self.channels))
        cdef double[:, :, ::1] memory = out
        if H:
            self._predict(horizons, &memory[0, 0, 0], &memory[1, 0, 0], &memory[2, 0, 0])
        return out[0], out[1], out[2]

    def describe(self):
        """Covariance of phase and velocity (2, 2), style (J,), its covariance (J, J), filtered pose and its standard
        deviation, each (D,)."""
        cdef int i, j, J = self.count, D = self.channels
        cdef Sheet sheet = Sheet(J, D)
        sheet.phases[0], sheet.phases[1], sheet.phases[2], sheet.phases[3] = self.p00, self.p01, self.p01, self.p11
        for i in range(J):
            sheet.style[i] = self.f.w[i]
            for j in range(J):
                sheet.covariance[i * J + j] = INFINITY if self.learning_rate == 0 \
                    else 0.5 * (self.spread[i, j] + self.spread[j, i])
        self._pair_spread()
        self._ahead(0, sheet.mean, sheet.std, NULL)
        return sheet.parts()

    cdef void _pair_spread(self) noexcept nogil:
        """Both halves of the style's covariance in the lower one."""
        cdef int i, j, J = self.count
        for i in range(J):
            self.f.spread[i * J + i] = self.spread[i, i]
            for j in range(i):
                self.f.spread[i * J + j] = self.spread[i, j] + self.spread[j, i]

    cdef void _ahead(self, double ahead, double* mean, double* std, double* velocity) noexcept nogil:
        cdef cubic at
        cdef double phase = self.phase + ahead * self.velocity, speed = self.velocity
        cdef double phase_variance = self.p00 + ahead * (2 * self.p01 + ahead * self.p11) \
            + self.acceleration * ahead * ahead * ahead / 3
        if not self.table.rhythmic and (phase >= 1 or phase <= 0):
            phase = 1 if phase >= 1 else 0
            speed = 0
        self.table.look_up(phase, &at)
        paper_ahead(&self.f, &at, self.table.variance(phase, self.f.w), phase_variance, speed, mean, std, velocity)


#: A channel that contradicts the filter, but not itself, is believed after this long, s.
cdef double BELIEVED_S = 0.05
#: Beside a channel beyond the limit, others are not believed from this share of it on: a limb fails as a whole.
cdef double SUSPECT = 0.25
#: Of fewer channels than this no single one can be told to be wrong.
cdef int ALONE = 4
#: In `ArrowFilter.used`, while it is decided what is believed.
cdef unsigned char MARKED = 2


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

    cpdef believe(self, double limit=INFINITY, double few=0.0, double rest=INFINITY, bint whole=False):
        """What to believe from now on."""
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


cdef class ArrowFilter(Filter):
    """Extended Kalman filter over phase, phase velocity, style, and residual states of every channel.

    The common state is ``c = (phase, velocity, z)`` with the style ``w = w0 + S z``, z of J components with unit
    prior variance. Channel d adds its own n = 3 + 2 K states u_d: a slow offset, a fast residual and its velocity,
    and K harmonics of a personal cycle:

        y_d = m_d(phase) + sum_j z_j b_jd(phase) + offset_d + fast_d + sum_k (a_kd cos k phase + b_kd sin k phase)
              + white noise

    Given c the u_d of different channels are kept independent: ``u_d | c ~ N(b_d + A_d (c - mean), V_d)``. An
    update keeps this exactly; a time step with process noise on c is projected back to it, with every marginal of
    (c, u_d) exact. docs/phase_style.md derives both.

    Parameters
    ----------
    table : Table
        J + 1 bases over phase: the mean, then those of z.
    offset, fast, noise : ndarray, shape (D,)
        Variances, rad^2.
    personal : ndarray, shape (K, D)
        Variance of each coefficient of harmonic k.
    rates : sequence of 4 floats
        Decay of offset, fast residual, personal cycle and style, 1/s.
    acceleration : float
        Density of the phase acceleration.
    bounds : (float, float)
        Lowest and highest phase velocity.

    Attributes
    ----------
    used : ndarray of uint8, shape (D,)
        Channels that entered the last update.
    rejected : int
        How many were observed and not believed (see `believe`).
    """

    cdef readonly Table table
    cdef readonly object used
    cdef unsigned char[::1] _used
    cdef double limit, few, rest        # what is believed
    cdef bint whole
    # of each channel: how long it has agreed with itself without being believed, s (-1: it is believed), last error
    # and value, whether the doubt is new
    cdef double[:, ::1] doubt
    cdef bint doubting          # some are not believed
    cdef readonly int styles, states, channels, common, harmonics
    cdef int constants          # first row of a block that no update changes
    cdef double offset_rate, fast_rate, personal_rate, style_rate, acceleration, lowest, highest
    cdef arrow f
    cdef horizon times[9]
    cdef double[::1] memory, sums, rows
    cdef double[::1] horizons, paces    # of the last prediction; `planned` of them count
    cdef long planned
    cdef double[::1] age, work, pose
    cdef double[:, ::1] P, precision, matrix
    cdef double log_precision   # of its determinant
    cdef int turn
    cdef bint fresh             # the precision belongs to the covariance
    cdef bint rooted            # so does its root

    def __init__(self, Table table, offset, fast, personal, noise, rates, double acceleration, bounds):
        cdef int n, m
        self.used = np.zeros(table.channels, dtype=np.uint8)
        self._used, self.doubt = self.used, np.empty((table.channels, 4))
        personal = np.ascontiguousarray(personal, dtype=float).reshape(-1, table.channels)
        self.table = table
        self.styles = table.count - 1
        self.channels = table.channels
        self.harmonics = personal.shape[0]
        self.states = n = 3 + 2 * self.harmonics
        self.common = m = 2 + self.styles
        if m > MOST or n > MOST:
            raise ValueError(f'at most {MOST - 2} styles and {(MOST - 3) // 2} harmonics, '
                             f'got {self.styles} and {self.harmonics}')
        self.offset_rate, self.fast_rate, self.personal_rate, self.style_rate = rates
        self.acceleration = acceleration
        self.lowest, self.highest = bounds
        self.f.m, self.f.n, self.f.harmonics = m, n, self.harmonics
        self.f.blocks, self.f.channels, self.f.width = table.blocks, table.channels, table.width
        self.constants = n * m + n * (n + 1) // 2 + 2 * n + m + 2
        self.f.rows = self.constants + 4 + self.harmonics
        self.f.fast_rate = self.fast_rate
        self.memory = aligned(table.blocks * self.f.rows * LANES)
        self.sums = aligned(4 * (m * (m + 1) // 2 + m + 1))
        self.rows = aligned(KNOTS * (1 + self.styles) * table.width)
        self.f.states, self.f.sums = &self.memory[0], &self.sums[0]
        for row, values in enumerate([noise, offset, fast, personal.sum(axis=0), *personal]):
            self._row(self.constants + row)[...] = 1.0 if row == 0 else 0.0   # channels that fill the last block up
            self._put(self.constants + row, values)
        self.c, self.work, self.pose = np.zeros(m), np.zeros(m), np.empty(2 * self.channels)
        self.believe()
        self.age = np.zeros(max(self.styles, 1))
        self.P, self.precision, self.matrix = (np.zeros((m, m)) for _ in range(3))
        self.turn = 0
        self.planned = 0
        self.start(0.0, 0.5 * (self.lowest + self.highest), 1.0, 1.0)

    def _row(self, row):
        """View of a row of every block, shape (blocks, 8)."""
        return np.asarray(self.memory).reshape(self.f.blocks, self.f.rows, LANES)[:, row]

    def _put(self, row, values):
        """Set a row by channel."""
        padded = np.array(self._row(row)).reshape(-1)
        padded[:self.channels] = values
        self._row(row)[...] = padded.reshape(-1, LANES)

    cdef inline double* _state(self, int block, int row) noexcept nogil:
        return self.f.states + (<long>block * self.f.rows + row) * LANES

    cpdef believe(self, double limit=INFINITY, double few=0.0, double rest=INFINITY, bint whole=False):
        """What to believe from now on; everything, unless told.

        A channel whose innovation is more than ``limit`` of its standard deviations, and any beside it that is more than
        a quarter of it off, is left out of the update if the others are not surprised, for as long as it contradicts what
        came before or does not change by a single bit; once it has agreed with itself for 0.05 s it is believed, and its
        offset sought anew. Where more than a share ``few`` of the channels is out, and not one alone, it is not a few
        sensors that fail: then the observation is left out as a whole, or used as it is.

        Parameters
        ----------
        limit : float
        few : float
        rest : float
            Innovation a channel up to which the others are not surprised.
        whole : bool
            Leave out whole observations. Without it only a first observation can bring a channel into doubt: which of
            two that contradict each other is right cannot be told before the filter is known to be.
        """
        self.limit, self.few, self.rest, self.whole = limit, few, rest, whole

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
        self.doubt[:, 0] = -1
        self.doubting = False
        self.fresh = self.rooted = False
        self.turn = 0
        self._bound()

    cpdef copy(self, Filter of):
        """Take over the state of another filter of the same behaviour."""
        cdef ArrowFilter other = of
        other._fill()
        self.f.blank = 0
        self.memory[:] = other.memory
        self.c[:], self.P[:, :], self.precision[:, :] = other.c, other.P, other.precision
        self.age[:], self.doubt[:, :] = other.age, other.doubt
        self.innovation, self.log_likelihood, self.log_determinant = \
            other.innovation, other.log_likelihood, other.log_determinant
        self.seen, self.rejected, self.doubting, self.turn = other.seen, other.rejected, other.doubting, other.turn
        self._used[:] = other._used
        self.log_precision, self.fresh, self.rooted = other.log_precision, other.fresh, False

    cpdef double surprise(self, const double[::1] y, const unsigned char[::1] observed, double ahead) except? -1:
        """Mean squared error of a later observation in predicted standard deviations, over channels not in doubt.

        Parameters
        ----------
        y : ndarray, shape (D,)
        observed : ndarray of uint8, shape (D,)
        ahead : float
            Time since the last update, s.

        Returns
        -------
        float
            NaN if nothing counts.
        """
        cdef int d, count = 0
        cdef double error, total = 0
        cdef double* mean = &self.pose[0]
        cdef double* std = mean + self.channels
        self._expect(ahead, mean, std)
        for d in range(self.channels):
            if observed[d] and self.doubt[d, 0] < 0:
                error = (y[d] - mean[d]) / std[d]
                total += error * error
                count += 1
        return total / count if count else NAN

    @property
    def state(self):
        """Mean of the common state, shape (2 + J,)."""
        return np.array(self.c)

    @property
    def covariance(self):
        """Covariance of the common state, shape (2 + J, 2 + J)."""
        return np.array(self.P)

    def describe(self, const double[::1] centre, const double[:, ::1] root, double late=0.0):
        """What the filter believes now, or was to expect some time after its last update.

        Parameters
        ----------
        centre, root : ndarray, shape (J,) and (J, J)
            The style is ``centre + root z``.
        late : float
            Time since the last update, s; phase and pose are carried on by it.

        Returns
        -------
        tuple
            Phase, velocity, their covariance (2, 2), style (J,), its covariance (J, J), pose and its standard
            deviation, each (D,).
        """
        cdef int i, j, k, J = self.styles
        cdef double total, phase = self.c[0] + late * self.c[1]
        cdef Sheet sheet = Sheet(J, self.channels)
        for i in range(2):
            for j in range(2):
                sheet.phases[2 * i + j] = self.P[i, j]
        for i in range(J):
            sheet.style[i] = centre[i]
            for k in range(J):
                sheet.style[i] += root[i, k] * self.c[2 + k]
        for i in range(J):
            for j in range(J):
                total = 0
                for k in range(J):
                    total += self.P[2 + i, 2 + k] * root[j, k]
                self.matrix[i, j] = total
        for i in range(J):
            for j in range(J):
                total = 0
                for k in range(J):
                    total += root[i, k] * self.matrix[k, j]
                sheet.covariance[i * J + j] = total
        self._expect(late, sheet.mean, sheet.std)
        return self._bounded(phase), self.c[1], *sheet.parts()

    cdef int _expect(self, double ahead, double* mean, double* std) except -1:
        """Pose some time after the last update and its standard deviation, each (D,)."""
        cdef pace pace
        if not self.rooted and self._root():
            raise ArithmeticError('what was observed is too far from anything the model can represent')
        self._decays(ahead, &pace)
        self._ahead(&pace, self.times)
        arrow_mean(&self.f, self.times, mean, NULL, &self.rows[0])
        arrow_spread(&self.f, self.times, 1, &self.rows[0], &std)
        return 0

    @property
    def residuals(self):
        """Mean of the residual states, shape (3 + 2 K, D)."""
        self._fill()
        n, m = self.states, self.common
        first = n * m + n * (n + 1) // 2
        return np.array([self._row(first + a).reshape(-1)[:self.channels] for a in range(n)])

    def marginal(self, int channel):
        """Mean and covariance of (c, u_d), of length 2 + J + 3 + 2 K."""
        self._fill()
        n, m = self.states, self.common
        block = np.asarray(self.memory).reshape(self.f.blocks, self.f.rows, LANES)[channel // LANES, :,
                                                                                  channel % LANES]
        A = block[:n * m].reshape(n, m)
        V = np.zeros((n, n))
        V[np.tril_indices(n)] = block[n * m:n * m + n * (n + 1) // 2]
        V = V + np.tril(V, -1).T
        u = block[n * m + n * (n + 1) // 2:][:n]
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

    cpdef update(self, const double[::1] y, const unsigned char[::1] observed, double dt):
        """Advance by ``dt`` seconds and take one observation; channels not observed are marginalised exactly.

        Parameters
        ----------
        y : ndarray, shape (D,)
        observed : ndarray of uint8, shape (D,)
        dt : float
            0 or more.
        """
        cdef int status
        if not self.fresh:
            if self._invert():
                raise ArithmeticError('what was observed is too far from anything the model can represent')
            self.fresh = True
        self.rooted = False
        self.f.thin = NOISE_STEP_S / dt if 0 < dt < NOISE_STEP_S else 1.0
        self.f.y, self.f.observed = &y[0], &self._used[0]
        with nogil:
            status = 0
            if dt > 0:
                status = self._advance(dt)
            if status == 0:
                status = self._observe(observed, dt)
        if status:
            raise ArithmeticError('what was observed is too far from anything the model can represent')

    cdef int _advance(self, double dt) noexcept nogil:
        """Time step of the common state; what the residual states' step needs goes to ``f``."""
        cdef int i, j, k, r, m = self.common, n = self.states, drift = -1
        cdef double l11, l21, l22, rho = 1, spread = 0, total, q, g0, gp, decay
        cdef arrow* f = &self.f  # f.load: square root of Q in the rows phase, velocity, drifting style
        cdef double inner[9]
        if self.styles:
            for j in range(self.styles):
                self.age[j] += dt
            drift = self.turn % self.styles
            self.turn = (drift + 1) % self.styles
            rho = exp(-self.style_rate * self.age[drift])
            spread = sqrt(1 - rho * rho) if rho < 1 else 0
            self.age[drift] = 0
        self.c[0] += dt * self.c[1]
        for i in range(m):
            self.P[0, i] += dt * self.P[1, i]
        for i in range(m):
            self.P[i, 0] += dt * self.P[i, 1]
        if drift >= 0:
            self.c[2 + drift] *= rho
            for i in range(m):
                self.P[2 + drift, i] *= rho
            for i in range(m):
                self.P[i, 2 + drift] *= rho
        q = sqrt(self.acceleration)
        l11 = q * sqrt(dt * dt * dt / 3)
        l21 = q * sqrt(3 * dt) / 2
        l22 = q * sqrt(dt) / 2
        self.P[0, 0] += l11 * l11
        self.P[0, 1] += l11 * l21
        self.P[1, 0] += l11 * l21
        self.P[1, 1] += l21 * l21 + l22 * l22
        if drift >= 0:
            self.P[2 + drift, 2 + drift] += spread * spread
        if self._invert():
            return 1
        f.third = 2 + drift if drift >= 0 else 0  # without a style the third row has no load
        for i in range(3):
            for j in range(3):
                f.load[i][j] = 0
        f.load[0][0], f.load[1][0], f.load[1][1], f.load[2][2] = l11, l21, l22, spread
        # mix = Qs^T P^-1 (3 x m); inner = I - Qs^T P^-1 Qs
        for r in range(3):
            for j in range(m):
                f.mix[r][j] = f.load[0][r] * self.precision[0, j] + f.load[1][r] * self.precision[1, j] \
                    + f.load[2][r] * self.precision[f.third, j]
        for r in range(3):
            for k in range(3):
                total = f.mix[r][0] * f.load[0][k] + f.mix[r][1] * f.load[1][k] + f.mix[r][f.third] * f.load[2][k]
                inner[r * 3 + k] = (1.0 if r == k else 0.0) - total
        if cholesky(inner, 3):
            return 1
        # back: rows of F^-1 Qs chol(I - Qs^T P^-1 Qs)
        for i in range(3):
            for r in range(3):
                f.back[i][r] = f.load[i][0] * inner[r] + f.load[i][1] * inner[3 + r] + f.load[i][2] * inner[6 + r]
        for r in range(3):
            f.back[0][r] -= dt * f.back[1][r]
            f.back[2][r] /= rho
        # decays of the residual states
        g0 = exp(-self.offset_rate * dt)
        gp = exp(-self.personal_rate * dt)
        decay = exp(-self.fast_rate * dt)
        f.dt, f.rho = dt, rho
        f.f11 = decay * (1 + self.fast_rate * dt)
        f.f12 = decay * dt
        f.f21 = -decay * self.fast_rate * self.fast_rate * dt
        f.f22 = decay * (1 - self.fast_rate * dt)
        for i in range(n):
            f.decay[i] = g0 if i == 0 else (1.0 if i < 3 else gp)
        f.renewal[0], f.renewal[1], f.renewal[2] = 1 - g0 * g0, 0, 1 - gp * gp
        self._bound()
        return 0

    cdef void _weights(self, double phase, double decay, double* s) noexcept nogil:
        """How the coefficients of the personal cycle enter an observation: s[3], s[4], ..."""
        cdef int k
        cdef double c = cos(phase), d = sin(phase), last
        cdef double ck = c, dk = d
        for k in range(self.harmonics):
            s[3 + 2 * k] = decay * ck
            s[4 + 2 * k] = decay * dk
            last = ck
            ck = ck * c - dk * d
            dk = dk * c + last * d

    cdef int _observe(self, const unsigned char[::1] observed, double dt) noexcept nogil:
        cdef int i, j, k, d, status, m = self.common
        cdef double squares = 0, logs, total
        cdef arrow* f = &self.f
        self.table.look_up(self.c[0], &f.at)
        f.w[0] = 1
        for j in range(self.styles):
            f.w[1 + j] = self.c[2 + j]
        f.s[0], f.s[1], f.s[2] = 1, 1, 0
        self._weights(self.c[0], 1.0, f.s)
        self._count(observed)
        arrow_sense(f, dt > 0)
        if (f.worst > self.limit * self.limit or self.doubting) and self._doubt(dt):
            arrow_sense(f, 0)
        status = self._solve(&squares)
        if status == 0 and self.rejected and squares > self.rest * self.seen:
            # the others are surprised as well: it is the motion, and those doubted just now have a say
            for d in range(self.channels):
                if observed[d] and not self._used[d] and self.doubt[d, 3]:
                    self._used[d] = 1
                    self.doubt[d, 0] = -1
                    self.rejected -= 1
                    self.seen += 1
            arrow_sense(f, 0)
            status = self._solve(&squares)
        if self.seen == 0:
            self.innovation, self.log_likelihood = NAN, 0
            return 0
        if status:
            return 1
        # log det of P^-1 before and after gives that of the innovation's covariance
        k = 0
        for i in range(m):
            for j in range(i + 1):
                self.precision[i, j] += total_of(&self.sums[4 * k])
                self.precision[j, i] = self.precision[i, j]
                k += 1
        total = -cholesky_inverse(&self.matrix[0, 0], &self.P[0, 0], m)
        logs = f.logs + total - self.log_precision
        self.log_precision = total
        self.innovation, self.log_determinant = squares / self.seen, logs
        self.log_likelihood = -0.5 * (squares + logs + self.seen * LOG_TWO_PI)
        for i in range(m):
            self.c[i] += f.delta[i]
        arrow_settle(f)
        self._bound()
        return 0

    cdef void _count(self, const unsigned char[::1] observed) noexcept nogil:
        """Believe what was observed."""
        cdef int d
        memcpy(&self._used[0], &observed[0], self.channels)
        self.seen = self.rejected = 0
        for d in range(self.channels):
            self.seen += self._used[d] != 0

    cdef int _solve(self, double* squares) noexcept nogil:
        """Change of the common state in information form, its precision's root in ``matrix``, and the innovation."""
        cdef int i, j, k = 0, m = self.common
        cdef arrow* f = &self.f
        squares[0] = total_of(&self.sums[4 * (m * (m + 1) // 2 + m)])
        if not squares[0] < 1e200:
            return 1
        for i in range(m):
            for j in range(i + 1):
                self.matrix[i, j] = self.precision[i, j] + total_of(&self.sums[4 * k])
                k += 1
        for i in range(m):
            self.work[i] = total_of(&self.sums[4 * (k + i)])
            f.delta[i] = self.work[i]
        if cholesky(&self.matrix[0, 0], m):
            return 1
        cholesky_solve(&self.matrix[0, 0], f.delta, m)
        for i in range(m):
            squares[0] -= f.delta[i] * self.work[i]
        return 0

    cdef int _mark(self, double squares, bint first) noexcept nogil:
        """Mark channels in ``used`` whose error has more than so many squared standard deviations; returns how many."""
        cdef int d, i, j, found = 0, m = self.common
        cdef int inverse = self.constants - 2  # row of a block; the error's follows, those of the derivatives lie before
        cdef double size, variance
        cdef const double* cell
        cdef const double* g
        cdef const double* P = &self.P[0, 0]
        for d in range(self.channels):
            if self._used[d] != 1 or not (self.whole or first or self.doubt[d, 0] >= 0):
                continue
            cell = self._cell(d, inverse)
            size = cell[LANES] * cell[LANES]
            if not size * cell[0] > squares:
                continue
            g = cell - (self.states + m) * LANES
            variance = 1 / cell[0]
            for i in range(m):
                for j in range(m):
                    variance += g[i * LANES] * P[i * m + j] * g[j * LANES]
            if size > squares * variance:
                self._used[d] = MARKED
                found += 1
        return found

    cdef bint _doubt(self, double dt) noexcept nogil:
        """Leave out of ``used`` what is not to be believed (see `believe`); returns whether anything changed."""
        cdef int d, out, variance = self.states * self.common  # row of the offset's
        cdef int inverse = self.constants - 2, error = inverse + 1
        cdef double apart, limit = self.limit * self.limit
        cdef bint changed = False
        out = self._mark(limit, dt == 0)
        if out:
            out += self._mark(SUSPECT * SUSPECT * limit, dt == 0)
        if out > self.few * self.seen and (out > 1 or self.seen < ALONE):
            for d in range(self.channels):
                self._used[d] = self._used[d] and not self.whole
            if self.whole:
                self.rejected, self.seen = self.seen, 0
            return self.whole
        self.doubting = False
        for d in range(self.channels):
            if self._used[d] == MARKED:
                apart = self._cell(d, error)[0] - self.doubt[d, 1]
                self.doubt[d, 3] = self.doubt[d, 0] < 0
                if self.doubt[d, 3] or apart * apart * self._cell(d, inverse)[0] > limit:
                    self.doubt[d, 0] = 0
                elif self.f.y[d] != self.doubt[d, 2]:
                    self.doubt[d, 0] += dt
                self.doubt[d, 1], self.doubt[d, 2] = self._cell(d, error)[0], self.f.y[d]
                self._used[d] = self.doubt[d, 0] >= BELIEVED_S
                if self._used[d]:
                    self._cell(d, variance)[0] += self.doubt[d, 1] * self.doubt[d, 1]
                else:
                    self.rejected += 1
                    self.seen -= 1
                changed = True
            if self._used[d]:
                self.doubt[d, 0] = -1
            elif self.doubt[d, 0] >= 0:
                self.doubting = True
        return changed

    cdef inline double* _cell(self, int channel, int row) noexcept nogil:
        return self._state(channel // LANES, row) + channel % LANES

    def predict(self, const double[::1] horizons, double[:, ::1] mean, double[:, ::1] std,
                double[:, ::1] velocity):
        """Predict observations.

        Parameters
        ----------
        horizons : ndarray, shape (H,)
            s. With more than nine in increasing order the standard deviation is evaluated at nine of them and
            linear in between.
        mean, std, velocity : ndarray, shape (H, D)
            Filled in.
        """
        self._plan(horizons)
        if horizons.shape[0]:
            self._predict(horizons, &mean[0, 0], &std[0, 0], &velocity[0, 0])

    cdef int _plan(self, const double[::1] horizons) except -1:
        """Get ready for a prediction; what depends on the horizons alone is kept for the next one."""
        cdef long h, H = horizons.shape[0]
        if not self.rooted and self._root():
            raise ArithmeticError('what was observed is too far from anything the model can represent')
        if H == self.planned and (H == 0 or memcmp(&horizons[0], &self.horizons[0], H * sizeof(double)) == 0):
            return 0
        check(horizons)
        self.planned = 0
        if self.horizons is None or self.horizons.shape[0] < H:
            self.horizons, self.paces = np.empty(H), np.empty(H * sizeof(pace) // sizeof(double))
        for h in range(H):
            self.horizons[h] = horizons[h]
            self._decays(horizons[h], <pace*>&self.paces[0] + h)
        self.planned = H
        return 0

    cdef void _predict(self, const double[::1] horizons, double* mean, double* std,
                       double* velocity) noexcept nogil:
        cdef int h, k, i, H = horizons.shape[0], last = -1, slot = 0
        cdef int knots = H if H <= KNOTS else KNOTS
        cdef long D = self.channels, size = (1 + self.styles) * self.table.width
        cdef double* where[9]
        cdef const pace* paces = <pace*>&self.paces[0]
        for h in range(1, H):
            if horizons[h] < horizons[h - 1]:
                knots = H
        k = 0
        for h in range(H):
            self._ahead(paces + h, &self.times[slot])
            if h == (k * (H - 1) // (knots - 1) if knots > 1 else 0):
                k += 1
                where[slot] = std + h * D
                arrow_mean(&self.f, &self.times[slot], mean + h * D, velocity + h * D, &self.rows[slot * size])
                slot += 1
                if slot == KNOTS or h == H - 1:
                    arrow_spread(&self.f, self.times, slot, &self.rows[0], where)
                    slot = 0
            else:
                arrow_mean(&self.f, &self.times[slot], mean + h * D, velocity + h * D, NULL)
        if knots < H:
            last = 0
            for k in range(1, knots):
                h = k * (H - 1) // (knots - 1)
                for i in range(last + 1, h):
                    between((horizons[i] - horizons[last]) / (horizons[h] - horizons[last]), std + last * D,
                            std + h * D, std + i * D, D)
                last = h

    def ahead(self, const double[::1] horizons):
        """`predict` into new arrays: mean, std and velocity."""
        cdef long H = horizons.shape[0]
        self._plan(horizons)
        out = empty((3, H, self.channels))
        cdef double[:, :, ::1] memory = out
        if H:
            self._predict(horizons, &memory[0, 0, 0], &memory[1, 0, 0], &memory[2, 0, 0])
        return out[0], out[1], out[2]

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

    cdef void _decays(self, double ahead, pace* x) noexcept nogil:
        """What is left of today's states after a time."""
        x.ahead = ahead
        x.style, x.offset = exp(-self.style_rate * ahead), exp(-self.offset_rate * ahead)
        x.personal, x.fast = exp(-self.personal_rate * ahead), exp(-self.fast_rate * ahead)

    cdef void _ahead(self, const pace* p, horizon* x) noexcept nogil:
        """Where a time ahead looks the table up, and how today's states enter it."""
        cdef int j
        cdef double ahead = p.ahead, rho = p.style, g0 = p.offset, gp = p.personal, decay = p.fast
        cdef double phase = self.c[0] + ahead * self.c[1], r2 = self.fast_rate * self.fast_rate
        x.speed = self.c[1]
        if not self.table.rhythmic and (phase >= 1 or phase <= 0):
            phase = 1 if phase >= 1 else 0
            x.speed = 0
        self.table.look_up(phase, &x.at)
        x.w[0] = 1
        for j in range(self.styles):
            x.w[1 + j] = rho * self.c[2 + j]
        x.s[0] = g0
        x.s[1], x.s[2] = decay * (1 + self.fast_rate * ahead), decay * ahead
        self._weights(phase, gp, x.s)
        x.f21, x.f22 = -decay * r2 * ahead, decay * (1 - self.fast_rate * ahead)
        x.ahead, x.rho = ahead, rho
        x.offset_rate, x.personal_rate, x.style_rate = self.offset_rate, self.personal_rate, self.style_rate
        x.q_offset, x.q_fast = 1 - g0 * g0, 1 - x.s[1] * x.s[1] - r2 * x.s[2] * x.s[2]
        x.q_personal, x.wander = 1 - gp * gp, self.acceleration * ahead * ahead * ahead / 3
