"""Learn a locomotion model from unlabelled recordings."""
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np
from sklearn.cluster import KMeans

from style_core.alignment import period
from style_core.errors import MotionError, UsageError
from style_core.locomotion import em
from style_core.locomotion.features import feature_map
from style_core.locomotion.infer import smooth
from style_core.locomotion.model import LocomotionModel, without_empty_styles
from style_core.locomotion.personal import estimate
from style_core.progress import progress as progress_of
from style_core.sizes import demand

__all__ = ['Fit', 'Sizes', 'cycle_sizes', 'fit', 'learn', 'features_of', 'standard']


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of the variational EM on arrays; ``bounds`` (n_iterations,) after each iteration."""

    parameters: em.Parameters
    posterior: em.Posterior
    bounds: np.ndarray


@dataclass(frozen=True)
class Sizes:
    """Period of each recording (frames; NaN where none shows), positions M of a cycle, largest jump J."""

    periods: Tuple[float, ...]
    n_positions: int
    max_jump: int


def cycle_sizes(recordings, rate_hz):
    """Periods of the recordings, and M and J that follow: M = 2 N for the middle period N, J to follow the fastest.

    Parameters
    ----------
    recordings : sequence of ndarray, shape (T_k, F)
        Scaled so that the features count alike; NaN = missing.
    rate_hz : float

    Raises
    ------
    MotionError
        If no recording repeats.
    """
    periods = [_period_frames(x, rate_hz) for x in recordings]
    known = np.array([p for p in periods if np.isfinite(p)])
    if not known.size:
        raise MotionError(
            'no recording repeats: a locomotion model needs at least one with more than one and a quarter cycles'
        )
    # a position is passed at least every frame, so the slowest walk must still fit into one round
    n_positions = max(round(2 * float(np.median(known))), int(np.ceil(1.15 * known.max())))
    return Sizes(tuple(periods), n_positions, max(3, int(np.ceil(1.15 * n_positions / known.min()))))


def _period_frames(x, rate_hz):
    """Period in frames; NaN for a recording that is too short or does not repeat: it follows the others then."""
    try:
        return period(_bridged(x), rate_hz) * rate_hz
    except MotionError:
        return float('nan')


def _bridged(x):
    """Missing entries (NaN) interpolated in time; a feature never seen is zero."""
    frames = np.arange(len(x))
    filled = np.zeros_like(x)
    for f, column in enumerate(x.T):
        there = np.isfinite(column)
        if there.any():
            filled[:, f] = np.interp(frames, frames[there], column[there])
    return filled


def _first_cycle(x, period_frames, n_positions):
    """First cycle of a recording over M positions, its end drawn to its start."""
    where = np.arange(n_positions + 1) / n_positions * period_frames
    cycle = np.stack([np.interp(where, np.arange(len(x)), column) for column in _bridged(x).T], axis=1)
    return cycle[:-1] - np.linspace(0, 1, n_positions + 1)[:-1, None] * (cycle[-1] - cycle[0])


def _still(mean):
    """Cycle moments at the start: the mean given, unit variance (the same everywhere, so without effect on paths)."""
    return em.CycleMoments(mean, np.ones_like(mean), np.zeros_like(mean), np.zeros(mean.shape[::2]))


def _separate(data, single, parameters, n_styles, rng):
    """Labels to start from: K-means over the recordings' departures from the one latent cycle they were aligned to."""
    paths = single.paths
    inertia = 5.0     # frames of the common cycle mixed into a position a recording hardly visits
    departure = (paths.total - paths.count * single.cycles.mean) / (paths.count + inertia)
    departure = (departure * np.sqrt(parameters.precision)).reshape(len(departure), -1)
    groups = min(n_styles, len(np.unique(departure, axis=0)))
    found = KMeans(groups, n_init=1, random_state=int(rng.integers(2**31))).fit_predict(departure)
    return 0.9 * np.eye(n_styles)[found] + 0.1 / n_styles


