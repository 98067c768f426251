"""What a learned locomotion model says about a recording: style, positions, cycles, missing values (off line)."""
from dataclasses import dataclass, replace
from typing import Optional

import numpy as np

from style_core.alignment import refine_phase
from style_core.errors import MotionError
from style_core.locomotion import kernels
from style_core.locomotion.em import ring_eigenvalues
from style_core.locomotion.personal import bridge, departure, residual_sums
from style_core.locomotion.synthesis import prototypes
from style_core.sizes import demand

__all__ = ['Emission', 'Smoothing', 'Analysis', 'emission_of', 'smooth', 'analyze', 'aligned_cycles', 'fill']

#: frames of the style's own advance that a recording's own advance must outweigh
_JUMP_STRENGTH = 5.0
#: density of the acceleration that a refined phase may have, rad^2/s^3: speed may change by half within a second
_ACCELERATION = 10.0


@dataclass(frozen=True, eq=False)
class Emission:
    """Gaussian density of a frame at every position of every style, ready for products.

    A frame differs from a latent cycle by noise, the cycle itself is known up to its posterior variance; both add up.
    ``inverse``, ``linear`` (C, M, F) and ``constant`` (C, M, F) give
    ``log p = -1/2 (x^2 . inverse - 2 x . linear + seen . constant)`` for ``x`` counted from ``centre`` (F,).
    """

    centre: np.ndarray
    inverse: np.ndarray
    linear: np.ndarray
    constant: np.ndarray

    def log_density(self, x, style):
        """Log density of frames (T, F), NaN = missing, at the positions of one style: (T, M), nats."""
        seen = np.isfinite(x)
        y = np.where(seen, x - self.centre, 0.0)
        out = y @ (2 * self.linear[style]).T
        out -= (y * y) @ self.inverse[style].T
        out -= self.constant[style].sum(axis=1) if seen.all() else seen.astype(float) @ self.constant[style].T
        return 0.5 * out


def emission_of(model):
    """`Emission` of a model."""
    centre = model.mean.mean(axis=(0, 1))
    variance = model.noise[:, None, :] + model.variance
    gap = model.mean - centre
    return Emission(centre, 1 / variance, gap / variance, gap**2 / variance + np.log(2 * np.pi * variance))


@dataclass(frozen=True, eq=False)
class Smoothing:
    """Posterior of style and position.

    Attributes
    ----------
    styles : ndarray, shape (C,)
        Probability that the whole recording has each style.
    occupancy : ndarray, shape (C, T, M)
        Probability of each position given the style; each row sums to one.
    jumps : ndarray, shape (C, J)
        The recording's own advance, given the style.
    log_likelihood : float
        Of the recording, nats.
    """

    styles: np.ndarray
    occupancy: np.ndarray
    jumps: np.ndarray
    log_likelihood: float


def smooth(model, x, n_rounds=3, emission=None):
    """Exact posterior over style and position of a recording of any pattern of missing values.

    Parameters
    ----------
    model : LocomotionModel
    x : ndarray, shape (T, F)
        Features at the model's rate; NaN = missing.
    n_rounds : int
        Times the recording's own advance is estimated (EM) from the style's; 0 keeps the style's, which makes the log
        likelihood that of a recording never seen.
    emission : Emission, optional
        Of the model, where it is at hand.

    Returns
    -------
    Smoothing
    """
    emission = emission or emission_of(model)
    n_styles, n_positions, _ = model.mean.shape
    demand((n_styles + 2) * len(x) * n_positions, f'{n_styles} styles of {n_positions} positions over {len(x)} frames',
           'a shorter piece of the recording')
    occupancy = np.empty((n_styles, len(x), n_positions))
    jumps = model.jumps.copy()
    total_of = np.empty(n_styles)
    counts = np.empty(jumps.shape[1])
    for c in range(n_styles):
        scores = emission.log_density(x, c)
        total_of[c], _ = kernels.forward_backward(scores, np.log(jumps[c]), occupancy[c], counts)
        for _ in range(n_rounds if len(x) > 1 else 0):
            own = counts + _JUMP_STRENGTH * model.jumps[c]
            jumps[c] = own / own.sum()
            total_of[c], _ = kernels.forward_backward(scores, np.log(jumps[c]), occupancy[c], counts)
    score = np.log(model.weights) + total_of
    total = np.logaddexp.reduce(score)
    # while it is learned how people depart from styles, frames count as if they were independent
    styles = np.exp(score - total) if model.personal is None else style_probabilities(model, x, occupancy)
    return Smoothing(styles, occupancy, jumps, float(total))


