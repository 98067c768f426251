"""Restyling: replace every fragment of a motion by the blend of like fragments that has the asked effort."""
from typing import NamedTuple, Tuple

import numpy as np

from style_core.effort.interpolation import ALPHA_RANGE
from style_core.effort.joins import Joiner
from style_core.effort.library import COMPUTED, Blend
from style_core.effort.pose import Poses
from style_core.effort.segmentation import Segment, Segmenter
from style_core.effort.warping import warp
from style_core.errors import UsageError

__all__ = ['Choice', 'Restyled', 'choose_blend', 'restyle', 'LiveRestyler']

_SAMPLES = 16
_GOLDEN_STEPS = 20
_VERIFIED = 12
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class Choice(NamedTuple):
    """What a segment became."""

    segment: Segment
    blend: Blend
    effort: np.ndarray


class Restyled(NamedTuple):
    """A restyled motion and how it was made; ``distances`` (as `content_distances`) of each piece to its fragment."""

    motion: object
    choices: Tuple[Choice, ...]
    distances: Tuple[float, ...]


def checked_target(target):
    """Target effort as an array (3,); NaN means: as it comes.

    Raises
    ------
    UsageError
        If it is not three numbers in [-3, 3].
    """
    target = np.asarray(target, dtype=float)
    if target.shape != (3,) or (np.abs(target) > 3).any() or np.isnan(target).all():
        raise UsageError('effort is asked for as flow, weight and time, each in [-3, 3], at least one given')
    return target


