"""What the file of every kind of model must hold: names, numbers, shapes and ranges.

A shape is written in letters, as in the docstrings: ``'C M F'``. A letter means one size throughout a file; sizes that
names give (D joints) are known from the start. A kind without an entry here is checked for what all kinds share.
"""
import math

import numpy as np

from style_core.errors import ModelError

__all__ = ['check_model', 'KINDS']

#: no array of a model is larger than this, in numbers: a damaged header must not ask for all memory
_MOST = 2 ** 31


class _Contents:
    """Header and arrays of a file, each entry checked as it is asked for."""

    def __init__(self, header, arrays):
        self.header, self.arrays, self.sizes = header, arrays, {}

    def array(self, name, shape, *, needed=True, kinds='fiu', least=-math.inf, above=-math.inf, most=math.inf):
        """Check an array; returns it, None where it may be absent and is."""
        if name not in self.arrays:
            if needed:
                raise ModelError(f'lacks the array {name!r}')
            return None
        array = self.arrays[name]
        wanted = shape.split()
        if array.dtype.kind not in kinds:
            raise ModelError(f'{name} has the wrong type {array.dtype}')
        known = [self.sizes.get(word, int(word) if word.isdigit() else None) for word in wanted]
        if array.ndim != len(wanted) or any(size not in (None, own) for size, own in zip(known, array.shape)):
            expected = ', '.join(word if size is None else str(size) for word, size in zip(wanted, known))
            raise ModelError(f'{name} has shape {array.shape}, not ({expected})')
        self.sizes.update(zip(wanted, array.shape))
        # NaN fails every comparison
        if array.size and not (array.min() >= least and array.max() <= most and array.min() > above):
            raise ModelError(f'{name} holds values that cannot be right: they lie between {array.min():g} and '
                             f'{array.max():g}')
        return array

    def number(self, name, *, within=None, least=-math.inf, above=-math.inf):
        """Check a number of the header, or of a part of it."""
        part, where = (self.header, name) if within is None else within
        value = part.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) \
                or not (value >= least and value > above):
            raise ModelError(f'{where} must be a number{" above 0" if above == 0 else ""}, not {value!r:.40}')

    def names(self, name, size=None, *, within=None, different=True):
        """Check a list of names in the header, or in a part of it; ``size`` is a letter."""
        part, where = (self.header, name) if within is None else within
        value = part.get(name)
        if not isinstance(value, list) or not all(isinstance(word, str) and word for word in value):
            raise ModelError(f'{where} must be a list of names')
        if different and len(set(value)) != len(value):
            raise ModelError(f'{where} holds a name twice')
        if size is not None and self.sizes.setdefault(size, len(value)) != len(value):
            raise ModelError(f'{where} are {len(value)}, but there are {self.sizes[size]}')


def check_model(kind, header, arrays):
    """Check the contents of a model file.

    Parameters
    ----------
    kind : str
    header : dict
    arrays : dict of str to ndarray

    Raises
    ------
    ModelError
        Saying what is missing, does not fit or cannot be right.
    """
    contents = _Contents(header, arrays)
    try:
        contents.names('joint_names', 'D')
        for name, array in arrays.items():
            if array.dtype.kind not in 'fiub':
                raise ModelError(f'{name} is not numeric')
        if 'units' in header:
            contents.names('units', 'D', different=False)
            if set(header['units']) - {'rad', 'm'}:
                raise ModelError("units are 'rad' or 'm'")
        if 'rate_hz' in header:
            contents.number('rate_hz', above=0)
        if kind in KINDS:
            KINDS[kind](contents)
        for name, array in arrays.items():
            if array.dtype.kind == 'f' and not np.isfinite(array).all():
                raise ModelError(f'{name} is not finite')
    except (ModelError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f'incomplete or damaged {kind} model: {error}') from None


