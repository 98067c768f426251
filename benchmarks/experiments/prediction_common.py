"""What the tables of the prediction bench share: recordings, methods by name, rollouts, pages."""

import argparse
import hashlib
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from tqdm import tqdm

from style_core import datasets
from style_core.baselines import (
    ConstantVelocity,
    KnownPhase,
    LinearLeastSquares,
    NearestHistories,
    ParticleFilter,
    RadialBasisNetwork,
    ZeroVelocity,
)
from style_core.evaluation import FRAMES_AHEAD, error_deg2, paper_horizons, roll_out
from style_core.report import Report

SEED = 20120
#: Files of style_core.phase_style that a trained model depends on.
LEARNING = (
    'training.py',
    'learning.py',
    'residual.py',
    'bands.pyx',
    'full.py',
    'style_prior.py',
    'channel.py',
    'gaussian_process.py',
    'model.py',
    *(
        f'{name}.{kind}'
        for name in ('parts', 'basis_table', 'arrow_filter', 'arrow_state', 'arrow_forecast', 'rejection', 'memory')
        for kind in ('pxd', 'pyx')
    ),
    'arrow.pxd',
    'arrow.h',
    'arrow_body.h',
    'twice.h',
    'lanes.h',
    'lanes_body.h',
)
#: Files beside that folder, and those that the weights of histories depend on as well.
SHARED = ('alignment.py', 'small_matrices.pxd', 'effort/warping.py', 'effort/_warp.pyx')
CORRECTING = (
    'histories.py',
    'history_search.pyx',
    *(
        f'phase_style/{name}'
        for name in (
            'with_histories.py',
            'full_predictor.py',
            'search.pyx',
            'search_states.py',
            'settings.py',
            'candidates.pyx',
            'hypothesis.pyx',
            'recent_samples.pyx',
            'glance.pyx',
            'glance_body.h',
            'loss.pyx',
            'observation.pyx',
        )
    ),
)
ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / 'docs' / 'results' / 'prediction'
MODELS = ROOT / '.cache' / 'bench_models'

#: Matsubara et al. 2012, footnote 3, as far as the recordings are here (08_05, 08_07 are not).
SEED_TRAINING = ('08_02', '08_03', '08_04', '08_06', '08_08', '35_20', '35_21', '35_22', '02_02', '02_03')
SEED_TESTS = ('08_01', '08_09', '35_23', '02_01', '16_35')
#: Three people joined: walk, run, stride (Figure 2 of the paper).
JOINED = ('02_01', '35_23', '08_09')
LOCOMOTION = ('walk', 'slow_walk', 'run')
SUBJECTS = ('02', '07', '08', '09', '16', '35')
#: Horizons that tables by horizon show, frames at 60 Hz.
SHOWN_FRAMES = (1, 5, 10, 15, 25)
CHANNELS = {50: datasets.BODY, 56: ('!root.*',)}
#: Joints of the limbs in the paper's footnote 4.
LEFT_ARM = ('lradius.*', 'lwrist.*', 'lhand.*')
LEFT_LEG = ('lfemur.*', 'ltibia.*', 'lfoot.*', 'ltoes.*')


@cache
def recording(name, channels=50):
    """A trial at 60 Hz with 50 body or all 56 joint channels."""
    return datasets.trial(name).select(*CHANNELS[channels])


def recordings(names, channels=50):
    """Several trials (see `recording`)."""
    return [recording(name, channels) for name in names]


def paths(names):
    """Files of trials, for the page's data hash."""
    return [datasets.trial_path(name) for name in names]


def others(subject):
    """All locomotion trials of everyone but ``subject``."""
    return tuple(name for person in SUBJECTS if person != subject for name in datasets.trials(LOCOMOTION, person))


def own(subject):
    """All locomotion trials of ``subject``."""
    return tuple(datasets.trials(LOCOMOTION, subject))


def rest_pose(training):
    """Mean pose of the training recordings, rad, shape (D,)."""
    return np.concatenate([motion.positions for motion in training]).mean(axis=0)


# ------------------------------------------------------------------------------------------------- methods


