"""Filters over phase and style, one call an update and one a prediction.

`PaperFilter` is the method of Matsubara et al. (2012): an EKF over phase and phase velocity, on-line EM for the
style. `ArrowFilter` is the full filter: phase, phase velocity and style are common to all channels, and every
channel has residual states of its own that are independent of the other channels' given the common state. The
joint precision then has the shape of an arrow, and everything costs a multiple of the number of channels.
The equations are derived in docs/phase_style.md.

Arrays run over channels in their last axis, so that the inner loops are element-wise and vectorise.
"""
import numpy as np

from libc.math cimport NAN, cos, exp, floor, log, sin, sqrt

cdef extern from *:
    """
    /* Element-wise loops, compiled for AVX2 too where the compiler can choose at run time; without fused
       multiply-add both give the same bits. */
    #if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__gnu_linux__)
    #define STYLE_CLONES __attribute__((target_clones("avx2", "default")))
    #else
    #define STYLE_CLONES
    #endif
    STYLE_CLONES static void hermite4(double a, const double *restrict p, double b, const double *restrict q,
                                      double c, const double *restrict r, double d, const double *restrict s,
                                      double *restrict out, int n)
    { for (int k = 0; k < n; k++) out[k] = (a * p[k] + b * q[k]) + (c * r[k] + d * s[k]); }
    STYLE_CLONES static void axpy(double a, const double *restrict x, double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] += a * x[k]; }
    STYLE_CLONES static void axpy2(double a, const double *restrict x, double b, const double *restrict z,
                                   double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] += a * x[k] + b * z[k]; }
    STYLE_CLONES static void scale(double a, const double *restrict x, double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] = a * x[k]; }
    STYLE_CLONES static void product_add(double a, const double *restrict x, const double *restrict z,
                                         double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] += a * x[k] * z[k]; }
    STYLE_CLONES static void product_subtract(const double *restrict x, const double *restrict z,
                                              double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] -= x[k] * z[k]; }
    STYLE_CLONES static void product(const double *restrict x, const double *restrict z, double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] = x[k] * z[k]; }
    STYLE_CLONES static void square_add(const double *restrict x, double *restrict y, int n)
    { for (int k = 0; k < n; k++) y[k] += x[k] * x[k]; }
    /* out += sum_c coefficient[c] * base[c * stride + .], four at a time to spare the traffic of out */
    STYLE_CLONES static void combine(const double *restrict coefficient, const double *restrict base, long stride,
                                     int count, double *restrict out, int n)
    {
        int c = 0;
        for (; c + 3 < count; c += 4) {
            double a0 = coefficient[c], a1 = coefficient[c + 1], a2 = coefficient[c + 2], a3 = coefficient[c + 3];
            const double *x0 = base + c * stride, *x1 = x0 + stride, *x2 = x1 + stride, *x3 = x2 + stride;
            for (int k = 0; k < n; k++)
                out[k] = (((out[k] + a0 * x0[k]) + a1 * x1[k]) + a2 * x2[k]) + a3 * x3[k];
        }
        for (; c < count; c++) {
            double a0 = coefficient[c];
            const double *x0 = base + c * stride;
            for (int k = 0; k < n; k++) out[k] += a0 * x0[k];
        }
    }
    /* weighted sums over bases of the cubic between two nodes, and of its slope */
    STYLE_CLONES static void hermite_sums(const double *restrict weight, int count, const double *restrict h,
                                          const double *restrict p, const double *restrict q,
                                          const double *restrict r, const double *restrict s,
                                          double *restrict value, double *restrict slope, int n)
    {
        for (int k = 0; k < n; k++) value[k] = slope[k] = 0;
        for (int c = 0; c < count; c++, p += n, q += n, r += n, s += n) {
            double w = weight[c];
            double v0 = w * h[0], v1 = w * h[1], v2 = w * h[2], v3 = w * h[3];
            double g0 = w * h[4], g1 = w * h[5], g2 = w * h[6], g3 = w * h[7];
            for (int k = 0; k < n; k++) {
                value[k] += (v0 * p[k] + v1 * q[k]) + (v2 * r[k] + v3 * s[k]);
                slope[k] += (g0 * p[k] + g1 * q[k]) + (g2 * r[k] + g3 * s[k]);
            }
        }
    }
    STYLE_CLONES static double dot(const double *restrict x, const double *restrict y, int n)
    {
        double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
        int k = 0;
        for (; k + 3 < n; k += 4) {
            s0 += x[k] * y[k]; s1 += x[k + 1] * y[k + 1]; s2 += x[k + 2] * y[k + 2]; s3 += x[k + 3] * y[k + 3];
        }
        for (; k < n; k++) s0 += x[k] * y[k];
        return (s0 + s1) + (s2 + s3);
    }
    """
    void hermite4(double, const double*, double, const double*, double, const double*, double, const double*,
                  double*, int) noexcept nogil
    void combine(const double*, const double*, long, int, double*, int) noexcept nogil
    void hermite_sums(const double*, int, const double*, const double*, const double*, const double*, const double*,
                      double*, double*, int) noexcept nogil
    void axpy(double, const double*, double*, int) noexcept nogil
    void axpy2(double, const double*, double, const double*, double*, int) noexcept nogil
    void scale(double, const double*, double*, int) noexcept nogil
    void product_add(double, const double*, const double*, double*, int) noexcept nogil
    void product_subtract(const double*, const double*, double*, int) noexcept nogil
    void product(const double*, const double*, double*, int) noexcept nogil
    void square_add(const double*, double*, int) noexcept nogil
    double dot(const double*, const double*, int) noexcept nogil

