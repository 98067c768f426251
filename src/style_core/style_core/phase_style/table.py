"""Bases tabulated over phase: values and slopes at equidistant nodes, cubic Hermite in between."""
from dataclasses import dataclass

import numpy as np

__all__ = ['BasisTable', 'tabulate', 'NODES']

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
        values[-1], slopes[-1] = values[0], slopes[0]
    return BasisTable(np.ascontiguousarray(values), np.ascontiguousarray(slopes),
                      np.ascontiguousarray(np.stack([part[2] for part in parts], axis=1)), rhythmic)