@cache
def behaviour(training, channels=50, dimension=None):
    """The paper's model of the trials ``training`` (a tuple of names)."""
    from style_core.phase_style.training import train

    motions = recordings(training, channels)
    return train(motions, name='locomotion', joints=motions[0].joint_names, dimension=dimension, residual=False)


@cache
def full_model(training, channels=50):
    """Behaviours of the full filter for the trials ``training``."""
    motions = recordings(training, channels)
    return trained(motions, 'locomotion', motions[0].joint_names)


def trained(motions, name, joints, rhythmic=True, dimension=None):
    """Train the full model, or take it from the cache if the same code has seen the same recordings.

    Training by leave-one-out takes a minute or so; most tables need the same models.
    """
    from style_core import phase_style
    from style_core.phase_style.training import train

    settings = (sorted(joints),) if dimension is None else (sorted(joints), dimension)
    path = kept_model('model', motions, name, rhythmic, *settings)
    if not path.is_file():
        model = train(motions, name=name, rhythmic=rhythmic, joints=joints, dimension=dimension)
        phase_style.save_behaviours(path, [model])
    return phase_style.load_behaviours(path)


def kept_model(what, motions, *settings):
    """File of a model under a hash of the code that learns it, the recordings and the settings."""
    from style_core import phase_style

    digest = hashlib.sha256(f'{what} {settings}'.encode())
    package = Path(phase_style.__file__).parent
    for path in [*(package.parent / file for file in SHARED), *(package / file for file in LEARNING)]:
        digest.update(path.read_bytes())
    if what == 'histories':
        for file in CORRECTING:
            digest.update((package.parent / file).read_bytes())
    for motion in motions:
        digest.update(motion.name.encode() + motion.positions.tobytes())
    MODELS.mkdir(parents=True, exist_ok=True)
    return MODELS / f'{digest.hexdigest()[:24]}.npz'


def smoothed(behaviours, motion, observed=None):
    """Off-line smoother over one recording (as one piece), started from the filter's own phase.

    Returns
    -------
    style_core.phase_style.smoother.Smoothed
    """
    from style_core.phase_style import make_predictor
    from style_core.phase_style.smoother import smooth_piece

    first = behaviours[0]
    rollout = roll_out(make_predictor([first], 'full', without=('still',)), motion, [1 / 60], observed=observed)
    y = np.where(rollout.observed, rollout.present, np.nan)
    phase = np.unwrap(rollout.phase) if first.rhythmic else np.maximum.accumulate(rollout.phase)
    # the first half second may be a search: what was found then is followed back at its own speed
    settled = int(np.searchsorted(motion.times, motion.times[0] + 0.5))
    back = np.arange(settled)
    phase[back] = phase[settled] - rollout.phase_velocity[settled] * (motion.times[settled] - motion.times[back])
    velocity = rollout.phase_velocity.copy()
    velocity[back] = velocity[settled]
    return smooth_piece(first, motion.times, y, phase, velocity, iterations=6)


def known_phase(training, test, channels):
    """The ideal: it is told the phase of the off-line smoother over the whole test recording."""
    return KnownPhase(
        behaviour(training, channels, 4), test.times, smoothed(full_model(training, channels), test).phase
    )


def full_predictor(training, channels=50, **options):
    """The full filter."""
    from style_core.phase_style import make_predictor

    return make_predictor(full_model(training, channels), 'full', **options)


@cache
def correction(training, channels=50):
    """Histories of the trials ``training`` and their weights, learned on people left out of the training set.

    Kept on disk like the models (see `trained`).
    """
    return learned_correction(recordings(training, channels), full_model(training, channels))


def learned_correction(motions, behaviours):
    """Histories of recordings and their weights beside the model of one behaviour that was trained on them."""
    from style_core.phase_style import learn_correction, load_parts, save_behaviours
    from style_core.phase_style.training import to_sequence

    path = kept_model('histories', motions, behaviours[0].name, behaviours[0].rhythmic, behaviours[0].joint_names)
    if not path.is_file():
        sequences = [to_sequence(motion, behaviours[0].joint_names) for motion in motions]
        save_behaviours(path, behaviours, correction=learn_correction(behaviours, [sequences]))
    return load_parts(path)[1]


def corrected_predictor(training, channels=50):
    """The full filter with nearest histories, as a model trained with ``--histories`` gives."""
    return full_predictor(training, channels, correction=correction(training, channels))


