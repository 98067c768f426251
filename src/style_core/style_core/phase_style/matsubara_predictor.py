"""The published method as an on-line predictor, and its batch EM off line (Matsubara et al. 2012, section 3)."""
import math
from dataclasses import dataclass, replace

import numpy as np

from style_core.errors import MotionError, UsageError
from style_core.phase_style.basis_table import Table, tabulate
from style_core.phase_style.loss import InnovationMonitor
from style_core.phase_style.matsubara_filter import MatsubaraFilter
from style_core.phase_style.observation import ObservationChecker
from style_core.phase_style.settings import GAP_S
from style_core.predictor import Estimate, Prediction, Status

__all__ = ['EQ_13', 'FARTHEST', 'FORGETTING', 'PaperPredictor', 'BatchResult', 'batch_em', 'checked_forgetting']

#: No joint is farther from 0, rad (as on line, observation.pyx).
FARTHEST = 1e4
#: lambda of the paper.
FORGETTING = 0.8
#: `PaperPredictor`'s observation noise that is eq. (13) alone.
EQ_13 = 'eq13'

#: The search at the start: so many phases, and speeds as multiples of the training mean's spread.
SEARCH_PHASES = 16
SEARCH_SPEEDS = (-1.0, 1.0)
#: The hypothesis with the highest likelihood is kept after this long and at least so many updates.
SEARCH_S = 0.1
SEARCH_UPDATES = 4


def checked_forgetting(value):
    """lambda, a float; UsageError where it does not lie in (0, 1]."""
    if not 0 < value <= 1:
        raise UsageError(f'forgetting (lambda) must lie in (0, 1], got {value}')
    return float(value)


def _process_noise(value, behaviour):
    """Density of the phase acceleration, and the variances a second of a diagonal Q."""
    if value is None:
        return behaviour.acceleration, 0.0, 0.0
    parts = np.asarray(value, dtype=float)
    if parts.shape not in ((), (2,)) or not (np.isfinite(parts).all() and (parts >= 0).all() and parts.any()):
        raise UsageError('process_noise (Q) must be the density of the phase acceleration, or two variances a frame, '
                         f'of phase and velocity; not negative and not all 0; got {value!r}')
    if parts.shape == ():
        return float(parts), 0.0, 0.0
    return 0.0, *(parts * behaviour.rate_hz).tolist()


def _observation_noise(value, behaviour):
    """R (D,) and the table of the bases, whose variance is what eq. (13) weighs."""
    table = tabulate(behaviour.processes(), behaviour.rhythmic)
    if value is None:
        return behaviour.noise, table
    if isinstance(value, str):
        if value != EQ_13:
            raise UsageError(f'observation_noise (R) must be {EQ_13!r}, a variance, or one a joint; got {value!r}')
        # the kernel of eq. (7) holds the noise 1 / beta_3, and so does k(z*, z*) of eq. (10)
        own = np.array([1 / process.beta[2] for process in behaviour.processes()])
        return np.zeros(len(behaviour.joint_names)), replace(table, variance=table.variance + own)
    noise = np.asarray(value, dtype=float)
    if noise.shape not in ((), (len(behaviour.joint_names),)) or not (np.isfinite(noise).all() and (noise > 0).all()):
        raise UsageError('observation_noise (R) must be positive, one variance in rad^2 or one for each of '
                         f'{len(behaviour.joint_names)} joints')
    return np.broadcast_to(noise, len(behaviour.joint_names)).copy(), table


def _start_given(value, behaviour):
    """Phase and velocity to start from, None for a search."""
    if value is None:
        return None
    parts = np.atleast_1d(np.asarray(value, dtype=float))
    if parts.shape not in ((1,), (2,)) or not np.isfinite(parts).all():
        raise UsageError(f'start must be a phase, or a phase and its velocity; got {value!r}')
    if not behaviour.rhythmic and not 0 <= parts[0] <= 1:
        raise UsageError(f'the phase of {behaviour.name}, from start to goal, must lie in 0 to 1, got {parts[0]}')
    return float(parts[0]), float(parts[1]) if len(parts) == 2 else float(behaviour.velocity[0])


