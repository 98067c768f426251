"""The learned phase-style model of one behaviour, and the file that holds one or several of them."""
from dataclasses import dataclass, fields
from typing import Mapping, Optional, Tuple

import numpy as np

from style_core import model_file
from style_core.errors import ModelError
from style_core.histories import Histories
from style_core.phase_style.channel import CHANNEL
from style_core.phase_style.gaussian_process import PhaseProcess

__all__ = ['KIND', 'Behaviour', 'Correction', 'Residual', 'save_behaviours', 'load_behaviours', 'load_parts',
           'restore_behaviours', 'restore_correction']

KIND = 'phase-style'


@dataclass(frozen=True, eq=False)
class Residual:
    """What the bases do not say about a new person, learned by leaving one group of sequences out.

    Attributes
    ----------
    variance : mapping of str to ndarray, shape (D,)
        Of every ingredient of a channel (`style_core.phase_style.channel`), rad^2; where it has harmonics, their sum.
    decay : mapping of str to float
        Of every ingredient, 1/s.
    share : mapping of str to ndarray, shape (K,)
        Of every ingredient that has harmonics: part of its variance in each; sums to one, empty where there is none.
    noise : ndarray, shape (D,)
        Variance of white noise, rad^2.
    style_decay : float
        1/s.
    style_scale : float
        Factor on the covariance of the training styles.
    calibration_horizon, calibration_scale : ndarray, shape (H,)
        Factor on predicted standard deviations by horizon (s) that gave honest 90 % bands on left-out people.
    check_median, check_weight : float
        What checks of predictions usually give, and how many of them that is worth (`style_core.phase_style.bands`).
    """

    variance: Mapping[str, np.ndarray]
    decay: Mapping[str, float]
    share: Mapping[str, np.ndarray]
    noise: np.ndarray
    style_decay: float
    style_scale: float
    calibration_horizon: np.ndarray
    calibration_scale: np.ndarray
    check_median: float
    check_weight: float


@dataclass(frozen=True, eq=False)
class Behaviour:
    """Phase-style model of one behaviour (Matsubara et al. 2012, section 2).

    Attributes
    ----------
    name : str
    rhythmic : bool
        Phase in [0, 2 pi) rad, otherwise discrete: from 0 at the start to 1 at the goal.
    joint_names : tuple of str
    rate_hz : float
        Of the training sequences.
    sequences : tuple of str
        Names of the training sequences.
    groups : tuple of str
        Group (person) of each sequence.
    styles : ndarray, shape (S, J)
    singular_values : ndarray, shape (S,)
    phase_grid : ndarray, shape (C,)
    bases : ndarray, shape (J, C, D)
        Observation bases, rad.
    beta : ndarray, shape (J, 3)
        Kernel hyperparameters of each basis.
    noise : ndarray, shape (D,)
        Variance of the training residuals, rad^2.
    acceleration : float
        Density of the white phase acceleration, rad^2/s^3 (1/s^3 for discrete motion).
    velocity : ndarray, shape (4,)
        Phase velocity: mean, standard deviation, lowest and highest allowed.
    speeds : ndarray, shape (S, 2)
        Mean phase velocity of each sequence and its variance within the sequence.
    gaits : ndarray of int, shape (S,)
        Gait of each sequence, 0 for the slowest (`style_core.phase_style.learning.split_gaits`).
    residual : Residual or None
    """

    name: str
    rhythmic: bool
    joint_names: Tuple[str, ...]
    rate_hz: float
    sequences: Tuple[str, ...]
    groups: Tuple[str, ...]
    styles: np.ndarray
    singular_values: np.ndarray
    phase_grid: np.ndarray
    bases: np.ndarray
    beta: np.ndarray
    noise: np.ndarray
    acceleration: float
    velocity: np.ndarray
    speeds: np.ndarray
    gaits: np.ndarray
    residual: Optional[Residual] = None

    @property
    def style_dimension(self):
        """J."""
        return self.styles.shape[1]

    def processes(self):
        """The Gaussian process of every basis."""
        return [PhaseProcess(self.phase_grid, basis, beta, self.rhythmic)
                for basis, beta in zip(self.bases, self.beta)]


@dataclass(frozen=True, eq=False)
class Correction:
    """Recorded motion, and the weight of what it did next beside the filter's prediction.

    Attributes
    ----------
    histories : Histories
    horizons : ndarray, shape (H,)
        S, increasing.
    weight : ndarray, shape (3, H)
        Of the histories, in [0, 1]: while the filter tracks, while it searches, and when it has just found its way.
    spread : ndarray, shape (2, H)
        Factor on the filter's standard deviation, while it tracks and while it searches.
    fade_s : float
        Time in which all but 1/e of the way from the third weights to the first is gone, s.
    """

    histories: Histories
    horizons: np.ndarray
    weight: np.ndarray
    spread: np.ndarray
    fade_s: float