def choose_blend(library, fragment, target, neighbours=6, verify=None):
    """Pair and alpha whose predicted effort is nearest the target, equation (12).

    Alpha is sampled at 16 values of [-0.25, 1.25] for every ordered pair of content neighbours; the best sample of each
    pair is refined by golden-section search, all pairs at once.

    Parameters
    ----------
    library : EffortLibrary
    fragment : int
        The library fragment that matches the segment.
    target : ndarray, shape (3,)
        NaN entries do not count.
    neighbours : int
        K, including the fragment itself.
    verify : bool, optional
        Make the twelve most promising blends and take the one whose measured effort is nearest. Default: where the
        labels are computed ones, which can be measured; a person's cannot.

    Returns
    -------
    blend : Blend
    effort : ndarray, shape (3,)
        Predicted by the regression, or measured where verified.
    poses : Poses
        Of the blend.
    """
    verify = library.labeller == COMPUTED if verify is None else verify
    near = library.neighbours(fragment, neighbours)
    lengths = np.array([len(poses) for poses in library.fragments])
    pairs = np.array([(i, j) for i in near for j in near
                      if i != j and max(lengths[[i, j]]) <= 3 * min(lengths[[i, j]])])
    if not len(pairs):  # nothing to blend with: the fragment as it is
        return Blend(fragment, fragment, 0.0), library.efforts[fragment], library.fragments[fragment]
    counted = ~np.isnan(target)

    def miss(rows, alphas):
        efforts = library.predicted_efforts(pairs[rows, 0], pairs[rows, 1], alphas)
        return np.sum((efforts - target)[:, counted]**2, axis=1)

    grid = np.linspace(*ALPHA_RANGE, _SAMPLES)
    rows = np.repeat(np.arange(len(pairs)), _SAMPLES)
    sampled = miss(rows, np.tile(grid, len(pairs))).reshape(len(pairs), _SAMPLES)
    best = grid[np.argmin(sampled, axis=1)]
    step = grid[1] - grid[0]
    low, high = np.maximum(best - step, ALPHA_RANGE[0]), np.minimum(best + step, ALPHA_RANGE[1])
    every = np.arange(len(pairs))
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = miss(every, left), miss(every, right)
    for _ in range(_GOLDEN_STEPS):
        inner = at_left < at_right      # the section that holds the least keeps one of its two points
        low, high = np.where(inner, low, left), np.where(inner, right, high)
        new = np.where(inner, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_new = miss(every, new)
        left, at_left, right, at_right = (
            np.where(inner, new, right), np.where(inner, at_new, at_right),
            np.where(inner, left, new), np.where(inner, at_left, at_new))
    alphas = 0.5 * (low + high)
    # a sample at the very end of the range may beat what the search converged to
    refined, at_sample = miss(every, alphas), sampled.min(axis=1)
    alphas, misses = np.where(refined <= at_sample, alphas, best), np.minimum(refined, at_sample)
    order = np.argsort(misses, kind='stable')[:_VERIFIED if verify else 1]
    ranked = [Blend(int(pairs[row, 0]), int(pairs[row, 1]), float(alphas[row])) for row in order]
    made = [library.blend(blend) for blend in ranked]
    if verify:
        group = library.groups[fragment]
        efforts = np.stack([library.computed_effort(poses, group) for poses in made])
    else:
        efforts = library.predicted_efforts(*map(list, zip(*ranked)))
    winner = int(np.argmin(np.sum((efforts - target)[:, counted]**2, axis=1)))
    return ranked[winner], efforts[winner], made[winner]


class LiveRestyler:
    """Restyles a stream: frames in, restyled frames out as soon as a fragment is certain.

    Parameters
    ----------
    library : EffortLibrary
    target : array_like, shape (3,)
        Flow, weight, time; NaN for any. May be changed while running.
    neighbours : int
    verify : bool, optional
        See `choose_blend`.
    """

    def __init__(self, library, target, neighbours=6, verify=None):
        self.library = library
        self.target = checked_target(target)
        self.neighbours = neighbours
        self.verify = verify
        self.choices = []
        self._headings = []
        self._segmenter = Segmenter(library.sequences)
        self._joiner = Joiner(library.rate_hz)

    def push(self, motion):
        """Take input frames (a Motion at the library's rate); returns a list of `Poses` that are final."""
        poses = self.library.space.encode(motion)
        if poses.root is not None:
            headings = poses.start[2] + np.concatenate([[0.0], np.cumsum(poses.root[1:, 3])])
            if self._headings:  # each call unwraps by itself
                headings += 2 * np.pi * np.round((self._headings[-1] - headings[0]) / (2 * np.pi))
            self._headings.extend(headings)
        self._segmenter.push(poses.joints * self.library.scale)
        return self._restyled(self._segmenter.settled())

    def finish(self):
        """End the input; returns the remaining `Poses`."""
        segments, _ = self._segmenter.finish()
        parts = self._restyled(segments[len(self.choices):])
        rest = self._joiner.finish()
        return [*parts, rest]

    def _restyled(self, segments):
        parts = []
        for segment in segments:
            blend, effort, poses = choose_blend(
                self.library, segment.fragment, self.target, self.neighbours, self.verify)
            self.choices.append(Choice(segment, blend, effort))
            done = self._joiner.append(self._on_its_way(poses, segment))
            if done is not None:
                parts.append(done)
        return parts

    def _on_its_way(self, poses, segment):
        """Poses that turn as much in all as the input does here: where a motion leads to is content, not style."""
        if poses.root is None:
            return poses
        turned = self._headings[segment.stop - 1] - self._headings[max(segment.start - 1, 0)]
        root = poses.root.copy()
        root[:, 3] += (turned - root[:, 3].sum()) / len(root)
        return Poses(poses.joints, root, poses.start)


def restyle(library, motion, target, neighbours=6, verify=None):
    """Restyle a recording (section 7).

    Parameters
    ----------
    library : EffortLibrary
    motion : Motion
    target : array_like, shape (3,)
        Flow, weight, time in [-3, 3]; NaN leaves a factor as it comes.
    neighbours : int
        K content neighbours of each matched fragment.
    verify : bool, optional
        See `choose_blend`.

    Returns
    -------
    Restyled
        The motion at the library's rate, starting where and heading as the input does.

    Raises
    ------
    MotionError, UsageError
        If joints or values are missing, or the target is none.
    """
    if abs(motion.rate_hz - library.rate_hz) > 1e-6 * library.rate_hz:
        motion = motion.resample(library.rate_hz)
    restyler = LiveRestyler(library, target, neighbours, verify)
    parts = [*restyler.push(motion), *restyler.finish()]
    start = library.space.encode(motion).start
    root = np.concatenate([part.root for part in parts]) if library.space.has_root else None
    poses = Poses(np.concatenate([part.joints for part in parts]), root, start)
    joints = library.space.encode(motion).joints * library.scale
    distances = tuple(warp(joints[choice.segment.start:choice.segment.stop],
                           library.sequences[choice.segment.fragment]).mean_cost for choice in restyler.choices)
    return Restyled(library.space.decode(poses, library.rate_hz, name=motion.name), tuple(restyler.choices), distances)