def _filters(behaviour, table, forgetting, step, noise=None, process=None, start=None):
    """One filter a hypothesis: phases by speeds (discrete motion: the first half of the motion, one speed)."""
    style = behaviour.styles.mean(axis=0)
    mean, spread = behaviour.velocity[:2]
    noise = behaviour.noise if noise is None else noise
    acceleration, *diagonal = (behaviour.acceleration, 0.0, 0.0) if process is None else process
    if start is not None:
        width = (np.pi if behaviour.rhythmic else 0.5) / SEARCH_PHASES
        phases, speeds = [start[0]], [start[1]]
    elif behaviour.rhythmic:
        phases = np.arange(SEARCH_PHASES) * 2 * np.pi / SEARCH_PHASES
        speeds = mean + spread * np.array(SEARCH_SPEEDS)
        width = np.pi / SEARCH_PHASES
    else:
        phases, speeds, width = np.arange(SEARCH_PHASES) / (2 * SEARCH_PHASES), [mean], 1 / (2 * SEARCH_PHASES)
    filters = []
    for phase in phases:
        for speed in speeds:
            one = MatsubaraFilter(table, noise, acceleration, style, forgetting, step, *diagonal)
            one.start(phase, speed, width ** 2 / 3, spread ** 2)
            filters.append(one)
    return filters


class PaperPredictor:
    """EKF over phase and phase velocity, on-line EM for the style.

    Fulfils `style_core.predictor.OnlinePredictor`. The filter does not assume where the motion starts: for the
    first tenth of a second one filter for each of 32 hypotheses runs, and the most likely one goes on.

    Parameters
    ----------
    behaviour : Behaviour
    forgetting : float
        lambda of the on-line EM for one frame at the model's rate, in (0, 1]; other time steps forget accordingly.
    process_noise : float or (float, float), optional
        Q: the density of a white phase acceleration (rad^2 / s^3 where rhythmic), or, as printed, the diagonal of Q
        for one frame at the model's rate: variance of the phase and of its velocity (per s). The density that
        training found where absent.
    observation_noise : {'eq13'}, float or ndarray of shape (D,), optional
        R: variances, rad^2, to which eq. (13) is added; or ``'eq13'``, that alone, as printed, with the noise
        ``1 / beta_3`` of each process. The residual of the training where absent.
    start : float or (float, float), optional
        Phase, or phase and its velocity, to start from; a search where absent. The velocity is the mean of the
        training where it is not given, the style always.

    Raises
    ------
    UsageError
        If a setting is out of its range.
    """

    def __init__(self, behaviour, forgetting=FORGETTING, process_noise=None, observation_noise=None, start=None):
        self.joint_names = behaviour.joint_names
        self._behaviour = behaviour
        self._forgetting = checked_forgetting(forgetting)
        self._process = _process_noise(process_noise, behaviour)
        self._start = _start_given(start, behaviour)
        self._noise, table = _observation_noise(observation_noise, behaviour)
        self._table = Table(table)
        self._observation = ObservationChecker(len(self.joint_names))
        # its R knows nothing of new people: only a change of the innovations tells
        self._monitor = InnovationMonitor(usual=(0.0, math.inf))
        self.reset()

    @property
    def forgetting(self):
        """lambda a frame of the model's rate; may be set at any time, for what comes."""
        return self._forgetting

    @forgetting.setter
    def forgetting(self, value):
        self._forgetting = checked_forgetting(value)
        for one in self._hypotheses or [self._filter]:
            one.forget(self._forgetting)

    def reset(self):
        """Forget everything observed; the next update starts a search."""
        self._observation.reset()
        self._search()

    def _search(self):
        self._monitor.reset()
        self._hypotheses = _filters(self._behaviour, self._table, self._forgetting, 1 / self._behaviour.rate_hz,
                                    self._noise, self._process, self._start)
        self._scores = np.zeros(len(self._hypotheses))
        self._searched_s, self._searched = 0.0, 0
        self._filter = self._hypotheses[0]
        if self._start is not None:
            self._hypotheses = None

    def update(self, time, y, mask=None):
        """Take one observation (see `style_core.predictor.OnlinePredictor.update`)."""
        observation = self._observation
        dt = observation.check(time, y, mask)
        if dt > GAP_S:
            self._search()
            dt = 0.0
        if self._hypotheses is not None:
            self._update_search(dt)
            status = Status.ACQUIRING
        else:
            self._filter.update(observation.y, observation.observed, dt)
            status = Status.TRACKING
        current = self._filter
        lost = self._monitor.add(current.innovation, dt)
        if lost and status is Status.TRACKING:
            status = Status.LOST
        covariance, style, style_covariance, mean, std = current.describe()
        return Estimate(
            time=observation.time, phase=current.phase, phase_velocity=current.velocity, phase_covariance=covariance,
            style=style, style_covariance=style_covariance, mean=mean, std=std, observed=observation.flags(),
            innovation=current.innovation, log_likelihood=current.log_likelihood, status=status,
            behaviours={self._behaviour.name: 1.0})

    def _update_search(self, dt):
        observation = self._observation
        for index, one in enumerate(self._hypotheses):
            one.update(observation.y, observation.observed, dt)
            self._scores[index] += one.log_likelihood
        self._filter = self._hypotheses[int(np.argmax(self._scores))]
        if observation.observed.any():
            self._searched += 1
            self._searched_s += dt
        if self._searched >= SEARCH_UPDATES and self._searched_s >= SEARCH_S:
            self._hypotheses = None

    def predict(self, horizons):
        """Predict at ``horizons`` (shape (H,), s after the last update, >= 0)."""
        horizons = np.array(horizons, dtype=float)
        mean, std, velocity = self._filter.forecast(horizons)
        horizons += self._observation.time or 0.0
        return Prediction(horizons, mean, std, velocity)


