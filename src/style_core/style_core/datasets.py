"""The real recordings that tests, experiments and benchmarks use where they are present."""
import os
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import read_table
from style_core.recordings import read_recording
from style_core.skeleton import read_skeleton

__all__ = ['BODY', 'Trial', 'mocap_folder', 'labels', 'trials', 'trial_path', 'trial', 'skeleton', 'cmu8']

#: the 50 body channels of a CMU recording: all joints but fingers and thumbs, which are constant or noise; no root
BODY = ('!root.*', '!*fingers.*', '!*thumb.*')


class Trial(NamedTuple):
    """A row of ``labels.csv``."""

    name: str
    file: str
    rate_hz: float
    frames: int
    action: str
    description: str

    @property
    def subject(self):
        """The part of the name before the underscore, e.g. ``'08'``."""
        return self.name.split('_')[0]


def mocap_folder():
    """Folder of the recordings.

    The environment variable ``STYLE_MOCAP``, else ``../shared/mocap`` beside the project or the working directory.

    Raises
    ------
    MotionError
        If there is none.
    """
    if os.environ.get('STYLE_MOCAP'):
        folder = Path(os.environ['STYLE_MOCAP'])
        if not (folder / 'labels.csv').is_file():
            raise MotionError(f'STYLE_MOCAP points to {folder}, which has no labels.csv')
        return folder
    here = Path(__file__).resolve()
    for root in (*(parent for parent in here.parents if (parent / 'src' / 'style_core').is_dir()), Path.cwd()):
        folder = root.parent / 'shared' / 'mocap'
        if (folder / 'labels.csv').is_file():
            return folder
    raise MotionError('no recordings here: set STYLE_MOCAP to the folder that holds labels.csv')


def labels():
    """All rows of ``labels.csv``, as a tuple of `Trial`."""
    return _labels(mocap_folder())


@lru_cache(maxsize=4)
def _labels(folder):
    return tuple(Trial(row['trial'], row['file'], float(row['rate_hz']), int(row['frames']), row['action'],
                       row['description']) for _, row in read_table(
                     folder / 'labels.csv', ('trial', 'file', 'rate_hz', 'frames', 'action', 'description')))


def trials(action=None, subject=None):
    """Names of the trials.

    Parameters
    ----------
    action : str or sequence of str, optional
        ``walk``, ``slow_walk``, ``run``, ``jump``, ``dance``, ``styled``.
    subject : str or sequence of str, optional
        E.g. ``'08'``.

    Returns
    -------
    list of str
        In the order of ``labels.csv``.
    """
    actions = (action,) if isinstance(action, str) else action
    subjects = (subject,) if isinstance(subject, str) else subject
    return [row.name for row in labels()
            if (actions is None or row.action in actions) and (subjects is None or row.subject in subjects)]


def trial_path(name):
    """Path of a trial's file (MotionError for an unknown trial)."""
    return mocap_folder() / _row(name).file


def trial(name, rate_hz=60.0):
    """Read a trial with continuous angles.

    Parameters
    ----------
    name : str
        E.g. ``'08_01'``.
    rate_hz : float or None
        Resampled to this rate; None keeps the recording's own.

    Returns
    -------
    Motion
        62 channels; ``select(*BODY)`` keeps the 50 of the body.
    """
    row = _row(name)
    motion = read_recording(mocap_folder() / row.file, rate_hz=row.rate_hz).replace(name=name)
    return motion if rate_hz is None or rate_hz == row.rate_hz else motion.resample(rate_hz)


@cache
def skeleton(name):
    """Skeleton of a trial or subject (``'08_01'`` or ``'08'``).

    Raises
    ------
    MotionError
        If the subject has no skeleton file (13: rebuilt recordings).
    """
    subject = name.split('_')[0]
    path = mocap_folder() / 'cmu' / subject / f'{subject}.asf'
    if not path.is_file():
        raise MotionError(f'there is no skeleton file for subject {subject!r}')
    return read_skeleton(path)


def cmu8(split, action):
    """Sequences of the CMU 8-action prediction benchmark (see `style_core.cmu8`).

    Parameters
    ----------
    split : {'train', 'test'}
    action : {'walking', 'running', 'jumping'}

    Returns
    -------
    list of (str, ndarray of shape (T, 117))
        Name and rows of each file at 120 Hz, as the benchmark has them: the first row is a T-pose.

    Raises
    ------
    MotionError
        If there is no such folder or a file is damaged.
    """
    folder = mocap_folder() / 'cmu8' / split / action
    if not folder.is_dir():
        raise MotionError(f'there is no benchmark folder {split}/{action} in {folder.parents[1]}')
    sequences = []
    for path in sorted(folder.glob('*.txt')):
        try:
            rows = np.loadtxt(path, delimiter=',', ndmin=2)
        except ValueError as error:
            raise MotionError(f'{path}: {error}') from None
        if rows.shape[1] != 117:
            raise MotionError(f'{path} has {rows.shape[1]} columns, the benchmark has 117')
        sequences.append((path.stem, rows))
    return sequences


def _row(name):
    for row in labels():
        if row.name == name:
            return row
    raise MotionError(f'there is no trial {name!r} in labels.csv')
