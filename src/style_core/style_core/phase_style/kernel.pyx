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
    STYLE_CLONES static void hermite4_add(double a, const double *restrict p, double b, const double *restrict q,
                                          double c, const double *restrict r, double d, const double *restrict s,
                                          double *restrict out, int n)
    { for (int k = 0; k < n; k++) out[k] += (a * p[k] + b * q[k]) + (c * r[k] + d * s[k]); }
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
    void hermite4_add(double, const double*, double, const double*, double, const double*, double, const double*,
                      double*, int) noexcept nogil
    void axpy(double, const double*, double*, int) noexcept nogil
    void axpy2(double, const double*, double, const double*, double*, int) noexcept nogil
    void scale(double, const double*, double*, int) noexcept nogil
    void product_add(double, const double*, const double*, double*, int) noexcept nogil
    void product_subtract(const double*, const double*, double*, int) noexcept nogil
    void product(const double*, const double*, double*, int) noexcept nogil
    void square_add(const double*, double*, int) noexcept nogil
    double dot(const double*, const double*, int) noexcept nogil

cdef double TWO_PI = 6.283185307179586
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

    cdef void weighted_slope(self, double phase, const double* weight, double* slope) noexcept nogil:
        """``sum_j weight_j`` times the derivative of basis j, (D,)."""
        cdef int node, j, k, n = self.channels
        cdef double u, rate, a, b, c, d
        cdef const double *v0
        cdef const double *v1
        cdef const double *s0
        cdef const double *s1
        self._place(phase, &node, &u, &rate)
        for k in range(n):
            slope[k] = 0
        for j in range(self.count):
            v0 = &self.values[node, j, 0]
            v1 = &self.values[node + 1, j, 0]
            s0 = &self.slopes[node, j, 0]
            s1 = &self.slopes[node + 1, j, 0]
            a = 6 * u * (u - 1) * rate * weight[j]
            b = (1 - u) * (1 - 3 * u) * rate * weight[j]
            c = -a
            d = u * (3 * u - 2) * rate * weight[j]
            hermite4_add(a, v0, b, s0, c, v1, d, s1, slope, n)

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

    def update(self, const double[::1] y, const unsigned char[::1] observed, double dt):
        """E-step (A.1)-(A.6) with the rows of missing channels left out, then on-line M-step (A.10)-(A.13).

        Parameters
        ----------
        y : ndarray, shape (D,)
        observed : ndarray of uint8, shape (D,)
        dt : float
            Since the last update, s; 0 for the first.
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
            self.table.look_up(self.phase, &self.value[0, 0], NULL)
            self.table.weighted_slope(self.phase, &self.w[0], &self.tangent[0])
            extra = self.table.variance(self.phase, &self.w[0])
            for d in range(n):
                self.mean[d] = 0
            for j in range(J):
                axpy(self.w[j], &self.value[j, 0], &self.mean[0], n)
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
            if seen:
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
                self.table.weighted_slope(phase, &self.w[0], &self.tangent[0])
                extra = self.table.variance(phase, &self.w[0])
                phase_variance = self.p00 + ahead * (2 * self.p01 + ahead * self.p11) \
                    + self.acceleration * ahead * ahead * ahead / 3
                for d in range(n):
                    mean[h, d] = 0
                    self.variance[d] = self.noise[d] + extra + phase_variance * self.tangent[d] * self.tangent[d]
                    velocity[h, d] = speed * self.tangent[d]
                for i in range(J):
                    axpy(self.w[i], &self.value[i, 0], &mean[h, 0], n)
                    scale(self.spread[i, i], &self.value[i, 0], &self.clean[0], n)
                    for j in range(i):
                        axpy(self.spread[i, j] + self.spread[j, i], &self.value[j, 0], &self.clean[0], n)
                    product_add(1.0, &self.clean[0], &self.value[i, 0], &self.variance[0], n)
                for d in range(n):
                    std[h, d] = sqrt(self.variance[d]) if self.variance[d] > 0 else 0
