"""Style coordinates and content of a new recording (Brand and Hertzmann 2000, 4.4)."""
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np

from style_core.errors import ModelError
from style_core.hmm import log_density, moments, occupancy, viterbi
from style_core.style_machine import emission as em

__all__ = ['Analysis', 'analyze', 'joint_gaussians', 'nearest_style', 'style_spacing']

_ITERATIONS = 8
_OUT_OF_RANGE = 1.5      # times the largest distance from one training style to the next
_UNLIKELY = 3.0          # times the spread of the training recordings' log likelihoods a frame


@dataclass(frozen=True, eq=False)
class Analysis:
    """What a style machine finds in a recording.

    Attributes
    ----------
    name : str
    v : ndarray, shape (K,)
        Style coordinates.
    gamma : ndarray, shape (T, N)
        Occupancies: the content.
    path : ndarray of int, shape (T,)
        Most probable states.
    emission : Emission
        The recording's own specific model (its dwell times scale the content when it changes style).
    nearest : str
        Training style nearest in style space.
    distance : float
        To it; 1 is the root mean square distance of the training styles from the generic model.
    distances : dict of str to float
    log_likelihood : float
        A frame, nats.
    out_of_range : bool
    reasons : tuple of str
        Why it is out of range.
    """

    name: str
    v: np.ndarray
    gamma: np.ndarray
    path: np.ndarray
    emission: em.Emission
    nearest: str
    distance: float
    distances: dict
    log_likelihood: float
    out_of_range: bool
    reasons: Tuple[str, ...]


def joint_gaussians(machine, emission):
    """Means (N, D) and covariances (N, D, D) of joint coordinates in every state, rad."""
    c = machine.coordinates
    to_joints = c.basis.T / c.weights
    covs = to_joints.T @ emission.position_covariances() @ to_joints
    return c.decode(emission.positions + emission.pose), 0.5 * (covs + covs.transpose(0, 2, 1))


def style_spacing(machine):
    """Scale of distances in style space: root mean square of the training styles' distances from the generic one."""
    lengths = np.linalg.norm(machine.axes, axis=1)
    points = np.array(list(machine.styles.values())) * lengths
    return lengths, np.sqrt((points ** 2).sum(axis=1).mean()) + 1e-300


def nearest_style(machine, v):
    """Distances of v to every training style, nearest first, as a dict."""
    lengths, unit = style_spacing(machine)
    found = {name: float(np.linalg.norm((v - point) * lengths) / unit) for name, point in machine.styles.items()}
    return dict(sorted(found.items(), key=lambda item: item[1]))