cdef double TWO_PI = 6.283185307179586
#: Distance of the samples that the noise is a variance of, s: at higher rates it stays as dense in time.
cdef double NOISE_STEP_S = 1 / 60.0 - 1e-6
#: Standard deviations are evaluated at so many of the horizons, evenly chosen with both ends, and interpolated.
cdef int KNOTS = 9
cdef double LOG_TWO_PI = 1.8378770664093453


cdef inline double wrapped(double phase) noexcept nogil:
    phase = phase - TWO_PI * floor(phase / TWO_PI)
    return phase if phase < TWO_PI else 0.0


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


cdef void cholesky_inverse(const double* factor, double* out, int n) noexcept nogil:
    cdef int i, j
    cdef double column[64]
    for j in range(n):
        for i in range(n):
            column[i] = 1.0 if i == j else 0.0
        cholesky_solve(factor, column, n)
        for i in range(n):
            out[i * n + j] = column[i]


cdef class Table:
    """A `BasisTable` ready for look-ups."""

    cdef readonly int count, channels, nodes
    cdef readonly bint rhythmic
    cdef const double[:, :, ::1] values, slopes
    cdef const double[:, ::1] variances

    def __init__(self, table):
        self.values = table.values
        self.slopes = table.slopes
        self.variances = table.variance
        self.rhythmic = table.rhythmic
        self.nodes = table.values.shape[0] - 1
        self.count = table.values.shape[1]
        self.channels = table.values.shape[2]

    cdef void _place(self, double phase, int* node, double* part, double* rate) noexcept nogil:
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

    cdef void look_up(self, double phase, double* value, double* slope) noexcept nogil:
        """Bases (J, D) and, unless NULL, their derivatives by phase (J, D)."""
        cdef int node, size = self.count * self.channels
        cdef double u, rate, a, b, c, d
        cdef const double *v0
        cdef const double *v1
        cdef const double *s0
        cdef const double *s1
        self._place(phase, &node, &u, &rate)
        v0 = &self.values[node, 0, 0]
        v1 = &self.values[node + 1, 0, 0]
        s0 = &self.slopes[node, 0, 0]
        s1 = &self.slopes[node + 1, 0, 0]
        a = (1 + 2 * u) * (1 - u) * (1 - u)
        b = u * (1 - u) * (1 - u)
        c = u * u * (3 - 2 * u)
        d = u * u * (u - 1)
        hermite4(a, v0, b, s0, c, v1, d, s1, value, size)
        if slope != NULL:
            a = 6 * u * (u - 1) * rate
            b = (1 - u) * (1 - 3 * u) * rate
            c = -a
            d = u * (3 * u - 2) * rate
            hermite4(a, v0, b, s0, c, v1, d, s1, slope, size)

    cdef void weighted(self, double phase, const double* weight, double* value, double* slope) noexcept nogil:
        """``sum_j weight_j`` times basis j and times its derivative, each (D,)."""
        cdef int node
        cdef double u, rate
        cdef double h[8]
        self._place(phase, &node, &u, &rate)
        h[0] = (1 + 2 * u) * (1 - u) * (1 - u)
        h[1] = u * (1 - u) * (1 - u)
        h[2] = u * u * (3 - 2 * u)
        h[3] = u * u * (u - 1)
        h[4] = 6 * u * (u - 1) * rate
        h[5] = (1 - u) * (1 - 3 * u) * rate
        h[6] = -h[4]
        h[7] = u * (3 * u - 2) * rate
        hermite_sums(weight, self.count, h, &self.values[node, 0, 0], &self.slopes[node, 0, 0],
                     &self.values[node + 1, 0, 0], &self.slopes[node + 1, 0, 0], value, slope, self.channels)

    cdef double variance(self, double phase, const double* weight) noexcept nogil:
        """Eq. (13): ``sum_j weight_j^2 variance_j``, linear between nodes."""
        cdef int node, j
        cdef double u, rate, total = 0
        self._place(phase, &node, &u, &rate)
        for j in range(self.count):
            total += weight[j] * weight[j] * ((1 - u) * self.variances[node, j] + u * self.variances[node + 1, j])
        return total

    def evaluate(self, double phase):
        """Bases and derivatives at one phase, each (J, D)."""
        cdef double[:, ::1] value = np.empty((self.count, self.channels))
        cdef double[:, ::1] slope = np.empty((self.count, self.channels))
        self.look_up(phase, &value[0, 0], &slope[0, 0])
        return np.asarray(value), np.asarray(slope)


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
    cdef double p00, p01, p11, acceleration, log_forgetting, rate, share
    cdef readonly double learning_rate
    cdef int count, channels
    cdef const double[::1] noise
    cdef double[::1] w, moment
    cdef double[:, ::1] normal, noisy, value, work, spread
    cdef double[::1] mean, tangent, variance, seen, clean, scratch

    def __init__(self, Table table, noise, double acceleration, style, double forgetting, double step):
        self.table = table
        self.count, self.channels = table.count, table.channels
        self.noise = noise
        self.acceleration = acceleration
        self.log_forgetting = log(forgetting) / step
        self.w = np.array(style, dtype=float)
        self.moment = np.zeros(self.count)
        self.normal = np.zeros((self.count, self.count))
        self.noisy = np.zeros((self.count, self.count))
        self.work = np.zeros((self.count, self.count))
        self.spread = np.zeros((self.count, self.count))
        self.value = np.zeros((self.count, self.channels))
        self.seen = np.zeros(self.channels)
        self.clean = np.zeros(self.channels)
        self.scratch = np.zeros(self.count)
        self.mean = np.zeros(self.channels)
        self.tangent = np.zeros(self.channels)
        self.variance = np.zeros(self.channels)
        self.learning_rate = 0
        self.share = 0

    def start(self, double phase, double velocity, double phase_variance, double velocity_variance):
        """Set the phase and its velocity, uncorrelated."""
        self.phase, self.velocity = phase, velocity
        self.p00, self.p01, self.p11 = phase_variance, 0, velocity_variance

    @property
    def covariance(self):
        return np.array([[self.p00, self.p01], [self.p01, self.p11]])

    @property
    def style(self):
        return np.array(self.w)

    @property
    def style_covariance(self):
        """Covariance of the weighted least-squares style, shape (J, J); infinite before the first update."""
        if self.learning_rate == 0:
            return np.full((self.count, self.count), np.inf)
        return 0.5 * (np.asarray(self.spread) + np.asarray(self.spread).T)

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
        cdef int d, i, j, seen = 0, J = self.count, n = self.channels
        cdef double q = self.acceleration, information = 0, score = 0, squares = 0, logs = 0
        cdef double error, inverse, extra, gain, k0, k1, eta
        with nogil:
            self.phase += dt * self.velocity
            self.p00 += dt * (2 * self.p01 + dt * self.p11) + q * dt * dt * dt / 3
            self.p01 += dt * self.p11 + q * dt * dt / 2
            self.p11 += q * dt
            self._bound()
            self.table.weighted(self.phase, &self.w[0], &self.mean[0], &self.tangent[0])
            extra = self.table.variance(self.phase, &self.w[0])
            for d in range(n):
                self.seen[d] = 1 if observed[d] else 0
                self.clean[d] = y[d] if observed[d] else 0
                if not observed[d]:
                    continue
                seen += 1
                error = y[d] - self.mean[d]
                inverse = 1 / (self.noise[d] + extra)
                information += self.tangent[d] * self.tangent[d] * inverse
                score += self.tangent[d] * error * inverse
                squares += error * error * inverse
                logs -= log(inverse)
            gain = 1 / (1 + self.p00 * information)
            k0, k1 = self.p00 * gain, self.p01 * gain
            self.phase += k0 * score
            self.velocity += k1 * score
            self.p11 -= self.p01 * k1 * information
            self.p01 *= gain
            self.p00 *= gain
            squares -= k0 * score * score
            self.innovation = squares / seen if seen else NAN
            self.log_likelihood = -0.5 * (squares + logs - log(gain) + seen * LOG_TWO_PI)
            self._bound()
            if seen and learn:
                self.table.look_up(self.phase, &self.value[0, 0], NULL)
                if self.learning_rate == 0:
                    eta = 1
                else:
                    eta = 1 / (1 + exp(self.log_forgetting * dt) / self.learning_rate)
                self.learning_rate = eta
                self.share = (1 - eta) * (1 - eta) * self.share + eta * eta
                for i in range(J):
                    product(&self.value[i, 0], &self.seen[0], &self.mean[0], n)
                    self.moment[i] += eta * (dot(&self.mean[0], &self.clean[0], n) - self.moment[i])
                    product(&self.mean[0], &self.noise[0], &self.tangent[0], n)
                    for j in range(i + 1):
                        self.normal[i, j] += eta * (dot(&self.mean[0], &self.value[j, 0], n) - self.normal[i, j])
                        self.normal[j, i] = self.normal[i, j]
                        self.noisy[i, j] += eta * (dot(&self.tangent[0], &self.value[j, 0], n) - self.noisy[i, j])
                        self.noisy[j, i] = self.noisy[i, j]
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
            self.scratch[i] = self.moment[i] + ridge * self.w[i]
        cholesky_solve(&self.work[0, 0], &self.scratch[0], J)
        for i in range(J):
            self.w[i] = self.scratch[i]
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
        cdef int h, d, i, j, J = self.count, n = self.channels
        cdef double ahead, phase, speed, extra, phase_variance
        with nogil:
            for h in range(horizons.shape[0]):
                ahead = horizons[h]
                phase = self.phase + ahead * self.velocity
                speed = self.velocity
                if not self.table.rhythmic:
                    if phase >= 1 or phase <= 0:
                        phase = 1 if phase >= 1 else 0
                        speed = 0
                self.table.look_up(phase, &self.value[0, 0], NULL)
                self.table.weighted(phase, &self.w[0], &mean[h, 0], &self.tangent[0])
                extra = self.table.variance(phase, &self.w[0])
                phase_variance = self.p00 + ahead * (2 * self.p01 + ahead * self.p11) \
                    + self.acceleration * ahead * ahead * ahead / 3
                for d in range(n):
                    self.variance[d] = self.noise[d] + extra + phase_variance * self.tangent[d] * self.tangent[d]
                    velocity[h, d] = speed * self.tangent[d]
                for i in range(J):
                    scale(self.spread[i, i], &self.value[i, 0], &self.clean[0], n)
                    for j in range(i):
                        self.scratch[j] = self.spread[i, j] + self.spread[j, i]
                    combine(&self.scratch[0], &self.value[0, 0], n, i, &self.clean[0], n)
                    product_add(1.0, &self.clean[0], &self.value[i, 0], &self.variance[0], n)
                for d in range(n):
                    std[h, d] = sqrt(self.variance[d]) if self.variance[d] > 0 else 0


