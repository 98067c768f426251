"""On-line predictors from model files of every kind that holds one."""
from dataclasses import dataclass, replace
from typing import Mapping, Optional

from style_core import phase_style
from style_core.errors import ModelError, UsageError
from style_core.joint_space import space_of
from style_core.joint_space.online import SpacedPredictor
from style_core.model_file import read_header
from style_core.phase_style.full import PARTS
from style_core.predictor import OnlinePredictor
from style_core.unknown import OpenPredictor

__all__ = ['FilePredictor', 'read_predictor', 'KINDS']

#: What can be left out around a model's own predictor.
_AROUND = ('histories', 'unknown')


@dataclass(frozen=True, eq=False)
class FilePredictor:
    """A predictor and what its model file says of it.

    Attributes
    ----------
    kind : str
        Of the model.
    predictor : OnlinePredictor
    rhythmic : mapping of str to bool
        Of every behaviour or style: does it repeat, or go from a start to a goal.
    rate_hz : float
        Of the training recordings.
    published : PaperPredictor, optional
        The published method where the predictor is that, for what may be set while it runs.
    """

    kind: str
    predictor: OnlinePredictor
    rhythmic: Mapping[str, bool]
    rate_hz: float
    published: Optional[phase_style.PaperPredictor] = None


def read_predictor(path, method=phase_style.METHODS[0], without=(), **published):
    """Read a model file and make its on-line predictor.

    Parameters
    ----------
    path : path-like
        A phase-style, locomotion or style-machine model.
    method : {'full', 'paper'}
        Of a phase-style model (`style_core.phase_style.make_predictor`); the others have one method, 'full'.
    without : collection of str
        Parts of the full filter to leave out (`style_core.phase_style.full.PARTS`), ``'histories'``, the recorded
        motion that a phase-style model may hold, or ``'unknown'``: no short-range dynamics beside the model
        (`style_core.unknown`). The published method is always alone.
    **published
        Of the published method only: ``behaviour``, by its name, and the settings of
        `style_core.phase_style.PaperPredictor`; what is None counts as not given.

    Returns
    -------
    FilePredictor

    Raises
    ------
    ModelError
        If the file is not a readable model, or of a kind that cannot predict.
    UsageError
        If the kind has no such method, or the method no such setting.
    """
    published = {name: value for name, value in published.items() if value is not None}
    kind = read_header(path)['kind']
    if kind not in _READERS:
        raise ModelError(f'{path} holds a {kind} model, which cannot predict; {", ".join(_READERS)} can')
    if kind != phase_style.KIND and method != phase_style.METHODS[0]:
        raise UsageError(f'method {method!r} is for phase-style models; {path} holds a {kind} model')
    if published and method == phase_style.METHODS[0]:
        raise UsageError(f"{', '.join(sorted(published))}: of the published method (method 'paper') only")
    strange = set(without) - {*PARTS, *_AROUND}
    if strange:
        raise UsageError(f'{", ".join(sorted(strange))}: no part to leave out; '
                         f'there are {", ".join((*PARTS, *_AROUND))}')
    if set(without) - set(_AROUND) and (kind != phase_style.KIND or method != phase_style.METHODS[0]):
        raise UsageError('parts can be left out of the full filter of a phase-style model only')
    found = _published(path, published) if method != phase_style.METHODS[0] \
        else _READERS[kind](path, set(without) - {'unknown'})
    if method == phase_style.METHODS[0] and 'unknown' not in without:
        found = replace(found, predictor=OpenPredictor(found.predictor, next(iter(found.rhythmic))))
    # dynamics of the coordinates, too, know no wraps; the predictors of other kinds take and give angles themselves
    space = space_of(path) if kind == phase_style.KIND else None
    return found if space is None else replace(found, predictor=SpacedPredictor(found.predictor, space))


def _phase_style(path, without):
    behaviours, correction = phase_style.load_parts(path)
    return FilePredictor(phase_style.KIND, phase_style.make_predictor(behaviours, 'full', correction, without=without),
                         {one.name: one.rhythmic for one in behaviours}, behaviours[0].rate_hz)


def _published(path, options):
    behaviours = phase_style.load_behaviours(path)
    one = phase_style.behaviour_named(behaviours, options.get('behaviour', ''))
    predictor = phase_style.make_predictor(behaviours, 'paper', **options)
    return FilePredictor(phase_style.KIND, predictor, {one.name: one.rhythmic}, one.rate_hz, predictor)


def _locomotion(path, without):
    from style_core.locomotion import KIND, LocomotionPredictor, load
    model = load(path)
    return FilePredictor(KIND, LocomotionPredictor(model), dict.fromkeys(model.style_names, True), model.rate_hz)


def _style_machine(path, without):
    from style_core.style_machine import KIND, load
    from style_core.style_machine.online import StyleMachinePredictor
    machine = load(path)
    return FilePredictor(KIND, StyleMachinePredictor(machine), dict.fromkeys(machine.styles, True), machine.rate_hz)


#: imported when asked for: learning, which comes with them, needs libraries that take seconds to load
_READERS = {phase_style.KIND: _phase_style, 'locomotion': _locomotion, 'style-machine': _style_machine}
KINDS = tuple(_READERS)
