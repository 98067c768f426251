"""Labels that people give: one CSV file, rows only ever added."""
import csv
from pathlib import Path

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import read_table

__all__ = ['read_labels', 'append_label', 'labelled']

_COLUMNS = ('fragment', 'flow', 'weight', 'time', 'labeller')


def _rows(path):
    for line, row in read_table(path, _COLUMNS):
        try:
            efforts = tuple(float(row[name]) for name in _COLUMNS[1:4])
        except (TypeError, ValueError):
            raise MotionError(f'{path}, line {line}: flow, weight and time must be numbers') from None
        if not all(abs(effort) <= 3 for effort in efforts):
            raise MotionError(f'{path}, line {line}: efforts lie in [-3, 3]')
        yield row['fragment'], efforts, row['labeller']


def read_labels(path, labeller=None):
    """Read labels.

    Parameters
    ----------
    path : path-like
        Columns fragment, flow, weight, time, labeller.
    labeller : str, optional
        Use this person's rows only.

    Returns
    -------
    dict of str to ndarray, shape (3,)
        Mean over a fragment's rows.

    Raises
    ------
    MotionError
        If columns are missing, a number is none or out of range, or no row is left.
    """
    collected = {}
    for fragment, efforts, who in _rows(path):
        if labeller is None or who == labeller:
            collected.setdefault(fragment, []).append(efforts)
    if not collected:
        raise MotionError(f'{path} has no labels{f" by {labeller}" if labeller else ""}')
    return {fragment: np.mean(rows, axis=0) for fragment, rows in collected.items()}


def labelled(path, labeller):
    """Names of the fragments that a person has labelled already; empty where there is no file."""
    return {fragment for fragment, _, who in _rows(path) if who == labeller} if Path(path).exists() else set()


def append_label(path, fragment, efforts, labeller):
    """Add one row at once, so that nothing is lost when the session is broken off."""
    new = not Path(path).exists()
    with open(path, 'a', newline='', encoding='utf-8') as stream:
        table = csv.writer(stream)
        if new:
            table.writerow(_COLUMNS)
        table.writerow([fragment, *efforts, labeller])
