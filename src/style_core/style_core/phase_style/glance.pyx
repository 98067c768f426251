"""A quick glance: phases of a behaviour ranked by how well its mean motion explains the last samples."""
import numpy as np

from libc.math cimport INFINITY, NAN, isnan
from libc.string cimport memset

from style_core.phase_style.basis_table cimport LANES, TWO_PI, wrapped
from style_core.phase_style.channel import CHANNEL
from style_core.phase_style.memory cimport aligned_single
from style_core.phase_style.settings import PHASES, SPEEDS

cdef extern from "glance.h":
    void glance_scores(glance*, int, const int*, double*) noexcept nogil

__all__ = ['PHASES', 'SPEEDS', 'Glance']

cdef enum:
    SAMPLES = 32  # that a glance can look at


cdef class Glance:
    """Ranks phases of one behaviour by its mean motion with two variances.

    The deviation from the mean motion is split for every channel into its average over the samples (posture and
    style) and the rest (change), each Gaussian; channels are taken as independent.

    Parameters
    ----------
    behaviour : Behaviour
        With a residual model.
    table : BasisTable
        Whitened: the mean motion, then the bases of z.
    limit : float
        Of the deviations, in standard deviations: farther off counts as this far.

    Attributes
    ----------
    phases : ndarray, shape (P,)
        Phases at the last sample: once around a rhythmic motion, from start to goal of another.
    speeds : list of float
        Phase velocities, the mean one first.
    width : float
        Distance of the phases; as a standard deviation, what a choice between them leaves open.
    """

    def __init__(self, behaviour, table, double limit=INFINITY):
        cdef Py_ssize_t width
        residual = behaviour.residual
        posture, change = np.sum(table.values[:, 1:] ** 2, axis=1), residual.noise
        for one in CHANNEL:
            if one.name in residual.variance:
                posture = posture + residual.variance[one.name]
                change = change + one.quick * residual.variance[one.name]
        mean, spread, low, high = behaviour.velocity
        if high <= 0:
            self.phases, self.speeds, self.width = np.zeros(1), [0.0], 0.1
        elif behaviour.rhythmic:
            self.phases = np.arange(PHASES) * 2 * np.pi / PHASES
            self.speeds = [min(max(mean + factor * spread, low), high) for factor in SPEEDS]
            self.width = 2 * np.pi / PHASES
        else:
            self.phases, self.speeds, self.width = np.arange(PHASES) / PHASES, [mean], 1 / PHASES
        self._phases, self._speeds = self.phases, np.array(self.speeds, dtype=float)
        self._nodes, self._channels, self._rhythmic = len(table.values) - 1, len(change), behaviour.rhythmic
        self._f.most = limit * limit
        self._f.nodes, self._f.blocks = self._nodes + 1, (self._channels + LANES - 1) // LANES
        nodes = [self._node(self._rate() * phase) for phase in self.phases]
        posture = posture[nodes]
        parts = [self._by_block(values) for values in
                 (table.values[:, 0], 1 / posture, np.log(posture), 1 / change[None])]
        self._tables = aligned_single(sum([len(part) for part in parts]))
        np.asarray(self._tables)[:] = np.concatenate(parts)
        self._f.mean = &self._tables[0]
        self._f.posture = self._f.mean + <long>len(parts[0])
        self._f.log_posture = self._f.posture + <long>len(parts[1])
        self._f.change = self._f.log_posture + <long>len(parts[2])
        self._log_change = np.log(change)
        width = self._f.blocks * LANES
        self._samples = aligned_single((2 * SAMPLES + 2) * width)
        self._f.any, self._f.over = &self._samples[0], &self._samples[width]
        self._f.y, self._f.seen = &self._samples[2 * width], &self._samples[(2 + SAMPLES) * width]
        self._scores, self._totals = np.empty(len(self.phases)), aligned_single(len(self.phases) * LANES)
        self._marks = np.empty(len(self.phases) * SAMPLES, dtype=np.intc)
        self._f.totals = &self._totals[0]

    def _by_block(self, values):
        """Rows by channel as rows of blocks: (N, D) to a flat (blocks, N, 8)."""
        padded = np.zeros((len(values), self._f.blocks * LANES))
        padded[:, :self._channels] = values
        return padded.reshape(-1, self._f.blocks, LANES).transpose(1, 0, 2).reshape(-1)

    cdef double _rate(self) noexcept nogil:
        """Nodes a unit of phase."""
        return self._nodes / TWO_PI if self._rhythmic else self._nodes

    def rank(self, const double[:, ::1] y, const unsigned char[:, ::1] observed, const double[::1] back,
             double velocity):
        """Log likelihoods of the phases.

        Parameters
        ----------
        y : ndarray, shape (S, D)
            The last samples, S at most 32.
        observed : ndarray of uint8, shape (S, D)
        back : ndarray, shape (S,)
            Time from each sample to the last one, s.
        velocity : float
            Assumed phase velocity.

        Returns
        -------
        ndarray, shape (P,)
        """
        self._rank(back, velocity, self._lay_out(y, observed))
        return np.array(self._scores)

    cpdef peaks(self, const double[:, ::1] y, const unsigned char[:, ::1] observed, const double[::1] back, int speeds,
                double[:, ::1] scores, double[:, ::1] phases):
        """The best of neighbouring phases at each of the first ``speeds`` speeds.

        Parameters
        ----------
        y, observed, back
            As for `rank`.
        speeds : int
        scores, phases : ndarray, shape (speeds or more, peaks)
            Filled in for each speed, best first: log likelihood a sample, and phase. Where there are fewer peaks the
            rest of the scores is NaN.
        """
        cdef int k
        cdef double constant = self._lay_out(y, observed)
        for k in range(speeds):
            self._rank(back, self._speeds[k], constant)
            self._best(y.shape[0], scores[k], phases[k])

    cdef void _best(self, int samples, double[::1] scores, double[::1] phases) noexcept nogil:
        """Peaks of the scores, best first, of equal ones the later."""
        cdef int k, i, count = self._phases.shape[0], most = scores.shape[0]
        cdef double left, right, score
        for i in range(most):
            scores[i] = NAN
        for k in range(count):
            left = right = -INFINITY
            if count > 1 and (self._rhythmic or k > 0):
                left = self._scores[k - 1 if k else count - 1]
            if count > 1 and (self._rhythmic or k < count - 1):
                right = self._scores[k + 1 if k < count - 1 else 0]
            if not (self._scores[k] >= left and self._scores[k] > right):
                continue
            score = self._scores[k] / samples
            i = most
            while i > 0 and (isnan(scores[i - 1]) or scores[i - 1] <= score):
                i -= 1
                if i + 1 < most:
                    scores[i + 1], phases[i + 1] = scores[i], phases[i]
            if i < most:
                scores[i], phases[i] = score, self._phases[k]

    cdef double _lay_out(self, const double[:, ::1] y, const unsigned char[:, ::1] observed) except *:
        """Lay out the samples; returns the part of -2 log likelihood that no phase changes."""
        cdef int k, d, count, samples = y.shape[0]
        cdef long at
        cdef double constant = 0
        cdef float* any = <float*>self._f.any
        cdef float* over = <float*>self._f.over
        cdef float* values = <float*>self._f.y
        cdef float* seen = <float*>self._f.seen
        if samples > SAMPLES:
            raise ValueError(f'at most {SAMPLES} samples, got {samples}')
        self._f.samples = samples
        with nogil:
            memset(seen, 0, self._f.blocks * samples * LANES * sizeof(float))
            memset(values, 0, self._f.blocks * samples * LANES * sizeof(float))
            for d in range(self._channels):
                count = 0
                at = <long>(d // LANES) * samples * LANES + d % LANES
                for k in range(samples):
                    if observed[k, d]:
                        seen[at], values[at] = 1, <float>y[k, d]
                        count += 1
                    at += LANES
                any[d] = 1 if count else 0
                over[d] = 1 / <double>count if count else 0
                if count:
                    constant += (count - 1) * self._log_change[d]
        return constant

    cdef void _rank(self, const double[::1] back, double velocity, double constant) noexcept nogil:
        cdef int p, k, samples = self._f.samples, count = self._phases.shape[0]
        cdef double at, rate = self._rate()
        cdef int* node = &self._marks[0]
        cdef double shift[SAMPLES]  # of the samples from the last one, in nodes
        for k in range(samples):
            shift[k] = -velocity * back[k]
            shift[k] = rate * (wrapped(shift[k]) if self._rhythmic else shift[k])
        for p in range(count):
            at = rate * self._phases[p]
            for k in range(samples):
                node[p * samples + k] = self._node(at + shift[k])
        glance_scores(&self._f, count, node, &self._scores[0])
        for p in range(count):
            self._scores[p] = -0.5 * (self._scores[p] + constant)

    cdef inline int _node(self, double at) noexcept nogil:
        """The node nearest to a place, which is at most once around, or clamped."""
        if self._rhythmic:
            if at >= self._nodes:
                at -= self._nodes
        elif at < 0:
            at = 0
        elif at > self._nodes:
            at = self._nodes
        return <int>(at + 0.5)