def _locomotion(one):
    one.names('units', 'D', different=False)
    one.number('rate_hz', above=0)
    for name in ('smoothing', 'coupling'):
        one.number(name, least=0)
    one.names('style_names', 'C')
    one.names('recordings', 'K', different=False)
    one.array('mean', 'C M D')
    one.array('variance', 'C M D', least=0)
    one.array('noise', 'C D', above=0)
    one.array('parent', 'M D')
    one.array('scale', 'D', above=0)
    one.array('weights', 'C', least=0, most=1)
    one.array('jumps', 'C J', above=0, most=1)
    one.array('dwell', 'C M', least=0, most=1)
    one.array('labels', 'K C', least=0, most=1 + 1e-9)
    one.array('bounds', 'I')
    for name in ('pull', 'smooth', 'noise'):
        one.array(f'personal_{name}', 'D', above=0)
    one.array('personal_memory', 'D', least=0, most=0.999)
    for name in ('weights', 'jumps', 'dwell'):
        _sums_to_one(one, name)


def _style_machine(one):
    header = one.header
    one.names('units', 'D', different=False)
    one.names('style_names', 'S')
    one.names('recordings', 'R')
    for name in ('rate_hz', 'leading', 'strength'):
        one.number(name, above=0)
    for name in ('weights', 'variances', 'persistence', 'reference'):
        one.array(name, 'D', least=-math.inf if name == 'reference' else 0)
    if not (one.arrays['weights'] > 0).all():
        raise ModelError('weights must be positive')
    one.array('persistence', 'D', most=0.999)
    basis = one.array('basis', 'D D2')
    if basis.shape[0] != basis.shape[1] or np.abs(basis @ basis.T - np.eye(len(basis))).max() > 1e-6:
        raise ModelError('basis is not orthonormal')
    one.array('start', 'N', least=0)
    trans = one.array('trans', 'N N', least=0)
    if np.abs(trans.sum(axis=1) - 1).max() > 1e-6 or abs(one.arrays['start'].sum() - 1) > 1e-6:
        raise ModelError('start and trans are no probabilities')
    leading = int(header['leading'])
    one.sizes.update({'2q': 2 * leading, 'D-q': one.sizes['D'] - leading})
    one.array('generic_pose', 'D')
    one.array('generic_positions', 'N D')
    one.array('generic_velocities', 'N D')
    one.array('generic_covs', 'N 2q 2q')
    one.array('generic_tails', 'N D-q 2 2')
    one.array('generic_dwell', 'N', above=0)
    for name in ('generic_covs', 'generic_tails'):
        values = one.arrays[name]
        if values.size and np.linalg.eigvalsh(values).min() <= 0:
            raise ModelError(f'{name} holds a matrix that is no covariance')
    one.array('axes', 'V L')
    one.array('spectrum', 'P', least=0, most=1 + 1e-9)
    one.array('styles', 'S V')
    for k, name in enumerate(header['recordings']):
        one.array(f'path_{k}', f'T{k}', kinds='iu', least=0, most=one.sizes['N'] - 1)
        if header['recording_styles'][name] not in header['style_names']:
            raise ModelError(f'recording {name!r} has a style that is not there')
    if set(header['recording_styles']) != set(header['recordings']) \
            or set(header['likelihoods']) != set(header['recordings']):
        raise ModelError('recordings, their styles and likelihoods do not fit together')


def _effort(one):
    header = one.header
    one.names('fragment_names', 'N')
    one.number('rate_hz', above=0)
    one.number('threshold', least=0)
    one.array('lengths', 'N', kinds='iu', least=1, most=_MOST)
    one.sizes['T'] = int(one.arrays['lengths'].sum())
    one.array('joints', 'T D')
    one.array('root', 'T 7', needed=False)
    one.array('starts', 'N 3')
    one.array('scale', 'D', least=0)
    one.array('distances', 'N N', least=0)
    one.array('groups', 'N', kinds='iu', least=0, most=one.sizes['N'] - 1)
    one.array('efforts', 'N 3')
    one.array('scale_means', 'G 3')
    one.array('scale_deviations', 'G 3', above=0)
    one.sizes['40D'] = 40 * one.sizes['D']
    one.array('content_mean', '40D')
    one.array('content_basis', 'B 40D')
    if one.arrays['groups'].max() >= one.sizes['G']:
        raise ModelError('a fragment has a content group that is not there')
    one.array('blend_pairs', 'Q 2', kinds='iu', least=0, most=one.sizes['N'] - 1)
    one.array('blend_alphas', 'Q', least=-1, most=2)
    one.array('blend_efforts', 'Q 3')
    settings = header.get('settings')
    if not isinstance(header.get('method'), str) or not isinstance(settings, list) or len(settings) not in (0, 3):
        raise ModelError('the regression is not described')