@dataclass(frozen=True, eq=False)
class BatchResult:
    """Attributes
    ----------
    style : ndarray, shape (J,)
    phase, phase_velocity : ndarray, shape (T,)
        Means of the E-step.
    phase_covariance : ndarray, shape (2, 2)
        Of the last frame.
    log_likelihood : list of float
        Of the E-step of every iteration, nats.
    style_change : list of float
        Largest change of a style component in every iteration, as a share of the largest component.
    converged : bool
    """

    style: np.ndarray
    phase: np.ndarray
    phase_velocity: np.ndarray
    phase_covariance: np.ndarray
    log_likelihood: list
    style_change: list
    converged: bool

    def predict(self, behaviour, horizons):
        """Mean poses (H, D) at times after the last frame, section 3.3."""
        phase = self.phase[-1] + self.phase_velocity[-1] * np.asarray(horizons, dtype=float)
        if not behaviour.rhythmic:
            phase = np.clip(phase, 0.0, 1.0)
        values = np.stack([process.evaluate(phase)[0] for process in behaviour.processes()])
        return np.tensordot(self.style, values, axes=1)


def batch_em(behaviour, times, y, iterations=30, tolerance=1e-3):
    """Batch EM of section 3.1: E-step by the EKF with the style held, M-step (A.7) over all frames.

    Parameters
    ----------
    behaviour : Behaviour
    times : ndarray, shape (T,)
    y : ndarray, shape (T, D)
        Rad; NaN where missing, and so is what no joint can be, beyond 10,000.
    iterations : int
    tolerance : float
        Converged when no style component changes by more than this share of the largest.

    Returns
    -------
    BatchResult

    Raises
    ------
    MotionError
        If there are fewer than five frames or nothing was observed.
    """
    y, times = np.ascontiguousarray(y, dtype=float), np.asarray(times, dtype=float)
    seen = np.abs(y) <= FARTHEST        # false where NaN
    if len(y) < 5 or not seen.any():
        raise MotionError(f'{len(y)} frames with {int(seen.sum())} values are too few to adapt to')
    table = Table(tabulate(behaviour.processes(), behaviour.rhythmic))
    observed, clean = seen.astype(np.uint8), np.where(seen, y, 0.0)
    steps = np.diff(times, prepend=times[0])
    start = _start(behaviour, table, times, clean, observed)
    style = behaviour.styles.mean(axis=0)
    likelihoods, changes, converged = [], [], False
    for _ in range(iterations):
        one = MatsubaraFilter(table, behaviour.noise, behaviour.acceleration, style, 1.0, 1.0)
        one.start(*start)
        phases, velocities, total = np.empty(len(y)), np.empty(len(y)), 0.0
        for frame, dt in enumerate(steps):
            one.update(clean[frame], observed[frame], dt, False)
            phases[frame], velocities[frame] = one.phase, one.velocity
            total += one.log_likelihood
        basis = np.array([table.evaluate(phase)[0] for phase in phases])
        weighted = basis * seen[:, None, :]
        normal = np.einsum('tjd,tkd->jk', weighted, basis)
        ridge = 1e-12 * np.trace(normal) * np.eye(len(normal))
        new = np.linalg.solve(normal + ridge, np.einsum('tjd,td->j', weighted, clean) + ridge @ style)
        likelihoods.append(float(total))
        changes.append(float(np.max(np.abs(new - style)) / max(np.max(np.abs(new)), 1e-12)))
        style = new
        if changes[-1] < tolerance:
            converged = True
            break
    return BatchResult(style, phases, velocities, one.covariance, likelihoods, changes, converged)


def _start(behaviour, table, times, clean, observed):
    """Phase, velocity and variances at the first frame: those of the likeliest hypothesis over all frames."""
    best = None
    for one in _filters(behaviour, table, 0.95, 1 / behaviour.rate_hz):
        first = (one.phase, one.velocity, one.covariance[0, 0], one.covariance[1, 1])
        total = 0.0
        for frame, dt in enumerate(np.diff(times, prepend=times[0])):
            one.update(clean[frame], observed[frame], dt)
            total += one.log_likelihood
        if best is None or total > best[0]:
            best = total, first
    return best[1]