def save_behaviours(path, behaviours, training=(), correction=None, space=None):
    """Write a model file of kind ``'phase-style'``.

    Parameters
    ----------
    path : path-like
    behaviours : sequence of Behaviour
        All with the same joint names.
    training : iterable of path-like
        Recordings, for the header.
    correction : Correction, optional
        Recorded motion to carry along.
    space : JointSpace, optional
        In which the behaviours were learned; joint angles where left out.
    """
    behaviours = list(behaviours)
    _check_family(behaviours)
    arrays, described = {}, []
    for index, behaviour in enumerate(behaviours):
        entry = {}
        parts = [('', behaviour)]
        if behaviour.residual is not None:
            parts.append(('residual.', behaviour.residual))
        for prefix, part in parts:
            for name, value in _named(part).items():
                if isinstance(value, np.ndarray):
                    arrays[f'{index}.{prefix}{name}'] = value
                elif name not in ('residual', 'joint_names'):
                    entry[prefix + name] = list(value) if isinstance(value, tuple) else value
        described.append(entry)
    header = {'joint_names': list(behaviours[0].joint_names), 'units': ['rad'] * len(behaviours[0].joint_names),
              'rate_hz': behaviours[0].rate_hz, 'behaviours': described,
              'training': model_file.training_files(training)}
    if correction is not None:
        if correction.histories.joint_names != behaviours[0].joint_names:
            raise ModelError('behaviours and histories have different joints')
        header['histories'] = {'names': list(correction.histories.names), 'rate_hz': correction.histories.rate_hz,
                               'fade_s': correction.fade_s}
        for part, names in ((correction.histories, _RECORDED), (correction, _LEARNED)):
            arrays.update({f'histories.{name}': getattr(part, name) for name in names})
    if space is not None:
        for part, entries in zip((header, arrays), space.entries()):
            part.update(entries)
    model_file.save_model(path, KIND, header, arrays)


#: Names in a file of what a residual model says of an ingredient, {} being that ingredient's name.
_OF_INGREDIENTS = {'variance': '{}', 'decay': '{}_decay', 'share': '{}_share'}


def _named(part):
    """Fields by their names in a file; what is said of each ingredient of a channel gets a name of its own."""
    found = {}
    for item in fields(part):
        value = getattr(part, item.name)
        if item.name in _OF_INGREDIENTS:
            found.update({_OF_INGREDIENTS[item.name].format(name): one for name, one in value.items()})
        else:
            found[item.name] = value
    return found


#: Arrays of `Histories` and of `Correction` in a model file.
_RECORDED = ('lengths', 'ends', 'positions')
_LEARNED = ('horizons', 'weight', 'spread')


def load_behaviours(path):
    """Read the behaviours of a model file.

    Returns
    -------
    list of Behaviour

    Raises
    ------
    ModelError
        If the file is not a readable model of this kind, or its parts do not fit each other.
    """
    return restore_behaviours(*model_file.load_model(path, KIND), path)


def load_parts(path):
    """Read everything a model file holds (see `load_behaviours`).

    Returns
    -------
    behaviours : list of Behaviour
    correction : Correction or None
        None where the file holds no recorded motion.
    """
    header, arrays = model_file.load_model(path, KIND)
    return restore_behaviours(header, arrays, path), restore_correction(header, arrays, path)


def restore_correction(header, arrays, path):
    """Correction from the contents of a model file, or None; ``path`` is named in errors."""
    if 'histories' not in header:
        return None
    try:
        about = header['histories']
        names, joints = tuple(about['names']), tuple(header['joint_names'])
        parts = {name: arrays[f'histories.{name}'] for name in _RECORDED + _LEARNED}
        horizons, fade_s = len(parts['horizons']), about.get('fade_s')
        if fade_s is None:  # a file from before weights faded
            fade_s, parts['weight'] = 1.0, np.concatenate([parts['weight'], parts['weight'][:1]])
        wanted = {'lengths': (len(names),), 'ends': (len(names),), 'weight': (3, horizons), 'spread': (2, horizons),
                  'positions': (int(parts['lengths'].sum()), len(joints)), 'horizons': (horizons,)}
        for name, shape in wanted.items():
            if parts[name].shape != shape or not np.all(np.isfinite(parts[name])):
                raise ValueError(f'{name} of the histories does not fit')
        if parts['lengths'].min() < 1 or horizons < 1 or not np.all(np.diff(parts['horizons'], prepend=0.0) > 0):
            raise ValueError('lengths and horizons of the histories must be positive and increase')
        if not (float(about['rate_hz']) > 0 and float(fade_s) > 0):
            raise ValueError('the rate of the histories and the time of their fading must be positive')
        histories = Histories(joints, float(about['rate_hz']), names, parts['lengths'].astype(np.int32),
                              parts['ends'].astype(bool), np.ascontiguousarray(parts['positions'], dtype=np.float32))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f'{path} holds incomplete histories: {error}') from None
    return Correction(histories, parts['horizons'], parts['weight'], parts['spread'], float(fade_s))


