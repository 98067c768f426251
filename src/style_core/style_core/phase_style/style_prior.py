"""The prior of a new person's style, gaits told apart, and bases in style coordinates of unit prior variance."""
from dataclasses import replace

import numpy as np

from style_core.phase_style.basis_table import BasisTable
from style_core.phase_style.learning import speed_statistics

__all__ = ['style_prior', 'person_weights', 'styles_in_gait', 'gaits_of', 'whitened']


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