def fit(recordings, sizes, n_styles, seed, *, precision_max, coupling=0.01, smoothing=300.0, learn_coupling=False,
        n_iterations=15, n_inner=3, start='cycles', threads=1, on_iteration=None):
    """Run the variational EM once.

    Parameters
    ----------
    recordings : sequence of ndarray, shape (T_k, F)
        Centred and scaled to about unit variance; NaN = missing.
    sizes : Sizes
    n_styles : int
    seed : int
    precision_max : ndarray, shape (F,)
        Noise floor, as `em.Settings` has it.
    coupling, smoothing : float
        Values to start from (coupling is kept unless ``learn_coupling``).
    n_iterations, n_inner : int
        EM iterations, and rounds of the three updates in each E-step.
    start : {'cycles', 'noise'}
        How styles first differ: by K-means over the recordings' cycles after three iterations with a single latent
        cycle, or by small random differences of the labels alone, as Pan and Torresani have it.
    threads : int
    on_iteration : callable, optional
        Called with the bound after each iteration.

    Returns
    -------
    Fit
    """
    rng = np.random.default_rng(seed)
    data = em.prepare(recordings)
    n_features, n_recordings = recordings[0].shape[1], len(recordings)
    settings = em.Settings(n_styles, sizes.n_positions, sizes.max_jump, precision_max, learn_coupling=learn_coupling)
    able = [k for k, period in enumerate(sizes.periods) if np.isfinite(period)]
    first = able[rng.integers(len(able))]
    parent = _first_cycle(recordings[first], sizes.periods[first], sizes.n_positions)
    uniform = np.full((n_recordings, sizes.max_jump), 1.0 / sizes.max_jump)

    def begin(count, mean, precision, labels, jumps):
        parameters = em.Parameters(parent, coupling, smoothing, np.repeat(precision, count, axis=0),
                                   np.full(count, 1.0 / count), jumps)
        return parameters, em.Posterior(labels, _still(np.repeat(mean, count, axis=0)))

    if start == 'noise':
        parameters, posterior = begin(n_styles, parent[None], np.ones((1, n_features)),
                                      rng.dirichlet(np.full(n_styles, 10.0), n_recordings), uniform)
    elif start == 'cycles':
        one = replace(settings, n_styles=1)
        parameters, posterior = begin(1, parent[None], np.ones((1, n_features)), np.ones((n_recordings, 1)), uniform)
        for _ in range(3):
            posterior = em.update_cycles(parameters, em.update_paths(data, parameters, posterior, threads))
            parameters = em.update_parameters(data, parameters, posterior, one)
        labels = _separate(data, posterior, parameters, n_styles, rng)
        single = posterior
        parameters, posterior = begin(n_styles, single.cycles.mean, parameters.precision, labels, parameters.jumps)
        posterior = em.update_cycles(parameters, replace(posterior, paths=single.paths))
    else:
        raise UsageError(f"start must be 'cycles' or 'noise', not {start!r}")
    bounds = []
    for _ in range(n_iterations):
        for _ in range(n_inner):
            posterior = em.update_paths(data, parameters, posterior, threads)
            posterior = em.update_cycles(parameters, posterior)
            posterior = em.update_labels(data, parameters, posterior)
        parameters = em.update_parameters(data, parameters, posterior, settings)
        bounds.append(em.bound(data, parameters, posterior, settings))
        if on_iteration is not None:
            on_iteration(bounds[-1])
    return Fit(parameters, posterior, np.array(bounds))


