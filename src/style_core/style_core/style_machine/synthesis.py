"""Motion from content and style, all at once (Brand and Hertzmann 2000, 4.5)."""
import numpy as np

from style_core.errors import ModelError
from style_core.motion import Motion
from style_core.sizes import demand
from style_core.style_machine.choreography import scale_dwell, visits_to_path
from style_core.style_machine.trajectory import information, trajectory

__all__ = ['synthesize', 'synthesize_visits', 'take']


def synthesize(machine, content, style='generic', dwell=None, name=''):
    """Most likely motion for a content in a style.

    Parameters
    ----------
    machine : StyleMachine
    content : ndarray
        State of each frame, shape (T,), or occupancies, shape (T, N).
    style : str or ndarray, shape (K,)
        Expression or coordinates.
    dwell : ndarray, shape (N,), optional
        Dwell times of the content's own style (``Analysis.emission.dwell``): the content is then stretched to those
        of the new style. Without it every frame stays a frame.
    name : str, optional

    Returns
    -------
    Motion
        At the machine's rate, from time 0.
    """
    emission = machine.at(style)
    content = np.asarray(content)
    if content.ndim == 2 and content.shape[1] != machine.n_states:
        raise ModelError(f'occupancies have {content.shape[1]} states, the model {machine.n_states}')
    if not len(content):
        raise ModelError('no frames to synthesise')
    if dwell is not None:
        content = scale_dwell(content, dwell, emission.dwell)
    positions = machine.coordinates.decode(trajectory(information(emission), content))
    return machine.decoded(Motion(machine.joint_names, positions, np.arange(len(content)) / machine.rate_hz,
                                  machine.coordinates.units, name or 'synthesised'))


def synthesize_visits(machine, visits, style='generic', name=''):
    """Most likely motion for visits (state, stay in units of the style's dwell time); see `choreography.sequence`."""
    dwell = machine.at(style).dwell
    frames, size = sum(stay * dwell[state] for state, stay in visits), len(machine.joint_names)
    demand(frames * (4 * size + 3 * machine.coordinates.leading**2), f'a motion of {frames:.3g} frames',
           'a shorter sequence, or a style less far out')
    path = visits_to_path([(state, stay * dwell[state]) for state, stay in visits])
    return synthesize(machine, path, style, name=name)


def take(visits, machine, style, duration_s):
    """As many visits of an endless source as fill a duration in a style."""
    dwell = machine.at(style).dwell
    taken, frames = [], 0.0
    for state, stay in visits:
        taken.append((state, stay))
        frames += stay * dwell[state]
        if frames >= duration_s * machine.rate_hz:
            break
    return taken
