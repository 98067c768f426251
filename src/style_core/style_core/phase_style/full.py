"""The full filter's parts: style prior, bases in whitened style coordinates, one filter of a behaviour."""
from dataclasses import replace

import numpy as np

from style_core.errors import ModelError
from style_core.phase_style.kernel import ArrowFilter, Table
from style_core.phase_style.learning import speed_statistics
from style_core.phase_style.model import Behaviour, Residual
from style_core.phase_style.table import BasisTable, tabulate

__all__ = ['style_prior', 'person_weights', 'styles_in_gait', 'gaits_of', 'whitened', 'make_filter',
           'still_behaviour', 'PARTS']

#: Parts of the full filter that can be switched off, to see what each is worth.
PARTS = ('prior', 'offset', 'fast', 'personal', 'drift', 'calibration', 'search', 'restart', 'still', 'rejection')


def style_prior(styles, groups, factor):
    """Gaussian prior of a new person's style.

    Every group (person) has the same weight, however many sequences it has.

    Parameters
    ----------
    styles : ndarray, shape (S, J)
    groups : sequence of str, length S
    factor : float
        On the covariance.

    Returns
    -------
    mean : ndarray, shape (J,)
    root : ndarray, shape (J, J)
        ``root @ root.T`` is the covariance; 2 % of the mean variance are added to every direction.
    """
    weight = person_weights(groups)
    mean = weight @ styles
    centred = styles - mean
    covariance = (centred * weight[:, None]).T @ centred * factor
    floor = max(0.02 * np.trace(covariance) / len(covariance), 1e-12)
    return mean, np.ascontiguousarray(np.linalg.cholesky(covariance + floor * np.eye(len(covariance))))


def person_weights(groups):
    """Weights of sequences that give every group (person) the same, shape (S,); they sum to one."""
    groups = np.asarray(groups)
    weight = np.array([1 / np.sum(groups == group) for group in groups])
    return weight / weight.sum()


def styles_in_gait(styles, groups, gaits, gait):
    """All styles as if they were of one gait: each moved by the difference between that gait's mean and its own.

    So a gait has a mean of its own, and the variation between people is learned from all gaits together.

    Parameters
    ----------
    styles : ndarray, shape (S, J)
    groups : sequence of str, length S
    gaits : ndarray of int, shape (S,)
    gait : int
        One of ``gaits``.

    Returns
    -------
    styles : ndarray, shape (S, J)
    groups : tuple of str, length S
        Person and gait: `style_prior` gives every person the same weight within a gait.
    """
    groups = tuple(f'{group} {own}' if len(set(gaits)) > 1 else group for group, own in zip(groups, gaits))
    means = {}
    for one in set(gaits):
        rows = np.flatnonzero(gaits == one)
        means[one] = person_weights([groups[row] for row in rows]) @ styles[rows]
    return styles + np.array([means[gait] - means[own] for own in gaits]), groups


def gaits_of(behaviour):
    """One `Behaviour` a gait: bases and residual are common, mean style and speeds are the gait's own."""
    if len(set(behaviour.gaits)) < 2:
        return [behaviour]
    parts = []
    for gait in sorted(set(behaviour.gaits)):
        own = behaviour.gaits == gait
        people = [group for group, mine in zip(behaviour.groups, own) if mine]
        velocity = np.array([*speed_statistics(behaviour.speeds[own], person_weights(people)), *behaviour.velocity[2:]])
        styles, groups = styles_in_gait(behaviour.styles, behaviour.groups, behaviour.gaits, gait)
        parts.append(replace(behaviour, styles=styles, groups=groups, velocity=velocity))
    return parts


def whitened(table, mean, root):
    """Table of the mean motion and of the bases of ``z`` where ``style = mean + root z``, J + 1 in all."""
    mix = np.vstack([mean, root.T])
    values, slopes = (np.ascontiguousarray(np.einsum('ij,njd->nid', mix, part))
                      for part in (table.values, table.slopes))
    return BasisTable(values, slopes, np.zeros((len(values), len(mix))), table.rhythmic)


