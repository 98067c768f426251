"""Off-line smoothing with the full filter's model: phase, style and residual of a whole recording at once.

Given the phase, what a channel is made of beside the bases is a Gaussian process over time, whose covariance follows
from its parts (eq. 16 of docs/phase_style.md). So the smoother works on that process instead of running a filter
forward and a recursion backward: linearised at the same phases both are the same Gaussian. Gauss-Newton steps over
phase, phase velocity and style alternate with an M-step for the size of the residual (expectation maximisation); a long
recording is smoothed in overlapping pieces.
"""
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from style_core.errors import MotionError
from style_core.phase_style.basis_table import Table
from style_core.phase_style.channel import covariances_of
from style_core.phase_style.full import filter_table
from style_core.phase_style.full_predictor import FullPredictor

__all__ = ['Smoothed', 'smooth_piece', 'fill']

#: Frames of a piece and of the overlap of neighbouring pieces.
PIECE, OVERLAP = 240, 60


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Attributes
    ----------
    mean, std : ndarray, shape (T, D)
        Pose without the recording's white noise, rad.
    phase, phase_velocity : ndarray, shape (T,)
        Unwrapped.
    style : ndarray, shape (J,)
        Whitened style z.
    residual_scale : float
        Factor on the residual's variances that the M-step found.
    evidence : list of float
        Log evidence (Laplace) after every iteration, nats.
    converged : bool
    """

    mean: np.ndarray
    std: np.ndarray
    phase: np.ndarray
    phase_velocity: np.ndarray
    style: np.ndarray
    residual_scale: float
    evidence: list
    converged: bool


def _chain_precision(times, acceleration, start):
    """Prior precision of (phase, velocity) at all times, (2 T, 2 T), and its product with the prior mean."""
    count = len(times)
    precision, push = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    phase, velocity, phase_variance, velocity_variance = start
    precision[0, 0], precision[1, 1] = 1 / phase_variance, 1 / velocity_variance
    push[:2] = phase / phase_variance, velocity / velocity_variance
    for t, dt in enumerate(np.diff(times)):
        noise = np.linalg.inv(acceleration * np.array([[dt ** 3 / 3, dt ** 2 / 2], [dt ** 2 / 2, dt]]))
        step = np.array([[-1.0, -dt, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])
        at = slice(2 * t, 2 * t + 4)
        precision[at, at] += step.T @ noise @ step
    return precision, push


def smooth_piece(behaviour, times, y, phase, velocity, iterations=12, tolerance=1e-3):
    """Smooth one stretch of one behaviour.

    Parameters
    ----------
    behaviour : Behaviour
        With a residual model.
    times : ndarray, shape (T,)
    y : ndarray, shape (T, D)
        Rad; NaN where missing.
    phase, velocity : ndarray, shape (T,)
        Where to start (from the on-line filter); the phase unwrapped.
    iterations : int
    tolerance : float
        Ends when the evidence a sample changes by less, nats.

    Returns
    -------
    Smoothed
    """
    residual, count = behaviour.residual, len(times)
    table = Table(filter_table(behaviour))
    styles = table.count - 1
    seen = ~np.isnan(y)
    chain, push = _chain_precision(times, behaviour.acceleration,
                                   (phase[0], behaviour.velocity[0], 1.0, behaviour.velocity[1] ** 2 + 1e-6))
    prior = np.zeros((2 * count + styles, 2 * count + styles))
    prior[:2 * count, :2 * count] = chain
    prior[2 * count:, 2 * count:] = np.eye(styles)
    push = np.concatenate([push, np.zeros(styles)])
    theta = np.concatenate([np.stack([phase, velocity], axis=1).ravel(), np.zeros(styles)])
    scale, evidence, converged = 1.0, [], False
    half_prior = 0.5 * np.linalg.slogdet(prior)[1]
    start = np.linalg.solve(prior, push)
    for iteration in range(iterations):
        here = theta[:2 * count:2]
        base = np.array([table.evaluate(at) for at in here])  # (T, 2, J + 1, D)
        weight = np.concatenate([[1.0], theta[2 * count:]])
        mean = np.tensordot(base[:, 0], weight, axes=(1, 0))
        slope = np.tensordot(base[:, 1], weight, axes=(1, 0))
        parts = covariances_of(residual, behaviour.rhythmic, times, here)
        hessian, gradient = np.zeros_like(prior), np.zeros_like(theta)
        fit, half_logs, samples = 0.0, 0.0, 0
        channels = []
        for d in range(y.shape[1]):
            rows = np.flatnonzero(seen[:, d])
            signal = sum(variance[d] * covariance for covariance, variance in parts)
            jacobian = np.zeros((count, len(theta)))
            jacobian[np.arange(count), np.arange(0, 2 * count, 2)] = slope[:, d]
            jacobian[:, 2 * count:] = base[:, 0, 1:, d]
            if not len(rows):
                channels.append((rows, signal, jacobian, None))
                continue
            gram = signal[np.ix_(rows, rows)] + residual.noise[d] * np.eye(len(rows))
            factor = cho_factor(gram, lower=True)
            # error about the linearisation's origin, so that one solve gives the new parameters
            error = y[rows, d] - mean[rows, d] + slope[rows, d] * here[rows] \
                + base[rows, 0, 1:, d] @ theta[2 * count:]
            solved = cho_solve(factor, np.column_stack([error, jacobian[rows]]))
            hessian += jacobian[rows].T @ solved[:, 1:] / scale
            gradient += jacobian[rows].T @ solved[:, 0] / scale
            half_logs += np.sum(np.log(np.diag(factor[0]))) + 0.5 * len(rows) * np.log(2 * np.pi * scale)
            samples += len(rows)
            channels.append((rows, signal, jacobian, factor))
        total = cho_factor(prior + hessian, lower=True)
        new = cho_solve(total, push + gradient)
        covariance = cho_solve(total, np.eye(len(theta)))
        linear = []
        for d, (rows, _, jacobian, factor) in enumerate(channels):
            if factor is None:
                linear.append(None)
                continue
            left = y[rows, d] - mean[rows, d] + slope[rows, d] * here[rows] \
                + base[rows, 0, 1:, d] @ theta[2 * count:] - jacobian[rows] @ new
            linear.append(left)
            fit += left @ cho_solve(factor, left)
        step = np.abs(new - theta)[:2 * count:2].max()
        deviation = new - start
        evidence.append(float(half_prior - half_logs - np.sum(np.log(np.diag(total[0]))) - 0.5 * fit / scale
                              - 0.5 * deviation @ prior @ deviation))
        theta = new
        converged = len(evidence) > 1 and step < 0.02 \
            and abs(evidence[-1] - evidence[-2]) < tolerance * max(samples, 1)
        if converged or iteration == iterations - 1:
            break
        # M-step: expected square of the residual, with what is not known about phase and style; the size learned on
        # left-out people counts as much as the recording, which says nothing about the joints it lacks
        if samples:
            scale = float(0.5 + 0.5 * (fit + scale * np.sum(hessian * covariance)) / samples)
    out, std = np.empty(y.shape), np.empty(y.shape)
    shift = theta[:2 * count:2] - here
    for d, (rows, signal, jacobian, factor) in enumerate(channels):
        value = mean[:, d] + slope[:, d] * shift + base[:, 0, 1:, d] @ (theta[2 * count:] - weight[1:])
        variance = scale * np.diag(signal).copy()
        reach = jacobian
        if factor is not None:
            gain = cho_solve(factor, signal[rows]).T
            value = value + gain @ linear[d]
            variance -= scale * np.sum(gain * signal[:, rows], axis=1)
            reach = jacobian - gain @ jacobian[rows]
        variance += np.einsum('tp,pq,tq->t', reach, covariance, reach, optimize=True)
        out[:, d], std[:, d] = value, np.sqrt(np.maximum(variance, 0.0))
    return Smoothed(out, std, theta[:2 * count:2], theta[1:2 * count:2], theta[2 * count:], scale, evidence, converged)


def _follow(behaviour, times, y):
    """Phase (unwrapped) and phase velocity of every frame from the on-line filter, forward over the recording."""
    predictor = FullPredictor([behaviour], without=['still'])
    phases, velocities = np.empty(len(times)), np.empty(len(times))
    for frame, time in enumerate(times):
        estimate = predictor.update(time, y[frame])
        phases[frame], velocities[frame] = estimate.phase, estimate.phase_velocity
    if not behaviour.rhythmic:
        return phases, velocities
    # the last frames know best: go back from each with its velocity where the phase jumped at the start of tracking
    phases = np.unwrap(phases)
    first = min(len(times) - 1, int(np.searchsorted(times, times[0] + 0.5)))
    phases[:first] = phases[first] - velocities[first] * (times[first] - times[:first])
    velocities[:first] = velocities[first]
    return phases, velocities


def fill(behaviours, motion, progress=None):
    """Fill the gaps of a recording; what was measured stays as it is.

    Parameters
    ----------
    behaviours : list of Behaviour
        The one that explains a piece best is used for it.
    motion : Motion
        NaN where missing. Joints the model does not know stay as they are.
    progress : callable, optional
        Wrapped around the list of pieces (a progress bar).

    Returns
    -------
    filled : Motion
    std : ndarray, shape (T, D)
        Of every pose in the model's joints, rad.
    report : list of dict
        For every piece: behaviour, first and last time, log evidence by iteration, convergence, residual scale.

    Raises
    ------
    MotionError
        If a joint of the model is absent from the recording or the recording holds nothing.
    """
    names = behaviours[0].joint_names
    own = motion.joints(list(names))
    y, times = own.positions, own.times
    if np.isnan(y).all():
        raise MotionError(f'{motion.name}: there is nothing to fill in from, every value is missing')
    if len(times) < 8:
        raise MotionError(f'{motion.name}: {len(times)} frames are too few to fill in')
    pieces = _pieces(len(times))
    mean, weight, variance = np.zeros(y.shape), np.zeros(len(times)), np.zeros(y.shape)
    report = []
    for begin, end in progress(pieces) if progress else pieces:
        best = None
        for behaviour in behaviours:
            phase, velocity = _follow(behaviour, times[begin:end], y[begin:end])
            found = smooth_piece(behaviour, times[begin:end], y[begin:end], phase, velocity)
            if best is None or found.evidence[-1] > best[0].evidence[-1]:
                best = found, behaviour
        found, behaviour = best
        ramp = np.ones(end - begin)
        rise = np.linspace(0, 1, OVERLAP + 2)[1:-1][:end - begin]
        if begin > 0:
            ramp[:len(rise)] = rise
        if end < len(times):
            ramp[-len(rise):] = np.minimum(ramp[-len(rise):], rise[::-1])
        mean[begin:end] += ramp[:, None] * found.mean
        variance[begin:end] += ramp[:, None] * found.std ** 2
        weight[begin:end] += ramp
        report.append({'behaviour': behaviour.name, 'from_s': float(times[begin]), 'to_s': float(times[end - 1]),
                       'log_evidence': found.evidence, 'converged': found.converged,
                       'residual_scale': found.residual_scale})
    mean /= weight[:, None]
    column = {name: index for index, name in enumerate(motion.joint_names)}
    positions = motion.positions.copy()
    where = [column[name] for name in names]
    positions[:, where] = np.where(np.isnan(y), mean, y)
    return motion.replace(positions=positions), np.sqrt(variance / weight[:, None]), report


def _pieces(count):
    """Overlapping (begin, end) of frames, none much shorter than the others."""
    if count <= PIECE:
        return [(0, count)]
    number = int(np.ceil((count - OVERLAP) / (PIECE - OVERLAP)))
    starts = np.linspace(0, count - PIECE, number).astype(int)
    return [(int(start), int(start) + PIECE) for start in starts]
