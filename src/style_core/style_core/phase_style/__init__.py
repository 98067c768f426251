"""Phase and style: learning the model of Matsubara et al. (2012), predicting with it and with the full filter."""
from style_core.errors import UsageError
from style_core.phase_style.full_predictor import FullPredictor
from style_core.phase_style.learning import Sequence, group_of, learn
from style_core.phase_style.matsubara_predictor import FORGETTING, PaperPredictor
from style_core.phase_style.model import (
    KIND,
    Behaviour,
    Correction,
    Residual,
    load_behaviours,
    load_parts,
    save_behaviours,
)
from style_core.phase_style.with_histories import CorrectedPredictor, learn_correction

__all__ = ['FORGETTING', 'KIND', 'METHODS', 'Behaviour', 'Correction', 'CorrectedPredictor', 'FullPredictor',
           'PaperPredictor', 'Residual', 'Sequence', 'behaviour_named', 'group_of', 'learn', 'learn_correction',
           'load_behaviours', 'load_parts', 'load_predictor', 'make_predictor', 'save_behaviours']

METHODS = ('full', 'paper')


def behaviour_named(behaviours, name=''):
    """The behaviour of that name, the first where it is empty; UsageError where there is none."""
    for one in behaviours:
        if name in ('', one.name):
            return one
    raise UsageError(f'no behaviour {name!r} in this model; there are {", ".join(one.name for one in behaviours)}')


def make_predictor(behaviours, method='full', correction=None, behaviour='', **options):
    """Make an on-line predictor.

    Parameters
    ----------
    behaviours : list of Behaviour
    method : {'full', 'paper'}
        The full filter over all behaviours, or the published method with one of them.
    correction : Correction, optional
        Recorded motion, for the full filter; left out with ``without=['histories']``.
    behaviour : str
        Which one the published method follows; the first where empty.
    **options
        Settings of the method (see `FullPredictor` and `PaperPredictor`).

    Returns
    -------
    OnlinePredictor
    """
    if method not in METHODS:
        raise UsageError(f'method must be one of {", ".join(METHODS)}, got {method!r}')
    if method == 'full':
        if behaviour:
            raise UsageError("a behaviour is chosen for the published method ('paper'); the full filter follows all")
        without = set(options.pop('without', ()))
        first = FullPredictor(behaviours, without=without - {'histories'}, **options)
        return first if correction is None or 'histories' in without else CorrectedPredictor(first, correction)
    return PaperPredictor(behaviour_named(behaviours, behaviour), **options)


def load_predictor(path, method='full', **options):
    """Read a model file and make an on-line predictor of it (see `make_predictor`).

    Raises
    ------
    ModelError
        If the file is not a readable phase-style model.
    """
    behaviours, correction = load_parts(path)
    return make_predictor(behaviours, method, correction, **options)
