"""What the full filter expects: the pose of the moment, and observations ahead of time.

Numbers of equations are those of docs/phase_style.md; loops over channels are in arrow_body.h.
"""
import numpy as np

from libc.math cimport NAN, exp
from libc.string cimport memcmp, memcpy

from style_core.phase_style.arrow cimport WIDEST, arrow_mean, arrow_spread, horizon
from style_core.phase_style.arrow_state cimport KNOTS, ArrowState
from style_core.phase_style.basis_table cimport MOST, between
from style_core.phase_style.memory cimport Sheet, check_horizons
from style_core.phase_style.parts cimport ahead, part, turns, weights

__all__ = ['ArrowForecast', 'TOO_FAR']

cdef object empty = np.empty

TOO_FAR = 'what was observed is too far from anything the model can represent'


cdef class ArrowForecast(ArrowState):
    """Forecasts of an `ArrowFilter`; see there."""

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
            if observed[d] and self.rejection.trusted(d):
                error = (y[d] - mean[d]) / std[d]
                total += error * error
                count += 1
        return total / count if count else NAN

    def describe(self, const double[::1] centre, const double[:, ::1] root, double late=0.0):
        """The estimate now, or was to expect some time after its last update.

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
        return self._bounded(phase), self.c[1], *sheet.arrays()

    cdef int _expect(self, double late, double* mean, double* std) except -1:
        """Pose some time after the last update and its standard deviation, each (D,)."""
        if not self.rooted and self._root():
            raise ArithmeticError(TOO_FAR)
        self._plan_one(late, &self.one_plan[0])
        self._ahead(&self.one_plan[0], self.times)
        arrow_mean(&self.f, self.times, mean, NULL, &self.rows[0])
        arrow_spread(&self.f, self.times, 1, &self.rows[0], &std)
        return 0

    def forecast_into(self, const double[::1] horizons, double[:, ::1] mean, double[:, ::1] std,
                      double[:, ::1] velocity):
        """Predict observations ahead of time, eqs. (14) and (15).

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
            self._forecast(horizons, &mean[0, 0], &std[0, 0], &velocity[0, 0])

    def forecast(self, const double[::1] horizons):
        """`forecast_into` new arrays: mean, std and velocity."""
        cdef long H = horizons.shape[0]
        self._plan(horizons)
        out = empty((3, H, self.channels))
        cdef double[:, :, ::1] memory = out
        if H:
            self._forecast(horizons, &memory[0, 0, 0], &memory[1, 0, 0], &memory[2, 0, 0])
        return out[0], out[1], out[2]

    cdef int _plan(self, const double[::1] horizons) except -1:
        """Get ready for a prediction; what depends on the horizons alone is kept for the next one."""
        cdef long h, H = horizons.shape[0], size = self._plan_size()
        if not self.rooted and self._root():
            raise ArithmeticError(TOO_FAR)
        if H == self.planned and (H == 0 or memcmp(&horizons[0], &self.horizons[0], H * sizeof(double)) == 0):
            return 0
        check_horizons(horizons)
        self.planned = 0
        if self.horizons is None or self.horizons.shape[0] < H:
            self.horizons, self.plans = np.empty(H), np.empty(H * size)
        for h in range(H):
            self.horizons[h] = horizons[h]
            self._plan_one(horizons[h], &self.plans[h * size])
        self.planned = H
        return 0

    cdef long _plan_size(self) noexcept nogil:
        return 2 + 2 * self.f.parts + 2 * self.states

    cdef void _plan_one(self, double t, double* plan) noexcept nogil:
        """What is known of a time ahead: itself, what is left of the style, what is new of each part, what is left of
        each, and how the states of parts that do not turn with the phase enter then, with the derivative by time."""
        cdef int p
        cdef double* fresh = plan + 2
        cdef double* left = fresh + self.f.parts
        cdef double* s = left + self.f.parts
        cdef double* by_time = s + self.states
        cdef double w[WIDEST]
        cdef double by_phase[WIDEST]
        cdef const part* one
        plan[0], plan[1] = t, exp(-self.style_rate * t)
        for p in range(self.f.parts):
            one = &self.parts[p]
            left[p] = exp(-one.rate * t)
            weights(one, 1, 0, w, by_phase)
            fresh[p] = ahead(one, t, left[p], w, s + one.first, by_time + one.first)

    cdef void _ahead(self, const double* plan, horizon* x) noexcept nogil:
        """Where a time ahead looks the table up, and how the present states enter: eq. (14)."""
        cdef int j
        cdef double t = plan[0], rho = plan[1], phase = self.c[0] + t * self.c[1]
        x.fresh = plan + 2
        x.speed = self.c[1]
        if not self.table.rhythmic and (phase >= 1 or phase <= 0):
            phase = 1 if phase >= 1 else 0
            x.speed = 0
        self.table.look_up(phase, &x.at)
        x.w[0] = 1
        for j in range(self.styles):
            x.w[1 + j] = rho * self.c[2 + j]
        self._enter(phase, plan + 2 + self.f.parts, x)
        x.ahead, x.rho, x.style_rate = t, rho, self.style_rate
        x.wander = self.acceleration * t * t * t / 3

    cdef void _enter(self, double phase, const double* left, horizon* x) noexcept nogil:
        """How states enter an observation ahead of time, with the derivatives.

        Those of parts that turn with the phase do by it and by how much is ``left``, the others as planned, and their
        derivative by phase stays 0.
        """
        cdef int i, p
        cdef const double* s = left + self.f.parts
        cdef double c[MOST]
        cdef double d[MOST]
        cdef double w[WIDEST]
        cdef double by_phase[WIDEST]
        cdef const part* one
        memcpy(x.s, s, self.states * sizeof(double))
        memcpy(x.by_time, s + self.states, self.states * sizeof(double))
        if self.harmonics == 0:
            return
        self._multiples(phase, c, d)
        for p in range(self.f.parts):
            one = &self.parts[p]
            if turns(one):  # such a part has two states; a loop over so few takes longer than all else here
                i = one.first
                weights(one, c[one.harmonic], d[one.harmonic], w, by_phase)
                x.s[i], x.s[i + 1] = left[p] * w[0], left[p] * w[1]
                x.by_phase[i], x.by_phase[i + 1] = left[p] * by_phase[0], left[p] * by_phase[1]
                x.by_time[i] = x.speed * x.by_phase[i] - one.rate * x.s[i]
                x.by_time[i + 1] = x.speed * x.by_phase[i + 1] - one.rate * x.s[i + 1]

    cdef void _forecast(self, const double[::1] horizons, double* mean, double* std,
                        double* velocity) noexcept nogil:
        cdef int h, k, i, H = horizons.shape[0], last = -1, slot = 0
        cdef int knots = H if H <= KNOTS else KNOTS
        cdef long D = self.channels, size = (1 + self.styles) * self.table.width
        cdef double* where[KNOTS]
        cdef const double* plans = &self.plans[0]
        cdef long length = self._plan_size()
        for h in range(1, H):
            if horizons[h] < horizons[h - 1]:
                knots = H
        k = 0
        for h in range(H):
            self._ahead(plans + h * length, &self.times[slot])
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
