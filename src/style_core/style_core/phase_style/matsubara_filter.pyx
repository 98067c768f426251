"""The filter of Matsubara et al. (2012, appendix A): phase and phase velocity by an EKF, the style by on-line EM.

Sums over channels are in matsubara_body.h. Numbers of equations are the paper's; where its print lacks something
docs/phase_style.md says what.
"""
import numpy as np

from libc.math cimport INFINITY, NAN, exp, log

from style_core.phase_style.basis_table cimport MOST, Table, cubic, wrapped
from style_core.phase_style.memory cimport Sheet, aligned, check_horizons, total_of
from style_core.small_matrices cimport cholesky, cholesky_solve

__all__ = ['MatsubaraFilter']

cdef extern from "matsubara.h":
    ctypedef struct matsubara:
        int count, blocks, channels, width
        const double *noise
        double *seen
        double *clean
        double *sums
        double w[MOST]
        double spread[MOST * MOST]
        double information, score, squares, logs
    void matsubara_innovate(matsubara*, const cubic*, double, const double*, const unsigned char*) noexcept nogil
    void matsubara_maximise(matsubara*, const cubic*) noexcept nogil
    void matsubara_forecast(const matsubara*, const cubic*, double, double, double, double*, double*, double*) \
        noexcept nogil

cdef object empty = np.empty
cdef double LOG_TWO_PI = 1.8378770664093453


cdef class MatsubaraFilter:
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
    wander, jitter : float
        White noise on the phase and on its velocity, independent of each other, variance a second: a diagonal Q.
    """

    cdef readonly Table table
    cdef readonly double phase, velocity, innovation, log_likelihood
    cdef double p00, p01, p11, acceleration, wander, jitter, log_forgetting, share, step
    cdef readonly double learning_rate
    cdef int count, channels
    cdef matsubara f
    cdef double[::1] memory, moment, scratch
    cdef double[:, ::1] normal, noisy, work, spread

    def __init__(self, Table table, noise, double acceleration, style, double forgetting, double step,
                 double wander=0, double jitter=0):
        cdef int j, width = table.width
        if table.count > MOST:
            raise ValueError(f'at most {MOST} styles, got {table.count}')
        self.table = table
        self.count, self.channels = table.count, table.channels
        self.acceleration, self.wander, self.jitter = acceleration, wander, jitter
        self.step = step
        self.forget(forgetting)
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

    def forget(self, double forgetting):
        """Set lambda from the next update on; what was weighted so far keeps its weight."""
        self.log_forgetting = log(forgetting) / self.step

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
        cdef int d, seen = 0
        with nogil:
            for d in range(self.channels):
                seen += observed[d] != 0
            self._predict(dt)
            self._correct(y, observed, seen)
            if seen and learn:
                self._maximise(dt)

    cdef void _predict(self, double dt) noexcept nogil:
        """(A.1), (A.2) with A = [[1, dt], [0, 1]] and Q of a phase whose acceleration is white, or a diagonal one."""
        cdef double q = self.acceleration
        self.phase += dt * self.velocity
        self.p00 += dt * (2 * self.p01 + dt * self.p11) + q * dt * dt * dt / 3
        self.p01 += dt * self.p11 + q * dt * dt / 2
        self.p11 += q * dt
        self.p00 += self.wander * dt
        self.p11 += self.jitter * dt
        self._bound()

    cdef void _correct(self, const double[::1] y, const unsigned char[::1] observed, int seen) noexcept nogil:
        """(A.3)-(A.6).

        H has a column for the phase alone, h, so that with P = Sigma_t|t-1 the gain P H^T (H P H^T + R)^-1 is
        P[:, 0] h^T R^-1 / (1 + P[0, 0] h^T R^-1 h): two sums over channels, ``information`` h^T R^-1 h and ``score``
        h^T R^-1 e.
        """
        cdef double gain, k0, k1, squares
        cdef cubic at
        self.table.look_up(self.phase, &at)
        matsubara_innovate(&self.f, &at, self.table.variance(self.phase, self.f.w), &y[0], &observed[0])
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

    cdef void _maximise(self, double dt) noexcept nogil:
        """On-line M-step, (A.10)-(A.13); lambda_t is forgetting^(dt / step)."""
        cdef int i, j, k = 0, J = self.count
        cdef double eta
        cdef double* normal = self.f.sums
        cdef double* noisy = normal + 2 * J * (J + 1)
        cdef double* moment = noisy + 2 * J * (J + 1)
        cdef cubic at
        self.table.look_up(self.phase, &at)
        matsubara_maximise(&self.f, &at)
        if self.learning_rate == 0:
            eta = 1
        else:
            eta = 1 / (1 + exp(self.log_forgetting * dt) / self.learning_rate)
        self.learning_rate = eta
        self.share = (1 - eta) * (1 - eta) * self.share + eta * eta
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

    def forecast(self, const double[::1] horizons):
        """Section 3.3 at any time ahead, with the spread of phase, style and residual.

        Parameters
        ----------
        horizons : ndarray, shape (H,)
            s.

        Returns
        -------
        mean, std, velocity : ndarray, shape (H, D)
        """
        cdef long h, H = horizons.shape[0], D = self.channels
        check_horizons(horizons)
        out = empty((3, H, D))
        cdef double[:, :, ::1] memory = out
        if H:
            self._pair_spread()
        for h in range(H):
            self._ahead(horizons[h], &memory[0, h, 0], &memory[1, h, 0], &memory[2, h, 0])
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
        return sheet.arrays()

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
            + self.acceleration * ahead * ahead * ahead / 3 \
            + ahead * (self.wander + self.jitter * ahead * ahead / 3)
        if not self.table.rhythmic and (phase >= 1 or phase <= 0):
            phase = 1 if phase >= 1 else 0
            speed = 0
        self.table.look_up(phase, &at)
        matsubara_forecast(&self.f, &at, self.table.variance(phase, self.f.w), phase_variance, speed, mean, std,
                           velocity)