def _phase_style(one):
    behaviours = one.header['behaviours']
    if not isinstance(behaviours, list) or not behaviours:
        raise ModelError('it has no behaviours')
    for index, entry in enumerate(behaviours):
        where = f'behaviour {index}'
        one.names('sequences', within=(entry, f'the sequences of {where}'), different=False)
        one.names('groups', within=(entry, f'the groups of {where}'), different=False)
        if not isinstance(entry.get('name'), str) or not isinstance(entry.get('rhythmic'), bool):
            raise ModelError(f'{where} has no name, or does not say whether it repeats')
        one.sizes[f'S{index}'] = len(entry['sequences'])
        if len(entry['groups']) != len(entry['sequences']):
            raise ModelError(f'{where} has {len(entry["sequences"])} sequences of {len(entry["groups"])} groups')
        one.number('rate_hz', within=(entry, f'the rate of {where}'), above=0)
        one.number('acceleration', within=(entry, f'the acceleration of {where}'), above=0)
        for name in entry:
            if name.startswith('residual.'):
                one.number(name, within=(entry, f'{name} of {where}'), least=0)
        for name, shape, limits in _BEHAVIOUR:
            own = ' '.join(word if word in 'D234' else f'{word}{index}' for word in shape.split())
            one.array(f'{index}.{name}', own, needed=name in _NEEDED, **limits)
        grid = one.arrays[f'{index}.phase_grid']
        if len(grid) < 2 or not (np.diff(grid) > 0).all():
            raise ModelError(f'the phases of {where} do not increase')
        velocity = one.arrays[f'{index}.velocity']
        if not (velocity[1] >= 0 and velocity[2] < velocity[3]):
            raise ModelError(f'the phase velocities of {where} are in no order')
    if 'histories' in one.header:
        _histories(one)


_POSITIVE, _NOT_NEGATIVE = {'above': 0}, {'least': 0}
_BEHAVIOUR = (
    ('styles', 'S J', {}), ('singular_values', 'P', _NOT_NEGATIVE), ('phase_grid', 'C', {}), ('bases', 'J C D', {}),
    ('beta', 'J 3', {}), ('noise', 'D', _POSITIVE), ('velocity', '4', {}), ('speeds', 'S 2', {}), ('gaits', 'S', {}),
    ('residual.offset', 'D', _NOT_NEGATIVE), ('residual.fast', 'D', _NOT_NEGATIVE),
    ('residual.personal', 'D', _NOT_NEGATIVE), ('residual.noise', 'D', _POSITIVE),
    ('residual.personal_share', 'H', _NOT_NEGATIVE), ('residual.calibration_horizon', 'Z', _NOT_NEGATIVE),
    ('residual.calibration_scale', 'Z', _POSITIVE))
_NEEDED = ('styles', 'phase_grid', 'bases', 'beta', 'noise', 'velocity')


def _histories(one):
    try:
        about = one.header['histories']
        one.names('names', 'R', within=(about, 'the recordings'), different=False)
        one.number('rate_hz', within=(about, 'their rate'), above=0)
        one.array('histories.lengths', 'R', kinds='iu', least=1, most=_MOST)
        one.sizes['A'] = int(one.arrays['histories.lengths'].sum())
        one.array('histories.positions', 'A D')
        one.array('histories.ends', 'R', kinds='biu')
        horizons = one.array('histories.horizons', 'B', above=0)
        if not (np.diff(horizons) > 0).all():
            raise ModelError('their horizons do not increase')
        one.array('histories.weight', 'W B', least=-1e-9, most=1 + 1e-9)
        one.array('histories.spread', '2 B', above=0)
    except (ModelError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f'incomplete histories: {error}') from None


def _sums_to_one(one, name):
    if np.abs(one.arrays[name].sum(axis=-1) - 1).max() > 1e-6:
        raise ModelError(f'{name} do not sum to one')


#: kind -> function that checks its entries
KINDS = {'phase-style': _phase_style, 'style-machine': _style_machine, 'effort': _effort, 'locomotion': _locomotion}