cdef class ArrowFilter:
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
    """

    cdef readonly Table table
    cdef readonly double innovation, log_likelihood
    cdef readonly int styles, states, channels, common, harmonics
    cdef double offset_rate, fast_rate, personal_rate, style_rate, acceleration, lowest, highest
    cdef const double[::1] offset, fast, noise
    cdef const double[:, ::1] personal
    cdef double[::1] c, age, work, delta
    cdef double[:, ::1] P, precision, matrix, factor
    cdef double[:, ::1] u
    cdef double[:, :, ::1] A, V
    cdef double[:, ::1] value, g, wide, gain, vs
    cdef double[::1] slope, error, inverse, row, s, doubled
    cdef int turn
    cdef bint fresh
    cdef double thin            # samples that come faster than those the noise was learned from repeat its errors

    def __init__(self, Table table, offset, fast, personal, noise, rates, double acceleration, bounds):
        cdef int n, m, D
        self.table = table
        self.styles = table.count - 1
        self.channels = D = table.channels
        self.offset = np.ascontiguousarray(offset, dtype=float)
        self.fast = np.ascontiguousarray(fast, dtype=float)
        self.personal = np.ascontiguousarray(personal, dtype=float).reshape(-1, D)
        self.noise = np.ascontiguousarray(noise, dtype=float)
        self.harmonics = self.personal.shape[0]
        self.states = n = 3 + 2 * self.harmonics
        self.common = m = 2 + self.styles
        if m > 60:
            raise ValueError(f'at most 58 styles, got {self.styles}')
        self.offset_rate, self.fast_rate, self.personal_rate, self.style_rate = rates
        self.acceleration = acceleration
        self.lowest, self.highest = bounds
        self.c, self.work, self.delta = np.zeros(m), np.zeros(m), np.zeros(m)
        self.age = np.zeros(max(self.styles, 1))
        self.P, self.precision, self.matrix, self.factor = (np.zeros((m, m)) for _ in range(4))
        self.u = np.zeros((n, D))
        self.A, self.V = np.zeros((n, m, D)), np.zeros((n, n, D))
        self.value, self.g, self.wide = np.zeros((m, D)), np.zeros((m, D)), np.zeros((max(n, m) * 3, D))
        self.gain, self.vs = np.zeros((n, D)), np.zeros((n, D))
        self.slope, self.error, self.inverse, self.row = (np.zeros(D) for _ in range(4))
        self.s, self.doubled = np.zeros(n + 1), np.zeros(n)
        self.turn = 0
        self.start(0.0, 0.5 * (self.lowest + self.highest), 1.0, 1.0)

    def start(self, double phase, double velocity, double phase_variance, double velocity_variance):
        """Begin anew: style and residual states at their priors, a covariance of any correlation forgotten."""
        cdef int a, d, k
        self.c[:] = 0
        self.P[:, :] = 0
        for a in range(self.common):
            self.P[a, a] = 1
        self.c[0], self.c[1] = phase, velocity
        self.P[0, 0], self.P[1, 1] = phase_variance, velocity_variance
        self.age[:] = 0
        self.u[:, :] = 0
        self.A[:, :, :] = 0
        self.V[:, :, :] = 0
        for d in range(self.channels):
            self.V[0, 0, d] = self.offset[d]
            self.V[1, 1, d] = self.fast[d]
            self.V[2, 2, d] = self.fast[d] * self.fast_rate * self.fast_rate
            for k in range(self.harmonics):
                self.V[3 + 2 * k, 3 + 2 * k, d] = self.personal[k, d]
                self.V[4 + 2 * k, 4 + 2 * k, d] = self.personal[k, d]
        self.innovation, self.log_likelihood = NAN, 0
        self.fresh = False
        self.turn = 0
        self._bound()

    @property
    def state(self):
        """Mean of the common state, shape (2 + J,)."""
        return np.array(self.c)

    @property
    def covariance(self):
        """Covariance of the common state, shape (2 + J, 2 + J)."""
        return np.array(self.P)

    def describe(self, const double[::1] centre, const double[:, ::1] root):
        """Phase, velocity, their covariance (2, 2), style (J,) = ``centre + root z`` and its covariance (J, J)."""
        cdef int i, j, k, J = self.styles
        cdef double total
        cdef double[:, ::1] phase = np.empty((2, 2)), covariance = np.empty((J, J))
        cdef double[::1] style = np.empty(J)
        for i in range(2):
            for j in range(2):
                phase[i, j] = self.P[i, j]
        for i in range(J):
            style[i] = centre[i]
            for k in range(J):
                style[i] += root[i, k] * self.c[2 + k]
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
                covariance[i, j] = total
        return self.c[0], self.c[1], phase.base, style.base, covariance.base

    @property
    def residuals(self):
        """Mean of the residual states, shape (3 + 2 K, D)."""
        return np.array(self.u)

    def marginal(self, int channel):
        """Mean and covariance of (c, u_d), of length 2 + J + 3 + 2 K."""
        A = np.array(self.A[:, :, channel])
        V = np.array(self.V[:, :, channel])
        V = np.tril(V) + np.tril(V, -1).T
        P = self.covariance
        cross = A @ P
        return (np.concatenate([self.state, self.u[:, channel]]),
                np.block([[P, cross.T], [cross, V + cross @ A.T]]))

    cdef void _bound(self) noexcept nogil:
        if self.table.rhythmic:
            self.c[0] = wrapped(self.c[0])
        elif self.c[0] < 0:
            self.c[0] = 0
        elif self.c[0] > 1:
            self.c[0] = 1
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
        cholesky_inverse(&self.matrix[0, 0], &self.precision[0, 0], m)
        return 0

    def update(self, const double[::1] y, const unsigned char[::1] observed, double dt):
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
        self.thin = NOISE_STEP_S / dt if 0 < dt < NOISE_STEP_S else 1.0
        with nogil:
            status = 0
            if dt > 0:
                status = self._advance(dt)
            if status == 0:
                status = self._observe(&y[0], &observed[0])
        if status:
            raise ArithmeticError('what was observed is too far from anything the model can represent')

    cdef int _advance(self, double dt) noexcept nogil:
        cdef int i, j, a, b, k, r, m = self.common, n = self.states, D = self.channels, drift = -1
        cdef double l11, l21, l22, root, rho = 1, spread = 0, total, q
        cdef double load[3][3]      # square root of Q in the rows phase, velocity, drifting style
        cdef double inner[9]
        cdef double back[3][3]      # rows of F^-1 Qs chol(I - Qs^T P^-1 Qs)
        cdef int rows[3]
        cdef double mix[3][64]
        cdef double f11, f12, f21, f22, g0, gp, decay, ga, gb
        cdef double* AL
        # common state: F, then Q
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
        rows[0], rows[1], rows[2] = 0, 1, 2 + drift if drift >= 0 else 0
        for i in range(3):
            for j in range(3):
                load[i][j] = 0
        load[0][0], load[1][0], load[1][1], load[2][2] = l11, l21, l22, spread if drift >= 0 else 0
        # mix = Qs^T P^-1 (3 x m); inner = I - Qs^T P^-1 Qs
        for r in range(3):
            for j in range(m):
                mix[r][j] = load[0][r] * self.precision[0, j] + load[1][r] * self.precision[1, j] \
                    + load[2][r] * self.precision[rows[2], j]
        for r in range(3):
            for k in range(3):
                total = mix[r][0] * load[0][k] + mix[r][1] * load[1][k] + mix[r][rows[2]] * load[2][k]
                inner[r * 3 + k] = (1.0 if r == k else 0.0) - total
        if cholesky(inner, 3):
            return 1
        for i in range(3):
            for r in range(3):
                back[i][r] = load[i][0] * inner[r] + load[i][1] * inner[3 + r] + load[i][2] * inner[6 + r]
        for r in range(3):  # F^-1 on the rows phase and drifting style
            back[0][r] -= dt * back[1][r]
            back[2][r] /= rho
        # decays of the residual states
        g0 = exp(-self.offset_rate * dt)
        gp = exp(-self.personal_rate * dt)
        decay = exp(-self.fast_rate * dt)
        f11 = decay * (1 + self.fast_rate * dt)
        f12 = decay * dt
        f21 = -decay * self.fast_rate * self.fast_rate * dt
        f22 = decay * (1 - self.fast_rate * dt)
        AL = &self.wide[0, 0]  # (n, 3, D): A times the part of c that the new c does not tell
        for a in range(n):
            for r in range(3):
                scale(back[0][r], &self.A[a, 0, 0], AL + (a * 3 + r) * D, D)
                axpy(back[1][r], &self.A[a, 1, 0], AL + (a * 3 + r) * D, D)
                if drift >= 0:
                    axpy(back[2][r], &self.A[a, rows[2], 0], AL + (a * 3 + r) * D, D)
        for a in range(n):
            for b in range(a + 1):
                for r in range(3):
                    product_add(1.0, AL + (a * 3 + r) * D, AL + (b * 3 + r) * D, &self.V[a, b, 0], D)
        # A <- A F^-1 (I - Qs Qs^T P^-1)
        for a in range(n):
            axpy(-dt, &self.A[a, 0, 0], &self.A[a, 1, 0], D)
            if drift >= 0 and rho < 1:
                scale(1 / rho, &self.A[a, rows[2], 0], AL, D)
                scale(1.0, AL, &self.A[a, rows[2], 0], D)
            for r in range(3):
                scale(load[0][r], &self.A[a, 0, 0], AL + r * D, D)
                axpy(load[1][r], &self.A[a, 1, 0], AL + r * D, D)
                if drift >= 0:
                    axpy(load[2][r], &self.A[a, rows[2], 0], AL + r * D, D)
            for i in range(m):
                for r in range(3):
                    inner[r] = -mix[r][i]
                combine(inner, AL, D, 3 if drift >= 0 else 2, &self.A[a, i, 0], D)
        # A <- G A, u <- G u
        for i in range(-1, m):
            for a in range(n):
                if a == 1:
                    self._rotate(f11, f12, f21, f22, self._part(1, i), self._part(2, i))
                elif a != 2:
                    scale(g0 if a == 0 else gp, self._part(a, i), &self.row[0], D)
                    scale(1.0, &self.row[0], self._part(a, i), D)
        # V <- G V G^T + Q
        for a in range(n):
            ga = g0 if a == 0 else gp
            for b in range(a + 1):
                gb = g0 if b == 0 else gp
                if a == 1 or a == 2 or b == 1 or b == 2:
                    continue
                scale(ga * gb, &self.V[a, b, 0], &self.row[0], D)
                scale(1.0, &self.row[0], &self.V[a, b, 0], D)
        self._rotate(f11 * g0, f12 * g0, f21 * g0, f22 * g0, &self.V[1, 0, 0], &self.V[2, 0, 0])
        for a in range(3, n):
            self._rotate(f11 * gp, f12 * gp, f21 * gp, f22 * gp, &self.V[a, 1, 0], &self.V[a, 2, 0])
        self._fast_block(f11, f12, f21, f22)
        axpy(1 - g0 * g0, &self.offset[0], &self.V[0, 0, 0], D)
        for k in range(self.harmonics):
            axpy(1 - gp * gp, &self.personal[k, 0], &self.V[3 + 2 * k, 3 + 2 * k, 0], D)
            axpy(1 - gp * gp, &self.personal[k, 0], &self.V[4 + 2 * k, 4 + 2 * k, 0], D)
        self._bound()
        return 0

    cdef inline double* _part(self, int a, int i) noexcept nogil:
        """Row a of A's column i, or of u for i = -1."""
        return &self.u[a, 0] if i < 0 else &self.A[a, i, 0]

    cdef void _rotate(self, double f11, double f12, double f21, double f22, double* x, double* z) noexcept nogil:
        cdef int D = self.channels
        scale(f11, x, &self.row[0], D)
        axpy(f12, z, &self.row[0], D)
        scale(f22, z, &self.error[0], D)
        axpy(f21, x, &self.error[0], D)
        scale(1.0, &self.row[0], x, D)
        scale(1.0, &self.error[0], z, D)

    cdef void _fast_block(self, double f11, double f12, double f21, double f22) noexcept nogil:
        """The 2 x 2 block of the fast residual: V <- F V F^T + fast (S - F S F^T), S = diag(1, rate^2)."""
        cdef int d
        cdef double v11, v21, v22, r2 = self.fast_rate * self.fast_rate
        cdef double q11 = 1 - f11 * f11 - r2 * f12 * f12
        cdef double q21 = -f21 * f11 - r2 * f22 * f12
        cdef double q22 = r2 - f21 * f21 - r2 * f22 * f22
        for d in range(self.channels):
            v11, v21, v22 = self.V[1, 1, d], self.V[2, 1, d], self.V[2, 2, d]
            self.V[1, 1, d] = f11 * f11 * v11 + 2 * f11 * f12 * v21 + f12 * f12 * v22 + q11 * self.fast[d]
            self.V[2, 1, d] = f21 * f11 * v11 + (f21 * f12 + f22 * f11) * v21 + f22 * f12 * v22 + q21 * self.fast[d]
            self.V[2, 2, d] = f21 * f21 * v11 + 2 * f21 * f22 * v21 + f22 * f22 * v22 + q22 * self.fast[d]

    cdef void _weights(self, double phase) noexcept nogil:
        """How the residual states enter an observation."""
        cdef int k
        self.s[0], self.s[1], self.s[2] = 1, 1, 0
        for k in range(self.harmonics):
            self.s[3 + 2 * k] = cos((k + 1) * phase)
            self.s[4 + 2 * k] = sin((k + 1) * phase)

    cdef void _linearise(self, double phase) noexcept nogil:
        """Bases in ``value`` (mean first), expected observation in ``row``, its whole derivative by phase in
        ``slope``, weights of the residual states in ``s``."""
        cdef int k
        self.table.look_up(phase, &self.value[0, 0], NULL)
        self.work[0] = 1
        for k in range(self.styles):
            self.work[1 + k] = self.c[2 + k]
        self.table.weighted(phase, &self.work[0], &self.row[0], &self.slope[0])
        self._weights(phase)
        for k in range(self.harmonics):
            axpy2(-(k + 1) * self.s[4 + 2 * k], &self.u[3 + 2 * k, 0],
                  (k + 1) * self.s[3 + 2 * k], &self.u[4 + 2 * k, 0], &self.slope[0], self.channels)
        combine(&self.s[0], &self.u[0, 0], self.channels, self.states, &self.row[0], self.channels)

    cdef int _observe(self, const double* y, const unsigned char* observed) noexcept nogil:
        cdef int i, j, a, b, d, m = self.common, n = self.states, D = self.channels, seen = 0
        cdef double squares = 0, logs = 0, total
        self._linearise(self.c[0])
        # sensitivity to the common state, directly and through what it tells of the residual states
        scale(1.0, &self.slope[0], &self.g[0, 0], D)
        scale(0.0, &self.slope[0], &self.g[1, 0], D)
        for j in range(self.styles):
            scale(1.0, &self.value[1 + j, 0], &self.g[2 + j, 0], D)
        for i in range(m):
            combine(&self.s[0], &self.A[0, i, 0], m * D, n, &self.g[i, 0], D)
        # V s and the innovation's variance given the common state
        scale(self.thin, &self.noise[0], &self.inverse[0], D)
        for a in range(n):
            scale(self.s[0], &self.V[a, 0, 0], &self.vs[a, 0], D)  # V is stored below its diagonal
            combine(&self.s[1], &self.V[a, 1, 0], D, a, &self.vs[a, 0], D)
            combine(&self.s[a + 1], &self.V[a + 1 if a + 1 < n else a, a, 0], n * D, n - 1 - a, &self.vs[a, 0], D)
            if a != 2:
                axpy(self.s[a], &self.vs[a, 0], &self.inverse[0], D)
        for d in range(D):
            if observed[d]:
                seen += 1
                logs += log(self.inverse[d])
                self.inverse[d] = 1 / self.inverse[d]
                self.error[d] = y[d] - self.row[d]
                squares += self.error[d] * self.error[d] * self.inverse[d]
            else:
                self.inverse[d] = 0
                self.error[d] = 0
        if seen == 0:
            self.innovation, self.log_likelihood = NAN, 0
            return 0
        if not squares < 1e200:
            return 1
        # common state in information form
        for i in range(m):
            product(&self.g[i, 0], &self.inverse[0], &self.row[0], D)
            self.delta[i] = dot(&self.row[0], &self.error[0], D)
            self.work[i] = self.delta[i]
            for j in range(i + 1):
                self.matrix[i, j] = dot(&self.row[0], &self.g[j, 0], D)
        # log det of P^-1 before and after gives that of the innovation's covariance
        for i in range(m):
            for j in range(i + 1):
                self.factor[i, j] = self.precision[i, j]
                self.matrix[i, j] += self.precision[i, j]
                self.matrix[j, i] = self.matrix[i, j]
        if cholesky(&self.factor[0, 0], m) or cholesky(&self.matrix[0, 0], m):
            return 1
        for i in range(m):
            logs += 2 * (log(self.matrix[i, i]) - log(self.factor[i, i]))
        cholesky_inverse(&self.matrix[0, 0], &self.P[0, 0], m)
        for i in range(m):
            for j in range(i):
                total = 0.5 * (self.P[i, j] + self.P[j, i])
                self.P[i, j] = total
                self.P[j, i] = total
        cholesky_solve(&self.matrix[0, 0], &self.delta[0], m)
        total = 0
        for i in range(m):
            total += self.delta[i] * self.work[i]
        squares -= total
        self.innovation = squares / seen
        self.log_likelihood = -0.5 * (squares + logs + seen * LOG_TWO_PI)
        # residual states given the new common state
        for i in range(m):
            self.c[i] += self.delta[i]
            axpy(-self.delta[i], &self.g[i, 0], &self.error[0], D)
        for a in range(n):
            product(&self.vs[a, 0], &self.inverse[0], &self.gain[a, 0], D)
            combine(&self.delta[0], &self.A[a, 0, 0], D, m, &self.u[a, 0], D)
            for i in range(m):
                product_subtract(&self.gain[a, 0], &self.g[i, 0], &self.A[a, i, 0], D)
            # (the error of a channel not observed may be anything: its gain is zero)
            product_add(1.0, &self.gain[a, 0], &self.error[0], &self.u[a, 0], D)
            for b in range(a + 1):
                product_subtract(&self.gain[a, 0], &self.vs[b, 0], &self.V[a, b, 0], D)
        self._bound()
        return 0

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
        cdef int h, k, d, H = horizons.shape[0], i, j, last = 0, D = self.channels
        cdef int knots = H if H <= KNOTS else KNOTS
        cdef double share
        for i in range(self.common):
            for j in range(self.common):
                self.factor[i, j] = self.P[i, j]
        if cholesky(&self.factor[0, 0], self.common):
            raise ArithmeticError('what was observed is too far from anything the model can represent')
        for h in range(1, H):
            if horizons[h] < horizons[h - 1]:
                knots = H
        with nogil:
            for k in range(knots):
                h = k * (H - 1) // (knots - 1) if knots > 1 else 0
                self._predict_one(horizons[h], &mean[h, 0], &std[h, 0], &velocity[h, 0], True)
                for i in range(last + 1, h):
                    self._predict_one(horizons[i], &mean[i, 0], &std[i, 0], &velocity[i, 0], False)
                    share = (horizons[i] - horizons[last]) / (horizons[h] - horizons[last])
                    scale(1 - share, &std[last, 0], &std[i, 0], D)
                    axpy(share, &std[h, 0], &std[i, 0], D)
                last = h

    cdef void _predict_one(self, double ahead, double* mean, double* std, double* velocity,
                           bint spread) noexcept nogil:
        cdef int i, j, a, b, k, d, m = self.common, n = self.states, D = self.channels
        cdef double phase = self.c[0] + ahead * self.c[1], speed = self.c[1]
        cdef double rho = exp(-self.style_rate * ahead), g0 = exp(-self.offset_rate * ahead)
        cdef double gp = exp(-self.personal_rate * ahead), decay = exp(-self.fast_rate * ahead)
        cdef double f11 = decay * (1 + self.fast_rate * ahead), f12 = decay * ahead
        cdef double f21 = -decay * self.fast_rate * self.fast_rate * ahead, f22 = decay * (1 - self.fast_rate * ahead)
        cdef double wander = self.acceleration * ahead * ahead * ahead / 3
        cdef double r2 = self.fast_rate * self.fast_rate
        cdef double q0 = 1 - g0 * g0, qf = 1 - f11 * f11 - r2 * f12 * f12, qp = 1 - gp * gp
        if not self.table.rhythmic and (phase >= 1 or phase <= 0):
            phase = 1 if phase >= 1 else 0
            speed = 0
        self.work[0] = 1
        for j in range(self.styles):
            self.work[1 + j] = rho * self.c[2 + j]
        self.table.weighted(phase, &self.work[0], mean, &self.slope[0])
        if spread or self.style_rate > 0:
            self.table.look_up(phase, &self.value[0, 0], NULL)
        self._weights(phase)
        # residual states: weights of today's states
        self.s[0] = g0
        self.s[1], self.s[2] = f11, f12
        for k in range(2 * self.harmonics):
            self.s[3 + k] *= gp
        for k in range(self.harmonics):
            axpy2(-(k + 1) * self.s[4 + 2 * k], &self.u[3 + 2 * k, 0],
                  (k + 1) * self.s[3 + 2 * k], &self.u[4 + 2 * k, 0], &self.slope[0], D)
        scale(speed, &self.slope[0], velocity, D)
        axpy2(f21, &self.u[1, 0], f22, &self.u[2, 0], velocity, D)
        axpy(-self.offset_rate * g0, &self.u[0, 0], velocity, D)
        for a in range(3, n):
            axpy(-self.personal_rate * self.s[a], &self.u[a, 0], velocity, D)
        if self.style_rate > 0:
            for j in range(self.styles):
                axpy(-self.style_rate * self.work[1 + j], &self.value[1 + j, 0], velocity, D)
        combine(&self.s[0], &self.u[0, 0], D, n, mean, D)
        if not spread:
            return
        scale(1.0, &self.slope[0], &self.g[0, 0], D)
        scale(ahead, &self.slope[0], &self.g[1, 0], D)
        for j in range(self.styles):
            scale(rho, &self.value[1 + j, 0], &self.g[2 + j, 0], D)
        for i in range(m):
            combine(&self.s[0], &self.A[0, i, 0], m * D, n, &self.g[i, 0], D)
        scale(1.0, &self.noise[0], std, D)
        axpy2(q0, &self.offset[0], qf, &self.fast[0], std, D)
        for k in range(self.harmonics):
            axpy(qp, &self.personal[k, 0], std, D)
        product_add(wander, &self.slope[0], &self.slope[0], std, D)
        if rho < 1:
            for j in range(self.styles):
                product_add(1 - rho * rho, &self.value[1 + j, 0], &self.value[1 + j, 0], std, D)
        for i in range(m):  # g^T P g with P = C C^T
            scale(self.factor[i, i], &self.g[i, 0], &self.row[0], D)
            for j in range(i + 1, m):
                self.delta[j] = self.factor[j, i]
            combine(&self.delta[i + 1 if i + 1 < m else i], &self.g[i + 1 if i + 1 < m else i, 0], D, m - 1 - i,
                    &self.row[0], D)
            square_add(&self.row[0], std, D)
        for a in range(n):
            scale(self.s[a], &self.V[a, a, 0], &self.row[0], D)
            for b in range(a):
                self.doubled[b] = 2 * self.s[b]
            combine(&self.doubled[0], &self.V[a, 0, 0], D, a, &self.row[0], D)
            axpy(self.s[a], &self.row[0], std, D)
        for d in range(D):
            std[d] = sqrt(std[d]) if std[d] > 0 else 0


