"""Period and phase of rhythmic motion: auto-correlation, cross-correlation, sub-frame refinement."""
import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from style_core.errors import MotionError

__all__ = ['period', 'repetition', 'cycle_shift', 'harmonic_design', 'fit_cycle', 'refine_phase']


def _vertex(left, middle, right):
    """Offset of the vertex of the parabola through three equidistant values, in steps of their distance."""
    curvature = left - 2 * middle + right
    return 0.5 * (left - right) / curvature if curvature < 0 else 0.0


def period(y, rate_hz, shortest_s=0.4, longest_s=2.5):
    """Period of a rhythmic motion: the lag of largest normalised auto-correlation, to a fraction of a frame.

    Matsubara et al. (2012), section 2.2.1, with two changes: every channel's mean is removed and the sum over
    the overlap is divided by the energy in it, ``2 sum y_n y_{n+j} / sum (|y_n|^2 + |y_{n+j}|^2)``, so that
    constant postures and short overlaps do not decide.

    Parameters
    ----------
    y : ndarray, shape (T, D)
        Equidistant frames without gaps.
    rate_hz : float
    shortest_s, longest_s : float
        Where to look, s. Lags beyond 80 % of the recording are never considered.

    Returns
    -------
    float
        Period, s.

    Raises
    ------
    MotionError
        If the recording is too short, does not move, or has no peak in the range.
    """
    return repetition(y, rate_hz, shortest_s, longest_s)[0]


def repetition(y, rate_hz, shortest_s=0.4, longest_s=2.5):
    """Period (s) as `period` finds it, and how like the motion is to itself one period later.

    The likeness is the normalised auto-correlation there: 1 the same again, 0 nothing in common (noise).
    """
    y = np.asarray(y, dtype=float)
    y = y - y.mean(axis=0)
    n = len(y)
    first = max(2, int(np.floor(shortest_s * rate_hz)))
    last = min(int(np.ceil(longest_s * rate_hz)), int(0.8 * n))
    if last < first + 2:
        raise MotionError(f'{n} frames at {rate_hz:g} Hz are too few to find a period of {shortest_s:g} s or more')
    energy = np.concatenate([[0.0], np.cumsum(np.sum(y * y, axis=1))])
    if energy[-1] <= 1e-12 * max(y.size, 1):
        raise MotionError('nothing moves in this recording: it has no period')
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    spectrum = np.fft.rfft(y, size, axis=0)
    product = np.fft.irfft(np.sum(spectrum.real ** 2 + spectrum.imag ** 2, axis=1), size)[:last + 2]
    lags = np.arange(len(product))
    overlap_energy = energy[n - lags] + (energy[n] - energy[lags])
    score = 2 * product / np.maximum(overlap_energy, 1e-300)
    inner = np.arange(first, last)
    peaks = inner[(score[inner] >= score[inner - 1]) & (score[inner] > score[inner + 1])]
    if len(peaks) == 0:
        raise MotionError(f'no repetition between {shortest_s:g} and {longest_s:g} s found in this recording')
    # the multiples of a period score alike: take the shortest among the nearly best
    best = peaks[score[peaks] >= score[peaks].max() - 0.05][0]
    return (best + _vertex(*score[best - 1:best + 2])) / rate_hz, float(score[best])


def cycle_shift(reference, cycle):
    """Phase by which a cycle lags the reference: the peak of their circular cross-correlation, sub-sample.

    Parameters
    ----------
    reference, cycle : ndarray, shape (C, D)
        One cycle each, equidistant in phase; channel means are ignored.

    Returns
    -------
    float
        Rad in [0, 2 pi): ``cycle(phase + shift)`` fits ``reference(phase)`` best.
    """
    a = reference - reference.mean(axis=0)
    b = cycle - cycle.mean(axis=0)
    count = len(a)
    score = np.fft.irfft(np.sum(np.conj(np.fft.rfft(a, axis=0)) * np.fft.rfft(b, axis=0), axis=1), count)
    best = int(np.argmax(score))
    fraction = _vertex(score[best - 1], score[best], score[(best + 1) % count])
    return (best + fraction) * 2 * np.pi / count % (2 * np.pi)