def restore_behaviours(header, arrays, path):
    """Behaviours from the contents of a model file; ``path`` is named in errors (see `load_behaviours`)."""
    try:
        behaviours = [_restore(entry, index, header, arrays) for index, entry in enumerate(header['behaviours'])]
        for behaviour in behaviours:
            _check_shapes(behaviour)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise ModelError(f'{path} is an incomplete phase-style model: {error}') from None
    _check_family(behaviours)
    return behaviours


def _restore(entry, index, header, arrays):
    def part(kind, prefix, **given):
        values = {}
        for item in fields(kind):
            key = f'{index}.{prefix}{item.name}'
            if item.name in given:
                values[item.name] = given[item.name]
            elif key in arrays:
                values[item.name] = arrays[key]
            else:
                value = entry[prefix + item.name]
                values[item.name] = tuple(value) if isinstance(value, list) else value
        return kind(**values)

    residual = None
    if 'residual.style_decay' in entry:
        if 'residual.check_median' not in entry:
            raise ValueError('it was made before bands followed the person; train it again')
        residual = part(Residual, 'residual.', **_ingredients(entry, index, arrays))
    given = {'joint_names': tuple(header['joint_names']), 'residual': residual}
    if f'{index}.gaits' not in arrays:  # made before gaits were told apart: one of them, as it was
        count = len(entry['sequences'])
        given.update(gaits=np.zeros(count, dtype=int),
                     speeds=np.tile([arrays[f'{index}.velocity'][0], 0.0], (count, 1)))
    return part(Behaviour, '', **given)


def _ingredients(entry, index, arrays):
    """What a file says of the ingredients of a channel; those it does not name were not known when it was made."""
    prefix, suffix = 'residual.', '_decay'
    named = [key[len(prefix):-len(suffix)] for key in entry if key.startswith(prefix) and key.endswith(suffix)]
    unknown = set(named) - {*(one.name for one in CHANNEL), 'style'}
    if unknown:
        raise ValueError(f'its channels have {", ".join(sorted(unknown))}, which this version does not know')
    here = [one for one in CHANNEL if one.name in named]
    return {'variance': {one.name: arrays[f'{index}.{prefix}{one.name}'] for one in here},
            'decay': {one.name: entry[f'{prefix}{one.name}{suffix}'] for one in here},
            'share': {one.name: arrays[f'{index}.{prefix}{one.name}_share'] for one in here if one.turns}}


def _check_shapes(behaviour):
    sequences, channels = len(behaviour.sequences), len(behaviour.joint_names)
    styles, samples = behaviour.style_dimension, len(behaviour.phase_grid)
    wanted = {'styles': (sequences, styles), 'bases': (styles, samples, channels), 'beta': (styles, 3),
              'noise': (channels,), 'velocity': (4,), 'speeds': (sequences, 2), 'gaits': (sequences,)}
    for name, shape in wanted.items():
        array = getattr(behaviour, name)
        if array.shape != shape:
            raise ValueError(f'{name} has shape {array.shape}, expected {shape}')
        if not np.all(np.isfinite(array)):
            raise ValueError(f'{name} is not finite')
    if set(behaviour.gaits) - {0, 1}:
        raise ValueError('gaits are numbered 0 and 1')
    if behaviour.residual is not None:
        if not (behaviour.residual.check_median > 0 and behaviour.residual.check_weight > 0):
            raise ValueError('check_median and check_weight must be positive')
        for name, array in {**behaviour.residual.variance, 'noise': behaviour.residual.noise}.items():
            if array.shape != (channels,) or not np.all(np.isfinite(array)):
                raise ValueError(f'residual {name} does not fit {channels} joints')


def _check_family(behaviours):
    if not behaviours:
        raise ModelError('a phase-style model needs at least one behaviour')
    names = [behaviour.name for behaviour in behaviours]
    if len(set(names)) != len(names):
        raise ModelError(f'behaviours must have different names, got {", ".join(names)}')
    for behaviour in behaviours[1:]:
        if behaviour.joint_names != behaviours[0].joint_names:
            raise ModelError(f'behaviours {names[0]!r} and {behaviour.name!r} have different joints')