def rank_phases(const double[:, ::1] mean, const double[:, ::1] posture, const double[::1] change,
                const double[:, ::1] y, const unsigned char[:, ::1] observed, const double[::1] back,
                double velocity, const double[::1] phases, bint rhythmic, double[::1] scores):
    """Rank phases at a quick glance: how well the mean motion explains the last samples.

    The deviation from the mean motion is split for every channel into its average over the samples (posture and
    style) and the rest (change), each Gaussian; channels are taken as independent.

    Parameters
    ----------
    mean : ndarray, shape (N + 1, D)
        Mean motion at equidistant phases.
    posture : ndarray, shape (N + 1, D)
        Variance of the average deviation.
    change : ndarray, shape (D,)
        Variance of the rest.
    y : ndarray, shape (S, D)
        The last samples.
    observed : ndarray of uint8, shape (S, D)
    back : ndarray, shape (S,)
        Time from each sample to the last one, s.
    velocity : float
        Assumed phase velocity.
    phases : ndarray, shape (P,)
        Assumed phases at the last sample.
    rhythmic : bool
    scores : ndarray, shape (P,)
        Filled with log likelihoods.
    """
    cdef int p, k, d, node, here = 0, samples = y.shape[0], D = y.shape[1], N = mean.shape[0] - 1
    cdef double phase, error, total
    cdef double[::1] count = np.zeros(D), first = np.zeros(D), second = np.zeros(D)
    with nogil:
        for p in range(phases.shape[0]):
            for d in range(D):
                count[d] = 0
                first[d] = 0
                second[d] = 0
            for k in range(samples):
                phase = phases[p] - velocity * back[k]
                if rhythmic:
                    node = <int>(wrapped(phase) * (N / TWO_PI) + 0.5)
                else:
                    phase = 0 if phase < 0 else (1 if phase > 1 else phase)
                    node = <int>(phase * N + 0.5)
                if k == samples - 1:
                    here = node
                for d in range(D):
                    error = (y[k, d] - mean[node, d]) if observed[k, d] else 0
                    count[d] += observed[k, d]
                    first[d] += error
                    second[d] += error * error
            total = 0
            for d in range(D):
                if count[d] > 0:
                    error = first[d] / count[d]
                    total -= 0.5 * (error * error / posture[here, d] + log(posture[here, d])
                                    + (second[d] - first[d] * error) / change[d]
                                    + (count[d] - 1) * log(change[d]))
            scores[p] = total