def paper_predictor(training, channels=50, dimension=4):
    """The paper's method with J styles."""
    from style_core.phase_style import make_predictor

    return make_predictor([behaviour(training, channels, dimension)], 'paper')


#: Every method of the bench: label -> function(training names, test Motion, channels) -> OnlinePredictor.
METHODS = {
    'zero velocity': lambda training, test, channels: ZeroVelocity(
        test.joint_names, rest_pose(recordings(training, channels))
    ),
    'constant velocity': lambda training, test, channels: ConstantVelocity(
        test.joint_names, rest_pose(recordings(training, channels))
    ),
    'recursive least squares': lambda training, test, channels: LinearLeastSquares(
        test.joint_names, rest_pose(recordings(training, channels))
    ),
    'RBF on 3 PCs, 1000 bases': lambda training, test, channels: RadialBasisNetwork([test]),
    '5 nearest histories': lambda training, test, channels: NearestHistories(recordings(training, channels)),
    'particle filter, 10^3': lambda training, test, channels: ParticleFilter(
        behaviour(training, channels, 4), 1000, seed=SEED
    ),
    'particle filter, 10^5': lambda training, test, channels: ParticleFilter(
        behaviour(training, channels, 4), 100000, seed=SEED
    ),
    **{
        f'paper, J = {j}': (lambda training, test, channels, j=j: paper_predictor(training, channels, j))
        for j in (1, 2, 4, 6)
    },
    'known phase, J = 4': lambda training, test, channels: known_phase(training, test, channels),
    'ours': lambda training, test, channels: full_predictor(training, channels),
    'ours + nearest histories': lambda training, test, channels: corrected_predictor(training, channels),
}


def predictor(method, training, test, channels=50):
    """Make the predictor ``method`` trained on the trials ``training`` (names)."""
    return METHODS[method](tuple(training), test, channels)


def run(method, training, test, channels=50, observed=None):
    """Rollout of ``method`` over the Motion ``test`` with the paper's 25 horizons."""
    return roll_out(predictor(method, training, test, channels), test, paper_horizons(FRAMES_AHEAD), observed=observed)


#: Frames by which recordings begin later, to see what hangs on the instant a search begins at.
STARTS = range(8)


def by_start(method, training, names):
    """E of each recording, beginning 0 to 7 frames later, degrees squared, shape (recordings, 8)."""
    errors = []
    for name in names:
        motion = recording(name)
        rollouts = [
            run(method, training, motion.replace(positions=motion.positions[k:], times=motion.times[k:]))
            for k in STARTS
        ]
        errors.append([error_deg2(rollout.mean, rollout.actual) for rollout in rollouts])
    return np.array(errors)


# --------------------------------------------------------------------------------------------------- running


def _single_threaded():
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


def parallel(function, jobs, workers=2, title=None):
    """Map ``function`` over ``jobs`` (tuples) in a few single-threaded processes; results in order.

    Each job is computed by itself, so the results do not depend on ``workers``.
    """
    jobs = list(jobs)
    progress = partial(tqdm, total=len(jobs), desc=title, disable=not sys.stderr.isatty(), file=sys.stderr)
    if workers <= 1:
        _single_threaded()
        return [function(*job) for job in progress(jobs)]
    with ProcessPoolExecutor(workers, get_context('fork'), initializer=_single_threaded) as pool:
        return list(progress(pool.map(function, *zip(*jobs))))


def page(name, title, data):
    """A result page of this bench."""
    table = name.split('_')[0]
    return Report(f'prediction_{name}', title, f'motion-style bench prediction --table {table}', SEED, data)


def parser(description):
    """Arguments that every table has."""
    arguments = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument('-o', '--output', type=Path, default=OUTPUT, help='folder of the result pages')
    arguments.add_argument('--workers', type=int, default=2, help='processes (default 2)')
    return arguments


def shown(values):
    """Values at the horizons that tables show, from values at 1 ... 25 frames."""
    return [float(values[frame - 1]) for frame in SHOWN_FRAMES]


SHOWN_COLUMNS = [f'{frame} fr. ({1000 * frame / 60:.0f} ms)' for frame in SHOWN_FRAMES]