def style_probabilities(model, x, occupancy):
    """Probability of each style, knowing that everyone departs from it in a way of their own.

    A person's departure from a style is one draw, the same in every frame; taken for fresh noise frame by frame, it
    makes the nearest of several styles certain for anybody, however far off it is. So its size counts as unknown:
    with q_c the mean square of the residuals about style c, in units of the noise, and n the independent values that a
    departure holds, ``P(c) ~ weights_c q_c^(-n / 2)``. That is n = (features) (positions), each counted as so many
    independent ones as would vary alike: ``F^2 / sum C_ij^2`` for the correlations C of the residuals, and
    ``(sum l)^2 / sum l^2`` for the eigenvalues l of the departures' covariance over the cycle.

    Parameters
    ----------
    model : LocomotionModel
    x : ndarray, shape (T, F)
        NaN = missing.
    occupancy : ndarray, shape (C, T, M)

    Returns
    -------
    ndarray, shape (C,)
    """
    if model.n_styles == 1:
        return np.ones(1)
    seen = np.isfinite(x)
    shown, values = np.where(seen, x, 0.0), seen.sum(axis=0)
    misfits, features = [], []
    for mean, own in zip(model.mean, occupancy):
        count = own.T @ seen
        square = (count * mean**2 - 2 * (own.T @ shown) * mean).sum(axis=0) + (shown**2).sum(axis=0)
        misfits.append((square / model.personal.noise).sum() / values.sum())
        features.append(_independent(np.where(seen, x - own @ mean, 0.0)))
    eigen, twice = ring_eigenvalues(model.n_positions)
    spread = 1 / (model.personal.pull + model.personal.smooth * eigen[:, None])
    positions = float(np.median((twice @ spread)**2 / (twice @ spread**2)))
    size = features[int(np.argmin(misfits))] * positions
    scores = np.log(model.weights) - 0.5 * size * np.log(np.maximum(misfits, 1.0))
    return np.exp(scores - np.logaddexp.reduce(scores))


def _independent(residual):
    """Independent features that residuals (T, F) are worth."""
    size = np.sqrt((residual**2).sum(axis=0))
    scaled = residual[:, size > 0] / size[size > 0]
    return scaled.shape[1]**2 / max(((scaled.T @ scaled)**2).sum(), 1.0)


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording seen through a model.

    Attributes
    ----------
    name : str
    style : int
        The most probable style.
    style_probabilities : ndarray, shape (C,)
    times : ndarray, shape (T,)
        At the model's rate, s.
    position : ndarray, shape (T,)
        Most probable path (Viterbi) through the latent cycle, counted on over its end: cycle n runs from n M to
        (n+1) M.
    phase : ndarray, shape (T,)
        Rad, counted on likewise and running evenly on average: the posterior mean of the position, then refined to a
        fraction of a frame under a smooth course (`style_core.alignment.refine_phase`).
    cycle_times_s : ndarray
        When the phase passes whole turns: the limits of the cycles, s.
    log_likelihood_per_value : float
        Nats a frame and observed channel.
    """

    name: str
    style: int
    style_probabilities: np.ndarray
    times: np.ndarray
    position: np.ndarray
    phase: np.ndarray
    cycle_times_s: np.ndarray
    log_likelihood_per_value: float


def analyze(model, motion):
    """Style, path, phase and cycles of a recording.

    Parameters
    ----------
    model : LocomotionModel
    motion : Motion
        With the model's joints, at any rate; NaN = missing.

    Returns
    -------
    Analysis

    Raises
    ------
    MotionError
        If joints or units do not fit or nothing is observed.
    """
    times, x = model_frames(model, motion)
    emission = emission_of(model)
    result = smooth(model, x, emission=emission)
    best = int(result.styles.argmax())
    path = np.empty(len(x), np.int64)
    kernels.viterbi(emission.log_density(x, best), np.log(result.jumps[best]), path)
    steps = np.diff(path) % model.n_positions
    position = path[0] + np.concatenate([[0], np.cumsum(np.where(steps == 0, model.n_positions, steps))])
    phase = _refined(model, x, best, mean_phase(model, result.occupancy[best], position))
    turns = np.arange(np.ceil(phase[0] / (2 * np.pi)), np.floor(phase[-1] / (2 * np.pi)) + 1)
    forward = np.maximum.accumulate(phase + 1e-9 * np.arange(len(phase)))
    return Analysis(motion.name, best, result.styles, times, position, phase,
                    np.interp(2 * np.pi * turns, forward, times),
                    result.log_likelihood / max(1, int(np.isfinite(x).sum())))


def _refined(model, x, style, phase):
    """Phase (T,) smoothed and refined against the style's prototype, by what is observed."""
    if len(phase) < 4:
        return phase
    shapes = prototypes(model)
    hidden = ~np.isfinite(x)

    def evaluate(at):
        value, slope = shapes.curve(style, at)
        value[hidden] = slope[hidden] = 0.0
        return value, slope

    noise = model.noise[style] / model.personal.frame_weight
    return refine_phase(np.where(hidden, 0.0, x), phase, evaluate, noise, _ACCELERATION, 1 / model.rate_hz)[0]


