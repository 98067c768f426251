"""The learned locomotion model and its file."""
import warnings
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np

from style_core.errors import ModelError
from style_core.joint_space import read_space
from style_core.locomotion.features import FeatureMap
from style_core.locomotion.personal import Personal
from style_core.model_file import load_model, save_model
from style_core.model_schema import check_model
from style_core.text import did_you_mean

__all__ = ['KIND', 'LocomotionModel', 'without_empty_styles', 'save', 'load', 'from_arrays']

KIND = 'locomotion'


@dataclass(frozen=True, eq=False)
class LocomotionModel:
    """Styles as Gaussian cycles, all over the same M positions.

    Features are those of `FeatureMap` (joint angles, and the root's travel as velocities), in their own units.

    Attributes
    ----------
    features : FeatureMap
    rate_hz : float
        Frames a second the positions advance at.
    mean, variance : ndarray, shape (C, M, F)
        Posterior of each latent cycle.
    noise : ndarray, shape (C, F)
        Variance of a frame about its cycle.
    parent : ndarray, shape (M, F)
    scale : ndarray, shape (F,)
        Spread of each feature in the training data; smoothing and coupling count in units of it.
    smoothing, coupling : float
        Precisions that tie neighbouring positions together and a cycle to the parent.
    weights : ndarray, shape (C,)
        Probability of each style.
    jumps : ndarray, shape (C, J)
        Probability of advancing by 1 .. J positions a frame, averaged over each style's recordings.
    dwell : ndarray, shape (C, M)
        Share of a cycle's time that each style's recordings spend at each position; rows sum to one.
    personal : Personal
        How recordings depart from their style.
    style_names : tuple of str, length C
    recordings : tuple of str, length K
        Names of the training recordings.
    labels : ndarray, shape (K, C)
        Their style probabilities.
    bounds : ndarray, shape (n_iterations,)
        The variational bound after each iteration, nats.
    """

    features: FeatureMap
    rate_hz: float
    mean: np.ndarray
    variance: np.ndarray
    noise: np.ndarray
    parent: np.ndarray
    scale: np.ndarray
    smoothing: float
    coupling: float
    weights: np.ndarray
    jumps: np.ndarray
    dwell: np.ndarray
    personal: Personal
    style_names: Tuple[str, ...]
    recordings: Tuple[str, ...]
    labels: np.ndarray
    bounds: np.ndarray

    @property
    def joint_names(self):
        """Names of the channels, which are also those of the features."""
        return self.features.joint_names

    @property
    def n_styles(self):
        """Number of latent cycles C."""
        return self.mean.shape[0]

    @property
    def n_positions(self):
        """Number of positions M of a cycle."""
        return self.mean.shape[1]

    @property
    def advance(self):
        """Mean advance a frame of each style, positions; shape (C,)."""
        return self.jumps @ np.arange(1, self.jumps.shape[1] + 1)

    @property
    def periods_s(self):
        """Mean duration of each style's cycle, s; shape (C,)."""
        return self.n_positions / (self.advance * self.rate_hz)

    @property
    def phase_of_position(self):
        """Phase at which each position begins, for all styles alike, rad; shape (M + 1,), from 0 to 2 pi.

        Positions are no clock: recordings pass some of them faster. Counted by the time that the styles spend there on
        average, phase runs evenly.
        """
        share = self.weights @ self.dwell
        share = share + 1e-3 / len(share)     # strictly increasing also where nobody stays
        return 2 * np.pi * np.concatenate([[0.0], np.cumsum(share) / share.sum()])

    def style(self, name):
        """Index of a style by its name (or its number, from 0).

        Raises
        ------
        ModelError
            If there is none.
        """
        if name in self.style_names:
            return self.style_names.index(name)
        if str(name).isdigit() and int(name) < self.n_styles:
            return int(name)
        raise ModelError(f'the model has no style {name!r}; it has {", ".join(self.style_names)}'
                         + did_you_mean(str(name), self.style_names))


def without_empty_styles(model):
    """The model without styles that hold no recording (less than half of one); a warning says how many.

    Such a style is as wide as its prior: it shows no motion, but is the least wrong about everybody who is new.
    """
    held = model.labels.sum(axis=0)
    kept = np.flatnonzero(held >= min(0.5, held.max()))
    if len(kept) == len(held):
        return model
    warnings.warn(f'{len(held) - len(kept)} of {len(held)} styles found no recording and are left out', stacklevel=3)
    labels, weights = model.labels[:, kept], model.weights[kept]
    return replace(
        model, mean=model.mean[kept], variance=model.variance[kept], noise=model.noise[kept],
        weights=weights / weights.sum(), jumps=model.jumps[kept], dwell=model.dwell[kept],
        style_names=tuple(model.style_names[k] for k in kept), labels=labels / labels.sum(axis=1, keepdims=True))


_ARRAYS = ('mean', 'variance', 'noise', 'parent', 'scale', 'weights', 'jumps', 'dwell', 'labels', 'bounds')
_PERSONAL = ('pull', 'smooth', 'noise', 'memory')


def save(model, path, **header):
    """Write a model file; ``header`` adds entries such as ``training_files``."""
    header = dict(header, joint_names=list(model.joint_names), units=list(model.features.units), rate_hz=model.rate_hz,
                  smoothing=model.smoothing, coupling=model.coupling, style_names=list(model.style_names),
                  recordings=list(model.recordings))
    arrays = {name: getattr(model, name) for name in _ARRAYS}
    arrays.update((f'personal_{name}', value) for name, value in vars(model.personal).items())
    if model.features.space is not None:
        for part, entries in zip((header, arrays), model.features.space.entries()):
            part.update(entries)
    save_model(path, KIND, header, arrays)


def load(path):
    """Read a model file (ModelError as `style_core.model_file.load_model`)."""
    return from_arrays(*load_model(path, KIND))


def from_arrays(header, arrays):
    """Model from the header and arrays of its file.

    Raises
    ------
    ModelError
        If an entry is missing, cannot be right, or shapes do not fit each other.
    """
    check_model(KIND, header, arrays)
    return without_empty_styles(LocomotionModel(
        FeatureMap(tuple(header['joint_names']), tuple(header['units']), read_space(header, arrays)),
        float(header['rate_hz']),
        smoothing=float(header['smoothing']), coupling=float(header['coupling']),
        personal=Personal(*(np.asarray(arrays[f'personal_{name}'], dtype=float) for name in _PERSONAL)),
        style_names=tuple(header['style_names']), recordings=tuple(header['recordings']),
        **{name: np.asarray(arrays[name], dtype=float) for name in _ARRAYS}))
