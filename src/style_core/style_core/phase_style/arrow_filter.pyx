"""The full filter: an extended Kalman filter whose precision has the shape of an arrow.

Phase, phase velocity and style are common to all channels, and every channel has states of its own that are independent
of the other channels' given the common state, so that everything costs a multiple of the number of channels. Numbers of
equations are those of docs/phase_style.md; loops over channels are in arrow_body.h.
"""
from libc.math cimport INFINITY, NAN, exp, log, sqrt

from style_core.phase_style.arrow cimport arrow, arrow_correct, arrow_innovate, coupled
from style_core.phase_style.arrow_forecast cimport ArrowForecast
from style_core.phase_style.basis_table cimport MOST
from style_core.phase_style.memory cimport total_of
from style_core.phase_style.parts cimport is_coupled, part, renewed, size_of, transition, weights
from style_core.phase_style.arrow_forecast import TOO_FAR
from style_core.small_matrices cimport cholesky, cholesky_inverse, cholesky_solve

__all__ = ['ArrowFilter']

#: Distance of the samples that the noise is a variance of, s: at higher rates it stays as dense in time.
cdef double NOISE_STEP_S = 1 / 60.0 - 1e-6
cdef double LOG_TWO_PI = 1.8378770664093453


cdef class ArrowFilter(ArrowForecast):
    """Extended Kalman filter over phase, phase velocity, style, and states of every channel's own.

    The common state is ``c = (phase, velocity, z)`` with the style ``w = w0 + S z``, z of J components with unit prior
    variance. Channel d adds its own n states u_d, those of its parts (see `Part`), weighted by s(phase): eq. (2),

        y_d = m_d(phase) + sum_j z_j b_jd(phase) + s(phase)^T u_d + white noise

    Given c the u_d of different channels are kept independent: ``u_d | c ~ N(b_d + A_d (c - mean), V_d)``. A correction
    keeps this exactly; a time step with process noise on c is projected back to it, with every marginal of (c, u_d)
    exact.

    Parameters
    ----------
    table : Table
        J + 1 bases over phase: the mean, then those of z.
    parts : sequence of (Part, ndarray of shape (D,))
        What the channels are made of, and the variance of each part by channel, rad^2. A part without coupled states,
        a `LEVEL`, must be among them: it takes over what a channel insists on (`rejection`).
    noise : ndarray, shape (D,)
        Variance, rad^2.
    style_rate : float
        Decay of the style, 1/s.
    acceleration : float
        Density of the phase acceleration.
    bounds : (float, float)
        Lowest and highest phase velocity.

    Attributes
    ----------
    used : ndarray of uint8, shape (D,)
        Channels that entered the last update.
    rejected : int
        How many were observed and left out (see `gate`).
    """

    @property
    def used(self):
        return self.rejection.used

    cpdef gate(self, double limit=INFINITY, double few=0.0, double rest=INFINITY, bint whole=False):
        """What to leave out from now on; nothing, unless told.

        A channel whose innovation is more than ``limit`` of its standard deviations, and any beside it that is more
        than a quarter of it off, is left out of the update if the others are not surprised, for as long as it
        contradicts what came before or does not change by a single bit; once it has agreed with itself for 0.05 s it
        enters again, and its level is sought anew. Where more than a share ``few`` of the channels is out, and not one
        alone, it is not a few sensors that fail: then the observation is left out as a whole, or used as it is.

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
        self.rejection.limit, self.rejection.few, self.rejection.rest, self.rejection.whole = limit, few, rest, whole

    cpdef update(self, const double[::1] y, const unsigned char[::1] observed, double dt):
        """Predict over ``dt`` seconds and correct by one observation; channels not observed are marginalised exactly.

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
                raise ArithmeticError(TOO_FAR)
            self.fresh = True
        self.rooted = False
        self.f.thin = NOISE_STEP_S / dt if 0 < dt < NOISE_STEP_S else 1.0
        self.f.y, self.f.observed = &y[0], &self.rejection._used[0]
        with nogil:
            status = 0
            if dt > 0:
                status = self._predict_common(dt)
                self._predict_parts(dt)
            if status == 0:
                status = self._correct(observed, dt)
        if status:
            raise ArithmeticError(TOO_FAR)

    cdef int _predict_common(self, double dt) noexcept nogil:
        """Common state: c <- F c, P' = F P F^T + Q, eq. (5).

        One component of the style a step drifts, over the time since its last turn, so that Q has rank three.
        """
        cdef int i, m = self.common, drift = -1
        cdef double l11, l21, l22, rho = 1, spread = 0, q = sqrt(self.acceleration)
        if self.styles:
            for i in range(self.styles):
                self.age[i] += dt
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
        # root of Q, by rows: phase and velocity of a white acceleration, and the style component
        l11 = q * sqrt(dt * dt * dt / 3)
        l21 = q * sqrt(3 * dt) / 2
        l22 = q * sqrt(dt) / 2
        self.P[0, 0] += l11 * l11
        self.P[0, 1] += l11 * l21
        self.P[1, 0] += l11 * l21
        self.P[1, 1] += l21 * l21 + l22 * l22
        if drift >= 0:
            self.P[2 + drift, 2 + drift] += spread * spread
        self.f.dt, self.f.rho = dt, rho
        self.f.third = 2 + drift if drift >= 0 else 0  # without a style the third row has no load
        self.f.load[0][0], self.f.load[1][0], self.f.load[1][1], self.f.load[2][2] = l11, l21, l22, spread
        if self._invert() or self._condition():
            return 1
        self._bound()
        return 0

    cdef int _condition(self) noexcept nogil:
        """What the new common state tells of the old one, eqs. (6) and (7): ``mix`` = Qs^T P'^-1 and the rows of
        ``back`` = B = F^-1 Qs chol(I - Qs^T P'^-1 Qs) that are not zero."""
        cdef int i, j, k, r
        cdef double total
        cdef double inner[9]
        cdef arrow* f = &self.f
        for r in range(3):
            for j in range(self.common):
                f.mix[r][j] = f.load[0][r] * self.precision[0, j] + f.load[1][r] * self.precision[1, j] \
                    + f.load[2][r] * self.precision[f.third, j]
        for r in range(3):
            for k in range(3):
                total = f.mix[r][0] * f.load[0][k] + f.mix[r][1] * f.load[1][k] + f.mix[r][f.third] * f.load[2][k]
                inner[r * 3 + k] = (1.0 if r == k else 0.0) - total
        if cholesky(inner, 3):
            return 1
        for i in range(3):
            for r in range(3):
                f.back[i][r] = f.load[i][0] * inner[r] + f.load[i][1] * inner[3 + r] + f.load[i][2] * inner[6 + r]
        for r in range(3):
            f.back[0][r] -= f.dt * f.back[1][r]
            f.back[2][r] /= f.rho
        return 0

    cdef void _predict_parts(self, double dt) noexcept nogil:
        """What the time step of the channels' own states needs, eq. (3): e^(F dt) and P0 - e^(F dt) P0 e^(F dt)^T."""
        cdef int a, p, couples = 0
        cdef double left
        cdef part* one
        cdef coupled* c
        for p in range(self.f.parts):
            one = &self.parts[p]
            left = exp(-one.rate * dt)
            if is_coupled(one):
                c = &self.f.couple[couples]
                transition(one, dt, left, c.g)
                renewed(one, c.g, c.fresh)
                couples += 1
                left = 1
            for a in range(one.first, one.first + size_of(one)):
                self.f.decay[a], self.f.renewal[a] = left, 1 - left * left

    cdef void _weigh(self, double phase) noexcept nogil:
        """How states enter an observation now, eq. (2)."""
        cdef int p
        cdef double c[MOST]
        cdef double d[MOST]
        cdef const part* one
        cdef arrow* f = &self.f
        self._multiples(phase, c, d)
        for p in range(f.parts):
            one = &self.parts[p]
            weights(one, c[one.harmonic], d[one.harmonic], f.s + one.first, f.by_phase + one.first)

    cdef int _correct(self, const unsigned char[::1] observed, double dt) noexcept nogil:
        """Gate the observation and correct by it: eqs. (11) to (13), with the time step of the channels' own states."""
        cdef int i, j, k = 0, status, m = self.common
        cdef double squares = 0, total
        cdef arrow* f = &self.f
        self.table.look_up(self.c[0], &f.at)
        f.w[0] = 1
        for j in range(self.styles):
            f.w[1 + j] = self.c[2 + j]
        self._weigh(self.c[0])
        self.rejection.admit(observed)
        arrow_innovate(f, dt > 0)
        if self.rejection.gate(f, &self.P[0, 0], self.level, dt):
            arrow_innovate(f, 0)
        status = self._solve(&squares)
        if status == 0 and self.rejection.readmit(observed, squares):
            arrow_innovate(f, 0)
            status = self._solve(&squares)
        self.seen, self.rejected = self.rejection.seen, self.rejection.rejected
        if self.seen == 0:
            self.innovation, self.log_likelihood = NAN, 0
            return 0
        if status:
            return 1
        # P^-1 <- P^-1 + G^T S^-1 G; log det of P^-1 before and after gives that of the innovation's covariance
        for i in range(m):
            for j in range(i + 1):
                self.precision[i, j] += total_of(&self.sums[4 * k])
                self.precision[j, i] = self.precision[i, j]
                k += 1
        total = -cholesky_inverse(&self.matrix[0, 0], &self.P[0, 0], m)
        self.log_determinant = f.logs + total - self.log_precision
        self.log_precision = total
        self.innovation = squares / self.seen
        self.log_likelihood = -0.5 * (squares + self.log_determinant + self.seen * LOG_TWO_PI)
        for i in range(m):
            self.c[i] += f.delta[i]
        arrow_correct(f)
        self._bound()
        return 0

    cdef int _solve(self, double* squares) noexcept nogil:
        """Change delta of the common state in information form, eq. (12), and its precision's root in ``matrix``.

        The squared innovation is e^T (G P G^T + S)^-1 e = e^T S^-1 e - delta^T G^T S^-1 e.
        """
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
