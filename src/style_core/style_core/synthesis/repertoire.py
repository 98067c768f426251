"""What can be performed: a model file of any kind that synthesises, or a recording, and the sources made of it."""
from dataclasses import dataclass
from pathlib import Path
from typing import Mapping, Optional, Tuple

import numpy as np

from style_core import phase_style, style_machine
from style_core.errors import ModelError, UsageError
from style_core.joint_space import space_of
from style_core.model_file import read_header
from style_core.recordings import read_recording
from style_core.skeleton import read_skeleton
from style_core.synthesis.sources.phase_style import CycleSource, FollowSource
from style_core.synthesis.sources.recording import MotionFileSource
from style_core.synthesis.sources.style_machine import MachineSource, frames_of_occupancy, frames_of_states
from style_core.text import did_you_mean

__all__ = ['MODES', 'FollowSettings', 'Repertoire', 'Score', 'load_repertoire', 'list_models']

_EFFORT = 'effort'      # its package comes with a library that takes seconds to load: imported where there is one
#: how a source may be chosen -> the kind of model it needs
MODES = {'cycle': phase_style.KIND, 'follow': phase_style.KIND, 'sequence': style_machine.KIND,
         'random_walk': style_machine.KIND, 'effort': _EFFORT, 'file': None}
_WITH_RECORDING = ('effort', 'file')
_KINDS = (phase_style.KIND, style_machine.KIND, _EFFORT)


@dataclass(frozen=True)
class FollowSettings:
    """See `style_core.synthesis.sources.phase_style.FollowSource`."""

    stiffness: float = 6.0
    patience: float = 0.1
    coast: float = 0.5
    stop: float = 1.0


@dataclass(frozen=True, eq=False)
class Score:
    """What a style machine is to perform: states with dwell times (s), or occupancies ``step`` seconds apart."""

    states: Tuple[int, ...] = ()
    dwell_times: Tuple[float, ...] = ()
    occupancy: Optional[np.ndarray] = None
    step: float = 0.0

    def frames(self, machine):
        """Content of every frame; raises UsageError where it does not fit the machine."""
        if self.occupancy is not None and len(self.states):
            raise UsageError('give either states with dwell times or occupancies, not both')
        if self.occupancy is not None:
            return frames_of_occupancy(self.occupancy, self.step, machine)
        return frames_of_states(self.states, self.dwell_times, machine)


@dataclass(frozen=True, eq=False)
class Repertoire:
    """A loaded model, and perhaps a recording.

    Attributes
    ----------
    name, kind : str
        Empty where there is a recording only.
    joint_names : tuple of str
    behaviours : mapping of str to Behaviour
        Of a phase-style model.
    machine : StyleMachine or None
    recording : Motion or None
    library : EffortLibrary or None
    space : JointSpace or None
        In which behaviours were learned.
    """

    name: str
    kind: str
    joint_names: Tuple[str, ...]
    behaviours: Mapping[str, object]
    machine: Optional[object] = None
    recording: Optional[object] = None
    library: Optional[object] = None
    space: Optional[object] = None

    @property
    def modes(self):
        """Modes it can serve."""
        return tuple(mode for mode, kind in MODES.items()
                     if kind in (None, self.kind) and (self.recording is not None or mode not in _WITH_RECORDING))

    def source(self, mode, *, behaviour='', speed=1.0, seed=0, score=None, lag=20, loop=True, phase=0.0,
               follow=None):
        """A new source.

        Parameters
        ----------
        mode : str
            Of `MODES`.
        behaviour : str
            Of a phase-style model; its first where empty (its first rhythmic one for ``follow``).
        speed : float
        seed : int
            Of a random walk.
        score : Score
            For ``sequence``.
        lag : int
            See `MachineSource`.
        loop : bool
            For ``file`` and ``effort``.
        phase : float
            Where a cycle starts.
        follow : FollowSettings, optional

        Raises
        ------
        UsageError, ModelError
            Where that cannot be performed with this model.
        """
        if mode not in MODES:
            raise UsageError(f'the mode must be one of {", ".join(MODES)}, not {mode!r}')
        if mode not in self.modes:
            needed = [f'a model of kind {MODES[mode]}'] if MODES[mode] else []
            needed = ' and '.join(needed + ['a motion file'] * (mode in _WITH_RECORDING))
            raise UsageError(f'mode {mode} needs {needed}'
                             + (f'; {self.name} is a {self.kind} model' if self.kind else ''))
        if mode == 'file':
            return MotionFileSource(self.recording, loop, speed)
        if mode == 'effort':
            from style_core.synthesis.sources.effort import RestyledSource
            return RestyledSource(self.library, self.recording, loop, speed)
        if mode == 'random_walk':
            return MachineSource(self.machine, visits=style_machine.random_walk(self.machine, seed=seed), speed=speed,
                                 lag=lag)
        if mode == 'sequence':
            return MachineSource(self.machine, frames=(score or Score()).frames(self.machine), speed=speed, lag=lag)
        chosen = self._behaviour(behaviour, rhythmic=mode == 'follow')
        if mode == 'cycle':
            return CycleSource(chosen, speed=speed, phase=phase, space=self.space)
        settings = follow or FollowSettings()
        return FollowSource(chosen, None, settings.stiffness, settings.patience, settings.coast, settings.stop,
                            self.space)

    def _behaviour(self, name, rhythmic):
        if name:
            if name not in self.behaviours:
                raise UsageError(f'{self.name} has no behaviour {name!r}; it has {", ".join(self.behaviours)}'
                                 + did_you_mean(name, self.behaviours))
            return self.behaviours[name]
        fitting = [one for one in self.behaviours.values() if one.rhythmic or not rhythmic]
        if not fitting:
            raise UsageError(f'{self.name} has no rhythmic behaviour to follow with')
        return fitting[0]


def load_repertoire(model='', file='', skeleton='', rate_hz=0.0):
    """Load a model file, a recording, or both.

    Raises
    ------
    ModelError, MotionError, UsageError
        Where a file does not fit, or neither is given.
    """
    if not model and not file:
        raise UsageError('give a model file, a motion file, or both')
    recording = None
    if file:
        recording = read_recording(file, read_skeleton(skeleton) if skeleton else None)
        if rate_hz:
            recording = recording.resample(rate_hz)
        if not model:
            return Repertoire('', '', recording.joint_names, {}, None, recording)
    kind, name = read_header(model)['kind'], Path(model).stem
    if kind == phase_style.KIND:
        behaviours, space = phase_style.load_behaviours(model), space_of(model)
        return Repertoire(name, kind, behaviours[0].joint_names, {one.name: one for one in behaviours}, None, recording,
                          space=space)
    if kind == style_machine.KIND:
        machine = style_machine.load(model)
        return Repertoire(name, kind, tuple(machine.joint_names), {}, machine, recording)
    if kind == _EFFORT:
        if recording is None:
            raise UsageError(f'{model} is a library for restyling: give a motion file too')
        from style_core import effort
        library = effort.load(model)
        return Repertoire(name, kind, library.space.joint_names, {}, None, recording, library)
    raise ModelError(f'{model} holds a {kind} model; the synthesizer performs {", ".join(_KINDS)} models')


def list_models(folder):
    """Model files of a folder that can be performed, as (file name, kind)."""
    found = []
    for path in sorted(Path(folder).glob('*.npz')):
        try:
            kind = read_header(path)['kind']
        except ModelError:
            continue
        if kind in _KINDS:
            found.append((path.name, kind))
    return found
