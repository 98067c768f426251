"""The effort library: labelled fragments, their content, and the regression from blends to efforts."""
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Optional, Tuple

import numpy as np

from style_core.effort.content import (
    ContentSpace,
    content_distances,
    content_groups,
    content_space,
    content_threshold,
)
from style_core.effort.descriptors import EFFORTS, EffortScale, effort_scale, raw_descriptors
from style_core.effort.interpolation import ALPHA_RANGE, interpolate_poses
from style_core.effort.pose import Poses, PoseSpace, pose_space, pose_space_of
from style_core.effort.regression import features, fit_regression
from style_core.errors import ModelError, MotionError
from style_core.joint_space import read_space
from style_core.model_file import load_model, save_model

__all__ = ['Blend', 'EffortLibrary', 'train_library', 'draw_blends', 'load', 'save', 'KIND', 'COMPUTED']

KIND = 'effort'
#: name of the labeller wherever labels come from the descriptors and not from a person
COMPUTED = 'computed'


class Blend(NamedTuple):
    """Space-time interpolation of two fragments."""

    first: int
    second: int
    alpha: float

    def title(self, names):
        """Name of the blend in label files, e.g. ``walk_a~walk_b@0.37``."""
        return f'{names[self.first]}~{names[self.second]}@{self.alpha:.3f}'


@dataclass(frozen=True, eq=False)
class EffortLibrary:
    """Everything a restyling needs.

    Attributes
    ----------
    space : PoseSpace
    rate_hz : float
    names : tuple of str, length N
    fragments : tuple of Poses, length N
    scale : ndarray, shape (D,)
        Weight of each joint channel in distances and descriptors.
    distances : ndarray, shape (N, N)
        See `content_distances`.
    threshold : float
    groups : ndarray of int, shape (N,)
        Content group of each fragment.
    efforts : ndarray, shape (N, 3)
        Flow, Weight, Time of each fragment.
    effort_scale : EffortScale
        Of the computed descriptors.
    labeller : str
        Who gave the labels; ``'computed'`` for the descriptors.
    content : ContentSpace
    blends : tuple of Blend, length M
    blend_efforts : ndarray, shape (M, 3)
    method : str
    settings : list of dict
    model : object
        The fitted regression.
    """

    space: PoseSpace
    rate_hz: float
    names: Tuple[str, ...]
    fragments: Tuple[Poses, ...]
    scale: np.ndarray
    distances: np.ndarray
    threshold: float
    groups: np.ndarray
    efforts: np.ndarray
    effort_scale: EffortScale
    labeller: str
    content: ContentSpace
    blends: Tuple[Blend, ...]
    blend_efforts: np.ndarray
    method: str
    settings: list
    model: object
    header: Optional[dict] = None

    @cached_property
    def sequences(self):
        """Scaled poses of every fragment, list of (T_i, D)."""
        return [fragment.joints * self.scale for fragment in self.fragments]

    @cached_property
    def contents(self):
        """Content vectors, shape (N, K)."""
        return np.stack([self.content.coefficients(sequence) for sequence in self.sequences])

    def blend(self, blend):
        """Return the `Poses` of a `Blend`."""
        return interpolate_poses(self.fragments[blend.first], self.fragments[blend.second], blend.alpha,
                                 scale=self.scale)

    def computed_effort(self, poses, group):
        """Effort labels of poses by the descriptors, relative to a content group; shape (3,)."""
        return self.effort_scale.labels(raw_descriptors(poses.joints, self.rate_hz, self.scale), group)

    def predicted_efforts(self, first, second, alpha):
        """Regression's effort of blends, shape (M, 3)."""
        return self.model.predict(features(self.contents, self.efforts, first, second, alpha))

    def neighbours(self, fragment, count):
        """The fragment itself and its nearest of the same content group, at most ``count`` in all."""
        order = np.argsort(self.distances[fragment], kind='stable')
        same = [int(other) for other in order if self.groups[other] == self.groups[fragment] and other != fragment]
        return [fragment, *same[:count - 1]]