def analyze(machine, motion):
    """Find style and content of a recording.

    A copy of the training style (or of the generic model) that makes the recording likeliest is trained on it under
    the cross-entropy prior towards the generic model; its parameters are projected on the style axes, each state
    counting as far as the recording visits it.

    Parameters
    ----------
    machine : StyleMachine
    motion : Motion
        May lack joints or values: occupancies then come from the observed joints, marginalised exactly, and the
        statistics of what is missing from its expectation.

    Returns
    -------
    Analysis

    Raises
    ------
    ModelError
        If nothing of the model is observed.
    """
    c = machine.coordinates
    motion = machine.encoded(c.fit(motion, absent='nan'))
    positions = motion.positions
    holes = np.isnan(positions)
    if holes.all():
        raise ModelError(f'{motion.name or "the recording"} shows none of the model\'s joints')
    never = holes.all(axis=0)
    generic = machine.generic
    generic_pose = c.decode(generic.pose)
    with np.errstate(invalid='ignore'):
        pose_rad = np.where(never, generic_pose,
                            np.nansum(positions, axis=0) / np.maximum((~holes).sum(axis=0), 1))
    pose = c.encode(pose_rad)
    centred = positions - pose_rad + generic_pose  # as the generic model sees it
    q = c.leading
    if holes.any():
        data, gaussians = centred, lambda one: joint_gaussians(machine, one)
    else:
        data = (c.encode(positions) - pose)[:, :q]

        def gaussians(one):
            return one.positions[:, :q], one.covs[:, :q, :q]
    common_means, common_covs = gaussians(generic)
    common = log_density(data, common_means, common_covs)
    candidates = [(common_means, common_covs)]
    for v in machine.styles.values():
        style = machine.at(v)
        candidates.append(gaussians(replace(style, pose=generic.pose)))
    scored = []
    for means, covs in candidates:
        density = 0.5 * (common + log_density(data, means, covs))
        scored.append(occupancy(density, machine.start, machine.trans).log_likelihood)
    means, covs = candidates[int(np.argmax(scored))]
    for _ in range(_ITERATIONS):
        density = 0.5 * (common + log_density(data, means, covs))
        found = occupancy(density, machine.start, machine.trans)
        means, covs = em.drawn_gaussians(moments(data, found.gamma, means, covs), common_means, common_covs,
                                         machine.strength)
    density = 0.5 * (common + log_density(data, means, covs))
    found = occupancy(density, machine.start, machine.trans)
    path, _ = viterbi(density, machine.start, machine.trans)
    filled = positions
    if holes.any():
        filled = np.where(holes, _expected(data, found.gamma, means, covs) - generic_pose + pose_rad, positions)
    statistics = em.velocity_moments(c.encode(filled) - pose, found.gamma, found.counts, q)
    own = em.remap_specific(statistics, pose, generic, machine.strength)
    v = _project(machine, own, statistics.occupancy)
    distances = nearest_style(machine, v)
    nearest = next(iter(distances))
    likelihood = found.log_likelihood / len(path)
    reasons = _doubts(machine, v, distances[nearest], likelihood, holes.any())
    return Analysis(motion.name, v, found.gamma, path, own, nearest, distances[nearest], distances, float(likelihood),
                    bool(reasons), reasons)


def _expected(data, gamma, means, covs):
    """Expectation of missing channels given the observed ones and the occupancies."""
    result = data.copy()
    holes = np.isnan(data)
    masks, which = np.unique(holes, axis=0, return_inverse=True)
    which = np.ravel(which)
    for k, mask in enumerate(masks):
        if not mask.any():
            continue
        rows, seen = np.flatnonzero(which == k), ~mask
        value = np.zeros((len(rows), int(mask.sum())))
        for i in np.flatnonzero(gamma[rows].sum(axis=0) > 1e-12):
            gain = np.linalg.solve(covs[i][np.ix_(seen, seen)], covs[i][np.ix_(seen, mask)]) if seen.any() \
                else np.zeros((0, int(mask.sum())))
            value += gamma[rows, i, None] * (means[i, mask] + (data[np.ix_(rows, seen)] - means[i, seen]) @ gain)
        result[np.ix_(rows, mask)] = value
    return result


def _project(machine, emission, occupied):
    """Weighted least squares of the difference from the generic model on the style axes."""
    d, q = emission.positions.shape[1], emission.leading
    gap = machine.layout.pack(emission) - machine.layout.pack(machine.generic)
    weight = machine.layout.weights(occupied / (occupied + machine.strength), d, q)
    weighted = machine.axes * weight
    return np.linalg.solve(weighted @ machine.axes.T + 1e-12 * np.trace(weighted @ machine.axes.T)
                           * np.eye(machine.dof), weighted @ gap)


def _doubts(machine, v, distance, likelihood, incomplete):
    reasons = []
    if len(machine.styles) > 1:
        spacing = max(list(nearest_style(machine, point).values())[1] for point in machine.styles.values())
        if distance > _OUT_OF_RANGE * max(spacing, 1e-9):
            reasons.append(f'style {distance:.2f} from the nearest training style, which lie up to {spacing:.2f} apart')
    if machine.likelihoods and not incomplete:  # with joints missing, likelihoods cannot be compared
        known = np.array(list(machine.likelihoods.values()))
        least = known.min() - _UNLIKELY * max(float(known.std()), 0.5)
        if likelihood < least:
            reasons.append(f'log likelihood {likelihood:.1f} a frame, training recordings at least {known.min():.1f}')
    return tuple(reasons)
