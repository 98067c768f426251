"""Whole-body motion from cue signals: a second set of emissions over the machine's states (Brand and Hertzmann, E)."""
from dataclasses import dataclass

import numpy as np

from style_core.errors import ModelError
from style_core.hmm import filter_step, log_density, moments, occupancy
from style_core.style_machine.synthesis import synthesize

__all__ = ['PathMap', 'fit_path_map', 'follow', 'FollowingFilter', 'cue_features']

_REFERENCE_FRAMES = 10.0
_TABLES = 8  # sensor patterns whose whitening matrices are kept


@dataclass(frozen=True, eq=False)
class PathMap:
    """Cue emissions of every state in each training style.

    Attributes
    ----------
    machine : StyleMachine
        The target: its transitions are the backbone.
    styles : tuple of str
    means : ndarray, shape (S, N, C)
        Of the cue features (`cue_features`).
    covs : ndarray, shape (N, C, C)
        Common to the styles.
    """

    machine: object
    styles: tuple
    means: np.ndarray
    covs: np.ndarray


def cue_features(cues, changes=True):
    """Cues and, unless told otherwise, their changes a frame: (T, C) -> (T, 2 C). NaN = missing."""
    cues = np.asarray(cues, dtype=float)
    if cues.ndim != 2 or not len(cues):
        raise ModelError(f'cues must have shape (T, C) with at least one frame, got {cues.shape}')
    if not changes:
        return cues
    change = np.diff(cues, axis=0, prepend=np.full((1, cues.shape[1]), np.nan))
    return np.concatenate([cues, change], axis=1)


def fit_path_map(machine, features, recordings):
    """Learn what the cues look like in every state: remapping to a synchronous signal (4.2).

    Parameters
    ----------
    machine : StyleMachine
    features : list of ndarray, shape (T_k, C)
        In synchrony with training recordings of the machine.
    recordings : list of str
        Their names.

    Returns
    -------
    PathMap
    """
    parts, widths = {}, {x.shape[1] for x in features}
    if len(widths) != 1 or len(features) != len(recordings) or not features:
        raise ModelError('cues need one array a recording, all of the same width')
    for x, name in zip(features, recordings):
        path = machine.recordings.get(name)
        if path is None or len(path) != len(x):
            raise ModelError(f'{name} is no training recording of {len(x)} frames')
        whole = ~np.isnan(x).any(axis=1)
        part = moments(x[whole], np.eye(machine.n_states)[path[whole]])
        style = machine.recording_styles[name]
        parts[style] = parts[style] + part if style in parts else part
    total = None
    for part in parts.values():
        total = part if total is None else total + part
    weight = np.maximum(total.weight, 1e-9)
    overall = total.total.sum(axis=0) / weight.sum()
    # a state that no cue has seen gets the mean of all
    means = (total.total + 1e-3 * overall) / (total.weight + 1e-3)[:, None]
    specific = np.stack([(part.total + machine.strength * means) / (part.weight + machine.strength)[:, None]
                         for part in parts.values()])
    # one covariance a state for all styles: cues are many and frames of one style few, and styles are told apart by
    # likelihoods, in which a covariance of a few frames would have the last word
    scatter = sum(part.scatter(own) for part, own in zip(parts.values(), specific))
    average = scatter.sum(axis=0) / weight.sum()
    average += 1e-6 * np.trace(average) / len(average) * np.eye(len(average)) + 1e-12 * np.eye(len(average))
    pull = max(_REFERENCE_FRAMES, 2.0 * len(average))
    covs = (scatter + pull * average) / (total.weight + pull)[:, None, None]
    return PathMap(machine, tuple(parts), specific, 0.5 * (covs + covs.transpose(0, 2, 1)))


def follow(path_map, features, style=None):
    """Whole-body motion for a recording of cues, off-line, with all of gamma.

    Parameters
    ----------
    path_map : PathMap
    features : ndarray, shape (T, C)
        NaN = missing, marginalised exactly.
    style : str or ndarray, optional
        By default the training style whose cue model makes the cues likeliest.

    Returns
    -------
    motion : Motion
    style : str
        The likeliest style.
    gamma : ndarray, shape (T, N)
    """
    machine = path_map.machine
    scored = [occupancy(log_density(features, path_map.means[k], path_map.covs), machine.start,
                        machine.trans) for k in range(len(path_map.styles))]
    best = int(np.argmax([one.log_likelihood for one in scored]))
    found = path_map.styles[best]
    return synthesize(machine, scored[best].gamma, found if style is None else style), found, scored[best].gamma


class FollowingFilter:
    """The same on line: the filtering distribution over states and styles, frame by frame.

    ``update`` returns occupancies to `StreamingSynthesizer.push`, and the probability of every style.
    """

    def __init__(self, path_map):
        self.path_map = path_map
        self._tables = {}
        self.reset()

    def reset(self):
        """Forget all cues."""
        n = self.path_map.machine.n_states
        count = len(self.path_map.styles)
        self._belief = np.tile(self.path_map.machine.start, (count, 1))
        self._score = np.zeros(count)
        self._first = True
        self._n = n

    def _density(self, x):
        """Log density of one frame under every style and state, shape (S, N); tables are kept for each pattern."""
        seen = ~np.isnan(x)
        if not seen.any():
            return np.zeros(self._belief.shape)
        key = seen.tobytes()
        if key not in self._tables:
            if len(self._tables) >= _TABLES:
                self._tables.pop(next(iter(self._tables)))
            lower = np.linalg.cholesky(self.path_map.covs[:, seen][:, :, seen])
            white = np.linalg.inv(lower)
            self._tables[key] = (white, np.einsum('nij,snj->sni', white, self.path_map.means[:, :, seen]),
                                 -0.5 * seen.sum() * np.log(2 * np.pi)
                                 - np.log(np.einsum('nii->ni', lower)).sum(axis=1))
        white, offset, constant = self._tables[key]
        return constant - 0.5 * ((white @ x[seen] - offset) ** 2).sum(axis=2)

    def update(self, features):
        """Take one frame of features (C,).

        Returns
        -------
        gamma : ndarray, shape (N,)
        styles : dict of str to float
        """
        machine = self.path_map.machine
        density = self._density(np.asarray(features, dtype=float))
        step = np.eye(self._n) if self._first else machine.trans
        for k in range(len(self.path_map.styles)):
            # a floor keeps a way open to states that the cues have just ruled out
            belief = 0.999 * self._belief[k] + 0.001 / self._n
            self._belief[k], gain = filter_step(belief, step, density[k])
            self._score[k] = 0.99 * self._score[k] + gain  # forgets, so that a change of style is noticed
        self._first = False
        weights = np.exp(self._score - self._score.max())
        weights /= weights.sum()
        return weights @ self._belief, dict(zip(self.path_map.styles, weights.tolist()))
