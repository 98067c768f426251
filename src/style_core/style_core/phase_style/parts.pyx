"""The kinds of processes that a channel is made of, for Python (see parts.pxd, where each kind is described)."""
import numpy as np

from libc.math cimport cos, fabs, sin

__all__ = ['CYCLE', 'LEVEL', 'SMOOTH', 'SMOOTHER', 'Part']

globals().update(LEVEL=LEVEL, SMOOTH=SMOOTH, SMOOTHER=SMOOTHER, CYCLE=CYCLE)


cdef class Part:
    """One process of a channel.

    Parameters
    ----------
    kind : int
        `LEVEL`, `SMOOTH` or `CYCLE`.
    rate : float
        1/s.
    harmonic : int
        k of a `CYCLE`.
    """

    def __init__(self, int kind, double rate, int harmonic=0):
        self.p.kind, self.p.rate, self.p.harmonic, self.p.first = kind, rate, harmonic, 0

    @property
    def size(self):
        """How many states it has."""
        return size_of(&self.p)

    @property
    def rate(self):
        """1/s."""
        return self.p.rate

    def transition(self, double t):
        """e^(F t), shape (n, n)."""
        cdef double[:, ::1] G = np.eye(self.size) * exp(-self.p.rate * t)
        if is_coupled(&self.p):
            transition(&self.p, t, exp(-self.p.rate * t), &G[0, 0])
        return np.asarray(G)

    def prior(self):
        """P0, shape (n, n)."""
        cdef double[:, ::1] P0 = np.eye(self.size)
        if is_coupled(&self.p):
            prior(&self.p, &P0[0, 0])
        return np.asarray(P0)

    def weights(self, double phase):
        """w and its derivative by phase, each (n,)."""
        cdef double[:, ::1] out = np.empty((2, self.size))
        weights(&self.p, cos(self.p.harmonic * phase), sin(self.p.harmonic * phase), &out[0, 0], &out[1, 0])
        return np.asarray(out[0]), np.asarray(out[1])

    def covariance(self, const double[:] times, const double[:] phases):
        """Covariance of the part at all pairs of times, as a multiple of its variance: eq. (16).

        That of two times is s^T P0 w, where s says how the states at the earlier one enter an observation at the later.

        Parameters
        ----------
        times, phases : ndarray, shape (T,)

        Returns
        -------
        ndarray, shape (T, T)
        """
        cdef int i, j, a, b, n = self.size
        cdef double lag, total
        cdef double[:, ::1] out = np.empty((len(times), len(times)))
        cdef double[:, ::1] w = np.array([self.weights(phase)[0] for phase in phases])
        cdef double[:, ::1] P0 = self.prior()
        cdef double s[WIDEST_PART]
        cdef double by_time[WIDEST_PART]
        with nogil:
            for i in range(times.shape[0]):
                for j in range(i + 1):
                    lag = fabs(times[i] - times[j])
                    ahead(&self.p, lag, exp(-self.p.rate * lag), &w[i, 0], s, by_time)
                    total = 0
                    for a in range(n):
                        for b in range(n):
                            total += s[a] * P0[a, b] * w[j, b]
                    out[i, j] = out[j, i] = total
        return np.asarray(out)