def learn(motions, n_styles, *, seed=0, restarts=5, rate_hz=None, progress=False, threads=1, **options):
    """Learn styles from unlabelled recordings (Pan and Torresani 2009).

    Parameters
    ----------
    motions : sequence of Motion
        The same joints in each (the order of the first is kept); NaN = missing, marginalised exactly.
    n_styles : int
    seed : int
    restarts : int
        Runs from different starts; the highest bound is kept.
    rate_hz : float, optional
        All recordings are brought to this rate; default: the lowest of their own.
    progress : bool
        Show a bar on a terminal.
    threads : int
    **options
        Of `fit`.

    Returns
    -------
    LocomotionModel
        With fewer styles than asked for where some found no recording.

    Warns
    -----
    UserWarning
        With the number of styles left out.

    Raises
    ------
    MotionError
        If there is no recording, joints differ, a joint is never seen, or nothing repeats.
    UsageError
        If a number makes no sense.
    """
    motions = list(motions)
    if not motions:
        raise MotionError('no recordings to learn from')
    if n_styles < 1 or restarts < 1:
        raise UsageError(f'{n_styles} styles and {restarts} restarts: both must be at least 1')
    features, recordings, rate_hz = features_of(motions, rate_hz)
    centre, scale = standard(recordings, features)
    scaled = [(x - centre) / scale for x in recordings]
    sizes = cycle_sizes(scaled, rate_hz)
    demand(3 * max(map(len, scaled)) * sizes.n_positions * threads,
           f'learning cycles of {sizes.n_positions} positions from {max(map(len, scaled))} frames at {rate_hz:g} Hz',
           'a lower rate, or shorter recordings')
    n_iterations = options.get('n_iterations', 15)
    with progress_of(desc='learning', total=restarts * n_iterations, shown=progress) as bar:
        fits = [fit(scaled, sizes, n_styles, [seed, r], precision_max=(scale / features.floors)**2, threads=threads,
                    on_iteration=lambda value: bar.update(), **options) for r in range(restarts)]
    best = max(fits, key=lambda one: one.bounds[-1])
    model = _as_model(best, motions, features, rate_hz, centre, scale)
    return replace(model, personal=_departures(model, recordings))


def _departures(model, recordings):
    """How the training recordings depart from their styles' cycles (each from its most probable one)."""
    parts = []
    for x, labels in zip(recordings, model.labels):
        own = int(labels.argmax())
        parts.append((x, model.mean[own], smooth(model, x).occupancy[own]))
    return estimate(parts)


def features_of(motions, rate_hz=None):
    """Feature map, features of every recording at one rate, and that rate."""
    for motion in motions:
        if motion.n_frames < 2:
            raise MotionError(f'motion {motion.name!r} has a single frame')
        if not np.isfinite(motion.positions).any():
            raise MotionError(f'motion {motion.name!r} holds no value')
        differing = set(motion.joint_names) ^ set(motions[0].joint_names)
        if differing:
            raise MotionError(f'motion {motion.name!r} and {motions[0].name!r} differ in joints '
                              f'{", ".join(sorted(differing)[:5])}')
    features = feature_map(motions[0], motions[1:])
    if rate_hz is None:
        rate_hz = min(motion.rate_hz for motion in motions)
    return features, [features.encode(motion.resample(rate_hz)) for motion in motions], rate_hz


def standard(recordings, features):
    """Mean and spread of each feature over all recordings; a constant one gets its noise floor as spread."""
    every = np.concatenate(recordings)
    there = np.isfinite(every)
    if not there.any(axis=0).all():
        unseen = [name for name, seen in zip(features.joint_names, there.any(axis=0)) if not seen]
        raise MotionError(f'no recording ever shows {", ".join(unseen[:5])}: leave such joints out')
    return np.nanmean(every, axis=0), np.maximum(np.nanstd(every, axis=0), features.floors)


def _as_model(result, motions, features, rate_hz, centre, scale):
    """Undo centring and scaling; sort styles by how many recordings they hold, and drop those that hold none."""
    parameters, posterior = result.parameters, result.posterior
    order = np.argsort(-posterior.labels.sum(axis=0), kind='stable')
    labels = posterior.labels[:, order]
    taken = labels.sum(axis=0)
    pooled = parameters.jumps.mean(axis=0)
    # a tenth of a recording of the common advance keeps a style without recordings valid
    jumps = (labels.T @ parameters.jumps + 0.1 * pooled) / (taken + 0.1)[:, None]
    visits = posterior.paths.visits
    visits = labels.T @ visits + 0.1 * visits.mean(axis=0)
    return without_empty_styles(LocomotionModel(
        features,
        float(rate_hz),
        posterior.cycles.mean[order] * scale + centre,
        posterior.cycles.variance[order] * scale**2,
        scale**2 / parameters.precision[order],
        parameters.parent * scale + centre,
        scale,
        parameters.smoothing,
        parameters.coupling,
        parameters.weights[order],
        jumps,
        visits / visits.sum(axis=1, keepdims=True),
        None,
        tuple(f'style{c}' for c in range(len(order))),
        tuple(motion.name or f'recording {k}' for k, motion in enumerate(motions)),
        labels,
        result.bounds,
    ))
