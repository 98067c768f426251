"""Bases tabulated over phase: values and slopes at equidistant nodes, cubic Hermite in between."""
from dataclasses import dataclass

import numpy as np

from style_core.phase_style.memory cimport aligned_single

__all__ = ['BasisTable', 'Table', 'tabulate', 'NODES']

#: Nodes a cycle. With the shortest length scales the training allows through, the cubic stays within 1e-4 of a
#: basis' largest value (a test holds it to that).
NODES = 128


@dataclass(frozen=True, eq=False)
class BasisTable:
    """Attributes
    ----------
    values, slopes : ndarray, shape (NODES + 1, J, D)
        Basis and its derivative by phase times the node distance, at each node; the last node of a rhythmic
        table repeats the first.
    variance : ndarray, shape (NODES + 1, J)
        Posterior variance of each basis.
    rhythmic : bool
    """

    values: np.ndarray
    slopes: np.ndarray
    variance: np.ndarray
    rhythmic: bool


def tabulate(processes, rhythmic):
    """Tabulate Gaussian processes.

    Parameters
    ----------
    processes : sequence of PhaseProcess
    rhythmic : bool

    Returns
    -------
    BasisTable
    """
    span = 2 * np.pi if rhythmic else 1.0
    phase = np.linspace(0.0, span, NODES + 1)
    parts = [process.evaluate(phase) for process in processes]
    values = np.stack([part[0] for part in parts], axis=1)
    slopes = np.stack([part[1] for part in parts], axis=1) * (span / NODES)
    if rhythmic:
        values[NODES], slopes[NODES] = values[0], slopes[0]
    return BasisTable(np.ascontiguousarray(values), np.ascontiguousarray(slopes),
                      np.ascontiguousarray(np.stack([part[2] for part in parts], axis=1)), rhythmic)


cdef class Table:
    """A `BasisTable` ready for look-ups, its channels filled up to whole blocks."""

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
        cubic_weights(at, u, rate)

    cdef double variance(self, double phase, const double* weight) noexcept nogil:
        """Eq. (13): ``sum_j weight_j^2 variance_j``, linear between nodes."""
        cdef int node, j
        cdef double u, rate, total = 0
        self.place(phase, &node, &u, &rate)
        for j in range(self.count):
            total += weight[j] * weight[j] * ((1 - u) * self.variances[node, j] + u * self.variances[node + 1, j])
        return total

    def evaluate(self, double phase):
        """Bases and their derivatives by phase at one phase, each (J, D): eq. (1) of docs/phase_style.md."""
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
                value[j, d] = cubic_of(at.h, p, q, r, s)
                slope[j, d] = cubic_of(at.h + 4, p, q, r, s)
        return np.asarray(value), np.asarray(slope)