def make_filter(behaviour, table, without=()):
    """A filter with a behaviour's residual model.

    Parameters
    ----------
    behaviour : Behaviour
    table : Table
        Of whitened bases.
    without : collection of str
        Some of `PARTS` to leave out.

    Returns
    -------
    ArrowFilter
    """
    residual = behaviour.residual
    if residual is None:
        raise ModelError(f'behaviour {behaviour.name!r} has no residual model: train it again, or use method paper')
    tiny = 1e-10
    harmonics = np.outer(residual.personal_share, residual.personal)
    if 'personal' in without or not behaviour.rhythmic:
        harmonics = np.zeros((0, len(behaviour.joint_names)))
    noise = residual.noise
    if 'offset' in without and 'fast' in without:
        noise = noise + residual.offset + residual.fast  # white noise has to carry what they would
    return ArrowFilter(
        table, np.full_like(noise, tiny) if 'offset' in without else residual.offset,
        np.full_like(noise, tiny) if 'fast' in without else residual.fast, harmonics, noise,
        (residual.offset_decay, residual.fast_decay, residual.personal_decay,
         0.0 if 'drift' in without else residual.style_decay),
        behaviour.acceleration, (behaviour.velocity[2], behaviour.velocity[3]))


def filter_table(behaviour, without=()):
    """Whitened `BasisTable` of a behaviour."""
    factor = behaviour.residual.style_scale if behaviour.residual is not None else 1.0
    if 'prior' in without:
        factor = 1e4
    return whitened(tabulate(behaviour.processes(), behaviour.rhythmic),
                    *style_prior(behaviour.styles, behaviour.groups, factor))


def still_behaviour(behaviours):
    """Standing still: any posture that the behaviours show, kept.

    Posture varies as over all phases and styles of the behaviours. Within a short time it wanders as far as the slow
    offset of the behaviour that wanders least: what moves more than posture does under a walk is not standing.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models.

    Returns
    -------
    Behaviour
        Named ``'still'``, with a phase that does not move.
    """
    poses = np.concatenate([np.einsum('sj,jcd->scd', one.styles, one.bases).reshape(-1, len(one.joint_names))
                            for one in behaviours])
    first = behaviours[0]
    channels = len(first.joint_names)
    noise = np.mean([one.residual.noise for one in behaviours], axis=0)
    fast = np.mean([one.residual.fast for one in behaviours], axis=0)
    spread = poses.var(axis=0) + np.mean([one.residual.offset for one in behaviours], axis=0)
    # the mean square moved within a short time t is 2 t decay variance
    wander = min(one.residual.offset_decay * one.residual.offset.mean() for one in behaviours)
    bases = np.broadcast_to(poses.mean(axis=0), (1, 8, channels)).copy()
    residual = Residual(
        offset=spread, fast=0.1 * fast, personal=np.zeros(channels), noise=noise,
        offset_decay=wander / spread.mean(), fast_decay=first.residual.fast_decay, personal_decay=0.0,
        style_decay=0.0, personal_share=np.zeros(0), style_scale=0.0, calibration_horizon=np.zeros(1),
        calibration_scale=np.ones(1),
        check_median=float(np.mean([one.residual.check_median for one in behaviours])),
        check_weight=float(np.mean([one.residual.check_weight for one in behaviours])))
    return Behaviour(
        name='still', rhythmic=False, joint_names=first.joint_names, rate_hz=first.rate_hz, sequences=('still',),
        groups=('still',), styles=np.ones((1, 1)), singular_values=np.ones(1), phase_grid=np.linspace(0, 1, 8),
        bases=bases, beta=np.array([[float(np.mean(poses ** 2)) + 1e-6, 0.01, 1e6]]), noise=noise,
        acceleration=1e-9, velocity=np.array([0.0, 1e-3, 0.0, 0.0]), speeds=np.zeros((1, 2)),
        gaits=np.zeros(1, dtype=int), residual=residual)


def filter_for(behaviour, without=()):
    """Table and filter of a behaviour in one go; returns ``(Table, ArrowFilter)``."""
    table = Table(filter_table(behaviour, without))
    return table, make_filter(behaviour, table, without)
