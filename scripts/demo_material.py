"""What the demo plays and with which model: a real walk of an unseen person, else a synthetic one."""
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from style_core import datasets
from style_core.errors import MotionError
from style_core.formats import skeleton_of, write_motion
from style_core.model_file import read_header
from style_core.motion import Motion
from style_core.phase_style import save_behaviours
from style_core.phase_style.training import train
from style_core.skeleton import Skeleton, read_skeleton
from style_core.synthesis.player import loop_cut
from style_core.synthetic import synthetic_people

__all__ = ['Material', 'material']

ROOT = Path(__file__).resolve().parents[1]
#: models that know walking
SHIPPED = ('everyday.npz', 'locomotion.npz')
#: walks and runs to learn from where no shipped model fits; at most so many a person
ACTIONS, PER_PERSON = ('walk', 'slow_walk', 'run'), 4


@dataclass(frozen=True)
class Material:
    """What to show.

    Attributes
    ----------
    file, model : Path
    motion : Motion
        One lap, as in ``file``.
    skeleton : Skeleton
    laps_join : bool
        Whether laps join with a seam.
    story : str
        What the viewer is told.
    """

    file: Path
    model: Path
    motion: Motion
    skeleton: Skeleton
    laps_join: bool
    story: str


def material(folder, synthetic, trial):
    """Prepare file and model in ``folder``."""
    if not synthetic:
        try:
            return _real(folder, trial)
        except MotionError as error:
            print(f'No recordings to play ({error}).')
    return _synthetic(folder)


def _synthetic(folder):
    motion = synthetic_people(1, seed=2024, duration_s=60.0)[0]
    model = folder / 'synthetic_walk.npz'
    save_behaviours(model, [train(synthetic_people(6), 'walk')])
    skeleton = read_skeleton(ROOT / 'config' / 'skeletons' / 'person.asf')
    return Material(_written(motion, folder), model, motion, skeleton, False,
                    'SYNTHETIC gait: made from formulas, no person. The model learned from six other synthetic people.')


def _real(folder, trial):
    recorded = datasets.trial(trial, rate_hz=120.0).select(*datasets.BODY)
    motion, seam = loop_cut(recorded)
    model, told = _model(folder, trial)
    story = (f'Real walk {trial}, {recorded.duration_s:.1f} s at 120 Hz, looped every {motion.duration_s:.2f} s; at a '
             f'seam the joints jump by {np.degrees(seam):.1f} degrees (RMS), and windows across seams are not scored.\n'
             + told)
    path = datasets.trial_path(trial)
    return Material(_written(motion, folder), model, motion, skeleton_of(path), True, story)


def _written(motion, folder):
    path = folder / 'motion.npz'
    write_motion(motion, path)
    return path


def _model(folder, trial):
    """A shipped model that has not seen the person, else one trained now without that person."""
    person = trial.split('_')[0] + '_'
    for path in (ROOT / 'config' / 'models' / name for name in SHIPPED):
        if not path.exists():
            continue
        header = read_header(path)
        seen = [entry['name'] for entry in header.get('training', ())]
        if not any(name.startswith(person) for name in seen):
            return path, f'Model {path.name} as shipped; none of its {len(seen)} training recordings is of this person.'
    names = []
    for subject in sorted({row.subject for row in datasets.labels()}):
        if subject + '_' != person:
            names += datasets.trials(action=ACTIONS, subject=subject)[:PER_PERSON]
    path = folder / f'model_without_{person[:-1]}_{len(names)}.npz'
    if not path.exists():
        print(f'Learning from {len(names)} recordings of other people ...', flush=True)
        save_behaviours(path, [train([datasets.trial(name) for name in names], 'locomotion')],
                        [datasets.trial_path(name) for name in names])
    return path, f'Model learned from {len(names)} recordings of other people; this person was never seen.'