def draw_blends(groups, lengths, count, seed):
    """Draw pairs of matching fragments and alphas in [-0.25, 1.25].

    Parameters
    ----------
    groups, lengths : ndarray of int, shape (N,)
    count : int
    seed : int

    Returns
    -------
    list of Blend

    Raises
    ------
    ModelError
        If no two fragments share a content group.
    """
    pairs = [(i, j) for i in range(len(groups)) for j in range(len(groups))
             if i != j and groups[i] == groups[j] and max(lengths[i], lengths[j]) <= 3 * min(lengths[i], lengths[j])]
    if not pairs:
        raise ModelError('no two fragments show the same content: there is nothing to interpolate. Add recordings of '
                         'the same actions in other styles')
    generator = np.random.default_rng(seed)
    chosen = generator.integers(len(pairs), size=count)
    alphas = generator.uniform(*ALPHA_RANGE, size=count)
    return [Blend(*pairs[k], float(alpha)) for k, alpha in zip(chosen, alphas)]


def train_library(motions, groups=None, scale=None, labels=None, blends=105, method='kernel-ridge', seed=0,
                  components=3, progress=lambda items: items, rate_hz=None):
    """Build a library.

    Parameters
    ----------
    motions : sequence of Motion
        One fragment each, with the same joints and different names.
    groups : sequence of int, optional
        Content group of each; found from the distances where not given.
    scale : ndarray, shape (D,), optional
        Weight of each joint channel (root left out), e.g. m/rad; 1 where not given.
    labels : mapping of str to array_like, shape (3,), optional
        A person's labels (flow, weight, time) by fragment name and blend title, see `Blend.title`. Without it the
        descriptors label everything.
    blends : int or sequence of Blend
        How many interpolations to learn from, or which.
    method : str
        See `fit_regression`.
    seed : int
    components : int
        Principal components of the content vector.
    progress : callable
        Wraps long loops.
    rate_hz : float, optional
        Of the library; the first motion's where not given.

    Returns
    -------
    EffortLibrary

    Raises
    ------
    MotionError, ModelError
        If fragments cannot be used or labels are missing.
    """
    motions = list(motions)
    if len(motions) < 2:
        raise ModelError(f'a library needs at least two fragments, got {len(motions)}')
    names = tuple(motion.name for motion in motions)
    if len(set(names)) != len(names):
        raise ModelError('two fragments have the same name')
    rate_hz = rate_hz or motions[0].rate_hz
    space = pose_space(motions)
    fragments = tuple(space.encode(motion if abs(motion.rate_hz - rate_hz) < 1e-6 * rate_hz
                                   else motion.resample(rate_hz)) for motion in motions)
    scale = np.ones(len(space.joint_names)) if scale is None else np.asarray(scale, dtype=float)
    if scale.shape != (len(space.joint_names),) or not (np.isfinite(scale) & (scale >= 0)).all():
        raise ModelError(f'scale must hold {len(space.joint_names)} numbers >= 0')
    raw = [_described(name, fragment, rate_hz, scale) for name, fragment in zip(names, fragments)]
    sequences = [fragment.joints * scale for fragment in fragments]
    distances = content_distances(sequences, progress)
    threshold = content_threshold(distances)
    groups = content_groups(distances, threshold) if groups is None else _numbered(groups, len(motions))
    measure = effort_scale(raw, groups)
    if isinstance(blends, int):
        blends = draw_blends(groups, [len(fragment) for fragment in fragments], blends, seed)
    blends = tuple(blends)
    if labels is None:
        labeller = COMPUTED
        efforts = np.stack([measure.labels(r, g) for r, g in zip(raw, groups)])
        blend_efforts = np.stack([
            measure.labels(raw_descriptors(interpolate_poses(
                fragments[b.first], fragments[b.second], b.alpha, scale=scale).joints, rate_hz, scale),
                groups[b.first]) for b in progress(blends)])
    else:
        labeller = 'person'
        efforts = _labels(labels, names, 'fragment')
        known = [b for b in blends if b.title(names) in labels]
        blends = tuple(known) if known else blends
        blend_efforts = _labels(labels, [b.title(names) for b in blends], 'interpolation')
    content = content_space(sequences, components)
    contents = np.stack([content.coefficients(sequence) for sequence in sequences])
    z = features(contents, efforts, [b.first for b in blends], [b.second for b in blends], [b.alpha for b in blends])
    model, settings = fit_regression(method, z, blend_efforts, seed=seed)
    return EffortLibrary(space, float(rate_hz), names, fragments, scale, distances, threshold, groups, efforts,
                         measure, labeller, content, blends, blend_efforts, method, settings, model)