def harmonic_design(phase, harmonics):
    """Fourier design matrix and its derivative by phase.

    Parameters
    ----------
    phase : ndarray, shape (T,)
        Rad.
    harmonics : int

    Returns
    -------
    values, derivatives : ndarray, shape (T, 1 + 2 * harmonics)
        Columns 1, cos, sin, cos 2, sin 2, ...
    """
    phase = np.asarray(phase, dtype=float)
    order = np.arange(1, harmonics + 1)
    angle = phase[:, None] * order
    values = np.ones((len(phase), 1 + 2 * harmonics))
    derivatives = np.zeros_like(values)
    values[:, 1::2], values[:, 2::2] = np.cos(angle), np.sin(angle)
    derivatives[:, 1::2], derivatives[:, 2::2] = -order * values[:, 2::2], order * values[:, 1::2]
    return values, derivatives


def fit_cycle(y, phase, harmonics=6, smoothness=1e-4):
    """Least-squares cycle of a sequence over all its frames.

    Parameters
    ----------
    y : ndarray, shape (T, D)
    phase : ndarray, shape (T,)
        Rad.
    harmonics : int
    smoothness : float
        Ridge on harmonic k, as ``smoothness * T * k^4``; decides only where a cycle is not fully covered.

    Returns
    -------
    ndarray, shape (1 + 2 * harmonics, D)
        Coefficients for `harmonic_design`.
    """
    design, _ = harmonic_design(phase, harmonics)
    weight = np.concatenate([[0.0], np.repeat(np.arange(1, harmonics + 1) ** 4.0, 2)])
    normal = design.T @ design + np.diag(smoothness * len(phase) * weight)
    return np.linalg.solve(normal, design.T @ y)


def refine_phase(y, phase, evaluate, noise, acceleration, dt, iterations=3, lower=None, upper=None):
    """Smooth the phase of a sequence given its cycle (Gauss-Newton on the MAP phase).

    Maximises ``-sum |y_t - c(phase_t)|^2 / noise - sum (second difference)^2 / variance`` where the second
    difference of a phase with white acceleration of density ``acceleration`` has variance
    ``2/3 acceleration dt^3``.

    Parameters
    ----------
    y : ndarray, shape (T, D)
    phase : ndarray, shape (T,)
        Start.
    evaluate : callable
        ``phase (T,) -> cycle (T, D), derivative (T, D)``.
    noise : ndarray, shape (D,)
        Variance of the residual, already enlarged for its correlation in time.
    acceleration : float
        rad^2/s^3.
    dt : float
        s.
    iterations : int
    lower, upper : float, optional
        Bounds on the phase (discrete motion).

    Returns
    -------
    phase : ndarray, shape (T,)
    evidence : float
        Logarithm of the evidence for ``acceleration`` by Laplace's approximation, up to a constant.
    """
    count = len(phase)
    variance = 2 / 3 * acceleration * dt ** 3
    penalty = np.zeros((3, count))  # D^T D of second differences, lower banded form
    for row, value in ((0, 1.0), (1, 4.0), (2, 1.0)):
        penalty[0, row:count - 2 + row] += value
    penalty[1, 0:count - 2] += -2.0
    penalty[1, 1:count - 1] += -2.0
    penalty[2, 0:count - 2] += 1.0
    penalty /= variance
    phase = np.array(phase, dtype=float)
    for _ in range(iterations):
        value, slope = evaluate(phase)
        gradient = np.sum((y - value) * slope / noise, axis=1)
        second = np.diff(phase, 2) / variance
        gradient[:-2] -= second
        gradient[1:-1] += 2 * second
        gradient[2:] -= second
        system = penalty.copy()
        system[0] += np.sum(slope * slope / noise, axis=1) + 1e-9
        factor = cholesky_banded(system, lower=True)
        phase = phase + np.clip(cho_solve_banded((factor, True), gradient), -0.5, 0.5)
        if lower is not None:
            phase = np.clip(phase, lower, upper)
    value, slope = evaluate(phase)
    evidence = -0.5 * np.sum((y - value) ** 2 / noise) - 0.5 * np.sum(np.diff(phase, 2) ** 2) / variance \
        - 0.5 * (count - 2) * np.log(variance) - np.sum(np.log(factor[0]))
    return phase, float(evidence)
