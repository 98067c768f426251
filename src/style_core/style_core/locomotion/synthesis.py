"""Style prototypes and blends of them as motions."""
import re
from dataclasses import dataclass

import numpy as np

from style_core.alignment import harmonic_design
from style_core.errors import UsageError
from style_core.sizes import demand

__all__ = ['Prototypes', 'prototypes', 'Blend', 'parse_blend', 'synthesize']

_HARMONICS = 12
_PACE_HARMONICS = 3


@dataclass(frozen=True, eq=False)
class Prototypes:
    """Latent cycles as smooth periodic functions of the common phase.

    Attributes
    ----------
    cycles : ndarray, shape (C, 2 H + 1, F)
        Fourier coefficients (constant, then cosine and sine by turns) of each feature.
    pace : ndarray, shape (C, 2 P + 1)
        Of the time a style spends on a radian of phase, s/rad.
    """

    cycles: np.ndarray
    pace: np.ndarray

    def pose(self, phase):
        """Features of every style at phases (T,): (C, T, F)."""
        return harmonic_design(phase, (self.cycles.shape[1] - 1) // 2)[0] @ self.cycles

    def curve(self, style, phase):
        """Features of one style at phases (T,) and their derivative by phase; each (T, F)."""
        values, slopes = harmonic_design(phase, (self.cycles.shape[1] - 1) // 2)
        return values @ self.cycles[style], slopes @ self.cycles[style]

    def seconds_per_radian(self, phase):
        """(C, T) at phases (T,); at least a fifth of the style's mean."""
        value = harmonic_design(phase, (self.pace.shape[1] - 1) // 2)[0] @ self.pace.T
        return np.maximum(value, 0.2 * self.pace[:, 0]).T


def prototypes(model, harmonics=_HARMONICS):
    """Fit `Prototypes` to a model's cycles, each position weighted by the time that recordings spend there.

    Parameters
    ----------
    model : LocomotionModel
    harmonics : int
        Of the poses; fewer where the cycles have not that many positions.
    """
    edges = model.phase_of_position
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    harmonics = max(1, min(harmonics, model.n_positions // 5))
    basis, slow = harmonic_design(middle, harmonics)[0], harmonic_design(middle, _PACE_HARMONICS)[0]
    # a position that a style hardly visits still counts a little: its posterior follows its neighbours there
    weights = np.sqrt(model.dwell + 0.1 / model.n_positions)
    cycles = [np.linalg.lstsq(basis * w[:, None], mean * w[:, None], rcond=None)[0]
              for w, mean in zip(weights, model.mean)]
    by_width = np.sqrt(width)[:, None]
    seconds = model.periods_s * (model.dwell / width).T
    pace = np.linalg.lstsq(slow * by_width, seconds * by_width, rcond=None)[0].T
    # the period is the integral of the constant term alone
    pace[:, 0] = model.periods_s / (2 * np.pi)
    return Prototypes(np.stack(cycles), pace)


@dataclass(frozen=True, eq=False)
class Blend:
    """Weights of the styles over time: ``weights`` (K, C), rows summing to one, at ``times`` (K,), s."""

    times: np.ndarray
    weights: np.ndarray

    def at(self, times):
        """Weights (T, C): smooth (zero slope at the key times) from one to the next, constant outside."""
        if len(self.times) == 1:
            return np.repeat(self.weights, len(times), axis=0)
        left = np.clip(np.searchsorted(self.times, times, side='right') - 1, 0, len(self.times) - 2)
        u = np.clip((times - self.times[left]) / (self.times[left + 1] - self.times[left]), 0.0, 1.0)
        u = (u * u * (3 - 2 * u))[:, None]
        return (1 - u) * self.weights[left] + u * self.weights[left + 1]


def parse_blend(text, model):
    """Read a blend.

    Parameters
    ----------
    text : str
        ``"0.3*run + 0.7*walk"``: the same all along; ``"walk @ 0; 0.5*walk + 0.5*run @ 3; run @ 6"``: changing
        smoothly between the times given (s). Weights may be negative or above one (a style exaggerated) but sum to one.
    model : LocomotionModel
        Knows the style names.

    Returns
    -------
    Blend

    Raises
    ------
    UsageError
        If it cannot be read, or weights do not sum to one.
    ModelError
        If a style is unknown.
    """
    keys = [part.strip() for part in text.split(';') if part.strip()]
    if not keys:
        raise UsageError('the blend is empty')
    times, rows = [], []
    for key in keys:
        terms, _, moment = key.partition('@')
        if not moment and len(keys) > 1:
            raise UsageError(f'{key!r}: with several parts each needs its time, e.g. "walk @ 0; run @ 4"')
        try:
            times.append(float(moment.strip().rstrip('s')) if moment else 0.0)
        except ValueError:
            raise UsageError(f'{moment.strip()!r} is not a time in seconds') from None
        rows.append(_weights(terms, model))
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise UsageError('the times of a blend must increase')
    return Blend(np.array(times), np.array(rows))


def _weights(text, model):
    row = np.zeros(model.n_styles)
    pieces = re.findall(r'([+-]?)\s*(?:([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*\*\s*)?([A-Za-z_]\w*|\d+(?![\w.*]))\s*', text)
    spelt = ''.join(sign + (f'{number}*' if number else '') + name for sign, number, name in pieces)
    if not pieces or spelt != re.sub(r'\s+', '', text):
        raise UsageError(f'cannot read {text.strip()!r}; write e.g. "0.3*run + 0.7*walk"')
    for sign, number, name in pieces:
        try:
            value = float(number) if number else 1.0
        except ValueError:
            raise UsageError(f'{number!r} is not a number') from None
        row[model.style(name)] += -value if sign == '-' else value
    if abs(row.sum() - 1) > 1e-6:
        raise UsageError(f'the weights of {text.strip()!r} sum to {row.sum():g}, not to 1')
    return row


def synthesize(model, blend, duration_s, rate_hz=None, phase=0.0, name='blend'):
    """Motion of a blend: at every moment the weighted mean of the styles' poses at one phase, at the blended pace.

    Parameters
    ----------
    model : LocomotionModel
    blend : Blend
    duration_s : float
    rate_hz : float, optional
        Of the motion; default the model's.
    phase : float
        To start at, rad.
    name : str

    Returns
    -------
    motion : Motion
    phases : ndarray, shape (T,)
        Unwrapped, rad.

    Raises
    ------
    UsageError
        If duration or rate are not positive.
    """
    rate_hz = model.rate_hz if rate_hz is None else rate_hz
    if not (np.isfinite(duration_s) and duration_s > 0 and np.isfinite(rate_hz) and rate_hz > 0):
        raise UsageError('duration and rate must be positive')
    shapes = prototypes(model)
    count = duration_s * rate_hz + 1
    demand(2 * count * model.mean.shape[0] * model.mean.shape[2], f'{duration_s:g} s at {rate_hz:g} Hz, {count:.3g} '
           'frames,', 'a lower rate or less time')
    times = np.arange(int(np.floor(duration_s * rate_hz + 1e-9)) + 1) / rate_hz
    slowest = 0.25 * shapes.pace[:, 0].min()      # an exaggerated blend must not run backwards

    def speed(moment, at):
        weights = blend.at(np.array([moment]))[0]
        return 1 / max(float(weights @ shapes.seconds_per_radian(np.array([at]))[:, 0]), slowest)

    phases = np.empty(len(times))
    phases[0] = phase
    for i, start in enumerate(times[:-1]):
        step = times[i + 1] - start
        middle = phases[i] + 0.5 * step * speed(start, phases[i])      # midpoint rule
        phases[i + 1] = phases[i] + step * speed(start + 0.5 * step, middle)
    weights = blend.at(times)
    features = np.einsum('tc,ctf->tf', weights, shapes.pose(phases))
    return model.features.decode(features, times, name=name), phases