def save(library, path, header=()):
    """Write a library as a model file of kind ``effort``.

    Parameters
    ----------
    library : EffortLibrary
    path : path-like
    header : mapping, optional
        Further JSON entries, e.g. ``training_files``.
    """
    lengths = [len(fragment) for fragment in library.fragments]
    arrays = {
        'joints': np.concatenate([fragment.joints for fragment in library.fragments]),
        'starts': np.stack([fragment.start for fragment in library.fragments]),
        'lengths': np.array(lengths), 'scale': library.scale, 'distances': library.distances,
        'groups': library.groups, 'efforts': library.efforts, 'scale_means': library.effort_scale.means,
        'scale_deviations': library.effort_scale.deviations, 'content_mean': library.content.mean,
        'content_basis': library.content.basis,
        'blend_pairs': np.array([(b.first, b.second) for b in library.blends]),
        'blend_alphas': np.array([b.alpha for b in library.blends]), 'blend_efforts': library.blend_efforts}
    if library.space.has_root:
        arrays['root'] = np.concatenate([fragment.root for fragment in library.fragments])
    names = list(library.space.joint_names)
    about, more = library.space.joints.entries()
    arrays.update(more)
    save_model(path, KIND, dict(header, **about, units=list(library.space.units),
                                root=[library.space.root, library.space.root_order], joint_names=names,
                                fragment_names=list(library.names), efforts=list(EFFORTS),
                                rate_hz=library.rate_hz, threshold=library.threshold, labeller=library.labeller,
                                method=library.method, settings=library.settings), arrays)


def load(path):
    """Read a library; the regression is fitted again from the stored examples and settings.

    Raises
    ------
    ModelError
        If the file is not an effort library or is damaged.
    """
    header, arrays = load_model(path, KIND)
    try:
        lengths = arrays['lengths']
        cuts = np.cumsum(lengths)[:-1]
        poses = np.split(arrays['joints'], cuts)
        roots = np.split(arrays['root'], cuts) if 'root' in arrays else [None] * len(lengths)
        fragments = tuple(Poses(j, r, s) for j, r, s in zip(poses, roots, arrays['starts']))
        joints = read_space(header, arrays)
        space = pose_space_of(header['joint_names'], 'root' in arrays) if joints is None else PoseSpace(
            joints, tuple(header['units']), *header['root'])
        content = ContentSpace(arrays['content_mean'], arrays['content_basis'])
        blends = tuple(Blend(int(i), int(j), float(a)) for (i, j), a in zip(arrays['blend_pairs'],
                                                                         arrays['blend_alphas']))
        contents = np.stack([content.coefficients(j * arrays['scale']) for j in poses])
        z = features(contents, arrays['efforts'], *arrays['blend_pairs'].T, arrays['blend_alphas'])
        model, settings = fit_regression(header['method'], z, arrays['blend_efforts'], header['settings'])
        return EffortLibrary(
            space, header['rate_hz'], tuple(header['fragment_names']), fragments, arrays['scale'],
            arrays['distances'], header['threshold'], arrays['groups'], arrays['efforts'],
            EffortScale(arrays['scale_means'], arrays['scale_deviations']), header['labeller'], content, blends,
            arrays['blend_efforts'], header['method'], settings, model, header)
    except (KeyError, ValueError, IndexError, TypeError, ArithmeticError) as error:
        raise ModelError(f'{path} is a damaged effort library: {error}') from None


def _described(name, fragment, rate_hz, scale):
    try:
        return raw_descriptors(fragment.joints, rate_hz, scale)
    except MotionError as error:
        raise MotionError(f'fragment {name}: {error}') from None


def _numbered(groups, count):
    groups = list(groups)
    if len(groups) != count:
        raise ModelError(f'{count} fragments need {count} content groups, got {len(groups)}')
    order = {}
    return np.array([order.setdefault(group, len(order)) for group in groups])


def _labels(labels, titles, what):
    missing = [title for title in titles if title not in labels]
    if missing:
        raise ModelError(f'{len(missing)} of {len(titles)} {what}s have no label, the first is {missing[0]!r}: '
                         'collect them with motion-style label')
    values = np.array([labels[title] for title in titles], dtype=float)
    if values.shape != (len(titles), 3) or not (np.abs(values) <= 3).all():
        raise ModelError(f'{what} labels must be flow, weight and time in [-3, 3]')
    return values