def mean_phase(model, occupancy, position):
    """Phase (T,), rad: circular mean of the posterior (T, M), counted on along the path ``position`` (T,)."""
    starts = model.phase_of_position
    middle = 0.5 * (starts[1:] + starts[:-1])
    turned = np.angle(occupancy @ np.exp(1j * middle))
    rough = middle[position % model.n_positions] + 2 * np.pi * (position // model.n_positions)
    return rough + (turned - rough + np.pi) % (2 * np.pi) - np.pi


def model_frames(model, motion):
    """Times (T,) and features (T, F) of a motion at the model's rate.

    Raises
    ------
    MotionError
        If joints do not fit, or there is nothing to see.
    """
    if motion.n_frames > 1:
        motion = motion.resample(model.rate_hz)
    x = model.features.encode(motion)
    if not np.isfinite(x).any():
        raise MotionError(f'motion {motion.name!r} holds no value of the model\'s joints')
    return motion.times, x


def aligned_cycles(model, motion, n_samples=None, analysis: Optional[Analysis] = None):
    """Cut a recording into cycles, each over the same phases.

    Parameters
    ----------
    model : LocomotionModel
    motion : Motion
    n_samples : int, optional
        Samples a cycle; default M.
    analysis : Analysis, optional
        Of the motion, where it is at hand.

    Returns
    -------
    cycles : ndarray, shape (n_cycles, n_samples, D)
        Channels of ``model.joint_names`` (not features) at phases 2 pi k / n_samples; only whole cycles.
    times : ndarray, shape (n_cycles, n_samples)
        When each sample stood, s.
    """
    analysis = analysis or analyze(model, motion)
    n_samples = n_samples or model.n_positions
    forward = np.maximum.accumulate(analysis.phase + 1e-9 * np.arange(len(analysis.phase)))
    first = int(np.ceil(forward[0] / (2 * np.pi)))
    n_cycles = max(0, len(analysis.cycle_times_s) - 1)
    wanted = 2 * np.pi * (first + np.arange(n_cycles * n_samples) / n_samples)
    times = np.interp(wanted, forward, analysis.times)
    positions = (
        motion.joints(model.joint_names).at(times).positions if n_cycles else np.empty((0, len(model.joint_names)))
    )
    return positions.reshape(n_cycles, n_samples, len(model.joint_names)), times.reshape(n_cycles, n_samples)


def fillable(model, motion):
    """Give the model's joints of a motion, if nothing that does not repeat (place and heading) is missing."""
    motion = motion.joints(model.joint_names)
    lacking = np.isnan(motion.positions).any(axis=0) & ~model.features.plain
    if lacking.any():
        names = [name for name, lacks in zip(model.joint_names, lacking) if lacks]
        raise MotionError(
            f'motion {motion.name!r}: {", ".join(names)} cannot be filled, place and heading do not repeat'
        )
    return motion


def fill(model, motion):
    """Fill the missing values of a recording from all it shows, before and after (eq. 18 as a posterior mean).

    Parameters
    ----------
    model : LocomotionModel
    motion : Motion
        With the model's joints; NaN = missing. Root travel (place and heading) is not filled: it does not repeat.

    Returns
    -------
    filled : Motion
        The same frames and joints, no value changed that was there.
    std : ndarray, shape (T, D)
        Standard deviation of the filled values, 0 where observed.
    """
    motion = fillable(model, motion)
    hidden = np.isnan(motion.positions)
    times, x = model_frames(model, motion)
    mean, variance = expected_frames(model, x, smooth(model, x))
    at_frames = [np.stack([np.interp(motion.times, times, column) for column in table.T], axis=1)
                 for table in (mean, variance)]
    std = np.sqrt(at_frames[1])
    space = model.features.space
    if space is None:
        filled = np.where(hidden, at_frames[0], motion.positions)
    else:
        shown = space.encode_motion(motion).positions
        filled, std = space.fill_in(motion.positions, np.where(np.isnan(shown), at_frames[0], shown),
                                    np.where(np.isnan(shown), std, 0.0))
    return replace(motion, positions=filled), np.where(hidden, std, 0.0)


def _smoothed(frames):
    """Binomial average over five frames: positions are discrete, motion is not."""
    padded = np.concatenate([frames[:1], frames[:1], frames, frames[-1:], frames[-1:]])
    return sum(w * padded[k:k + len(frames)] for k, w in enumerate(np.array([1, 4, 6, 4, 1]) / 16))


def expected_frames(model, x, result):
    """Mean and variance (T, F) of every entry given all observed ones.

    Each style gives the recording's own cycle (its departure from the style's, from the observed entries) and the
    memory of the residuals nearest in time; styles are mixed by their probability.

    Parameters
    ----------
    x : ndarray, shape (T, F)
        NaN = missing.
    result : Smoothing
        Of x.
    """
    mean, square = np.zeros_like(x), np.zeros_like(x)
    for c in np.flatnonzero(result.styles > 1e-6):
        occupancy = result.occupancy[c]
        found = departure(model.personal, *residual_sums(x, model.mean[c], occupancy))
        cycle = model.mean[c] + found.mean
        expected = _smoothed(occupancy @ cycle)
        spread = np.maximum(occupancy @ (cycle**2 + found.variance + model.variance[c]) - expected**2, 0.0)
        kept, share = bridge(x - expected, model.personal.memory)
        mean += result.styles[c] * (expected + kept)
        square += result.styles[c] * (share * (spread + model.personal.noise) + (expected + kept)**2)
    return mean, np.maximum(square - mean**2, 0.0)
