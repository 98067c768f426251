"""A hypothesis of a search: a filter, how far it has come, and how well it explained what it saw."""
from libc.math cimport NAN, isnan, log, log1p

from style_core.phase_style.arrow_state cimport Filter
from style_core.phase_style.settings import CORRELATED, LIMIT, MEMORY

__all__ = ['CORRELATED', 'LIMIT', 'MEMORY', 'Hypothesis']


cdef class Hypothesis:
    """A hypothesis: a filter, how far it has come, and how well it explained what it saw.

    Parameters
    ----------
    behaviour : int
    one : Filter
    first : int
        The sample it starts from.
    tail : float
        Samples that the size of what it promises is known from: its first innovation has the heavy tails of a Student
        distribution with so many, as nobody's posture is known before.
    prior : float
        Log prior weight of where it started, nats.
    """

    def __init__(self, int behaviour, Filter one, long first, double tail, double prior=0.0):
        self.behaviour, self.filter, self.next, self.time = behaviour, one, first, NAN
        self.tail, self.prior = tail, prior
        self.judge_anew()

    cpdef judge_anew(self):
        """Forget how well it did."""
        self.weight, self.misfit, self.cost, self.seen, self.logs, self.count = 0.0, 0.0, 0.0, 0.0, 0.0, 0

    cpdef update(self, double time, const double[::1] y, const unsigned char[::1] observed):
        """Update the filter with a sample."""
        self.filter.update(y, observed, 0.0 if isnan(self.time) else max(time - self.time, 0.0))
        self.time = time

    cpdef judge(self):
        """Take the filter's last update into account."""
        self.weigh(self.filter.innovation, self.filter.log_determinant, self.filter.seen, self.filter.rejected)

    cpdef weigh(self, double innovation, double logs, int seen, int rejected=0):
        """Take an update into account.

        Parameters
        ----------
        innovation : float
            Squared innovation a joint that entered.
        logs : float
            Log of the determinant of the innovations' covariance.
        seen, rejected : int
            Joints that entered, and that were left out.
        """
        cdef double memory = MEMORY, limit = LIMIT * LIMIT
        if seen + rejected == 0:
            return
        if seen == 0:
            innovation = limit
        self.last = (innovation * seen + limit * rejected) / (seen + rejected)
        self.logs = memory * self.logs + logs
        self.misfit = memory * self.misfit + self._tailed(innovation)
        self.cost = memory * self.cost + self._tailed(self.last)
        self.seen = memory * self.seen + seen + rejected
        self.weight = memory * self.weight + 1.0
        self.count += 1

    cdef double _tailed(self, double innovation):
        """The first innovation has the heavy tails of a Student distribution: nobody's posture is known before."""
        return innovation if self.count else 1 + (self.tail + 1) * log1p((innovation - 1) / (self.tail + 1))

    cdef double _score(self):
        """Log likelihood a sample, eq. (18).

        Variances are those of a usual person: whoever is smoother has smaller ones.
        """
        cdef double level = min((1 + self.cost) / (1 + self.weight), 1.0)
        return -0.5 * (self.seen * (log(level) + self.cost / (level * self.weight)) + self.logs) / self.weight

    cpdef double lead(self, Hypothesis other):
        """Nats by which it explains the last samples better than another."""
        return ((self._score() - other._score()) * min(self.weight, other.weight) / <double>CORRELATED
                + self.prior - other.prior)
