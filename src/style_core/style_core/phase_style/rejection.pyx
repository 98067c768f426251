"""Outlier rejection: which channels of an observation enter an update, and which are left out of it.

A gate on each channel's innovation, eq. (17) of docs/phase_style.md, with three rules around it: joints beside a failed
one are suspect, many failures at once are the motion, and a channel that agrees with itself for long enough is right.
"""
import numpy as np

from libc.math cimport INFINITY
from libc.string cimport memcpy

from style_core.phase_style.arrow cimport arrow, arrow_cell, arrow_error, arrow_g, arrow_inverse, \
    arrow_variance
from style_core.phase_style.basis_table cimport LANES
from style_core.phase_style.settings import ALONE as _ALONE, BELIEVED_S as _BELIEVED_S, SUSPECT as _SUSPECT

cdef double BELIEVED_S = _BELIEVED_S, SUSPECT = _SUSPECT
cdef int ALONE = _ALONE
#: In `used`, while it is decided what enters.
cdef unsigned char MARKED = 2

#: Columns of `doubt`, for each channel: for how long it has agreed with itself while it was left out, s (negative: it
#: is not in doubt), its error and value when it was last looked at, and whether the doubt is new.
cdef enum:
    AGREED, ERROR, VALUE, NEW


cdef class Rejection:
    """The gate of one filter.

    Parameters
    ----------
    channels : int
    """

    def __init__(self, int channels):
        self.used = np.zeros(channels, dtype=np.uint8)
        self._used, self.doubt = self.used, np.empty((channels, 4))
        self.limit, self.few, self.rest, self.whole = INFINITY, 0.0, INFINITY, False
        self.reset()

    cdef void reset(self) noexcept nogil:
        """Nothing is in doubt."""
        self.doubt[:, AGREED] = -1
        self.doubting = False
        self.rejected = 0

    cdef void copy(self, Rejection other):
        """Take over what another one found, but not its settings."""
        self.doubt[:, :], self._used[:] = other.doubt, other._used
        self.seen, self.rejected, self.doubting = other.seen, other.rejected, other.doubting

    cdef bint trusted(self, int channel) noexcept nogil:
        return self.doubt[channel, AGREED] < 0

    cdef void admit(self, const unsigned char[::1] observed) noexcept nogil:
        """Everything observed enters, to begin with."""
        cdef int d
        memcpy(&self._used[0], &observed[0], observed.shape[0])
        self.seen = self.rejected = 0
        for d in range(observed.shape[0]):
            self.seen += self._used[d] != 0

    cdef int _mark(self, arrow* f, const double* P, double squares, bint first) noexcept nogil:
        """Mark channels whose squared innovation is more than ``squares`` times its variance, g^T P g + S; how many."""
        cdef int d, i, j, found = 0, m = f.m, inverse = arrow_inverse(f)
        cdef double size, variance
        cdef const double* cell
        cdef const double* g
        for d in range(f.channels):
            if self._used[d] != 1 or not (self.whole or first or self.doubt[d, AGREED] >= 0):
                continue
            cell = arrow_cell(f, d, inverse)
            size = cell[LANES] * cell[LANES]        # the error is the next row
            if not size * cell[0] > squares:
                continue
            g = arrow_cell(f, d, arrow_g(f))
            variance = 1 / cell[0]
            for i in range(m):
                for j in range(m):
                    variance += g[i * LANES] * P[i * m + j] * g[j * LANES]
            if size > squares * variance:
                self._used[d] = MARKED
                found += 1
        return found

    cdef bint gate(self, arrow* f, const double* P, int level, double dt) noexcept nogil:
        """Leave out what is not to be used; returns whether that changes anything.

        Parameters
        ----------
        f : arrow
            After its innovations were taken.
        P : (m, m)
            Covariance of the common state.
        level : int
            State of the part that takes over what a channel insists on.
        dt : float
            Since the last update, s.
        """
        cdef int d, out
        cdef double limit = self.limit * self.limit
        cdef bint changed = False
        if not (f.worst > limit or self.doubting):
            return False
        out = self._mark(f, P, limit, dt == 0)
        if out:
            out += self._mark(f, P, SUSPECT * SUSPECT * limit, dt == 0)
        if out > self.few * self.seen and (out > 1 or self.seen < ALONE):
            for d in range(f.channels):
                self._used[d] = self._used[d] and not self.whole
            if self.whole:
                self.rejected, self.seen = self.seen, 0
            return self.whole
        self.doubting = False
        for d in range(f.channels):
            if self._used[d] == MARKED:
                self._judge(f, level, d, dt)
                changed = True
            if self._used[d]:
                self.doubt[d, AGREED] = -1
            elif self.doubt[d, AGREED] >= 0:
                self.doubting = True
        return changed

    cdef void _judge(self, arrow* f, int level, int channel, double dt) noexcept nogil:
        """A marked channel stays out until it has agreed with itself for long enough; then its level is sought anew."""
        cdef double* doubt = &self.doubt[channel, 0]
        cdef double error = arrow_cell(f, channel, arrow_error(f))[0], apart = error - doubt[ERROR]
        doubt[NEW] = doubt[AGREED] < 0
        if doubt[NEW] or apart * apart * arrow_cell(f, channel, arrow_inverse(f))[0] > self.limit * self.limit:
            doubt[AGREED] = 0
        elif f.y[channel] != doubt[VALUE]:  # a value that does not change by a single bit is no evidence
            doubt[AGREED] += dt
        doubt[ERROR], doubt[VALUE] = error, f.y[channel]
        self._used[channel] = doubt[AGREED] >= BELIEVED_S
        if self._used[channel]:
            arrow_cell(f, channel, arrow_variance(f, level))[0] += error * error
        else:
            self.rejected += 1
            self.seen -= 1

    cdef bint readmit(self, const unsigned char[::1] observed, double squares) noexcept nogil:
        """Are the others surprised as well, with the squared innovations ``squares``? Then it is the motion, and
        channels that came into doubt just now enter after all; returns whether that is so."""
        cdef int d
        if not self.rejected or not squares > self.rest * self.seen:
            return False
        for d in range(observed.shape[0]):
            if observed[d] and not self._used[d] and self.doubt[d, NEW]:
                self._used[d] = 1
                self.doubt[d, AGREED] = -1
                self.rejected -= 1
                self.seen += 1
        return True
