"""On line: forward filtering of phase, speed and style, and prediction (the protocol of `style_core.predictor`)."""
from dataclasses import replace

import numpy as np

from style_core.errors import ModelError
from style_core.joint_space.online import InJointSpace, border_of
from style_core.locomotion.infer import fillable
from style_core.locomotion.personal import Personal, departure
from style_core.locomotion.synthesis import prototypes
from style_core.outliers import FAREWELL_S, Doubt
from style_core.phase_style.observation import ObservationChecker
from style_core.predictor import Estimate, Prediction, Status

__all__ = ['LocomotionPredictor', 'fill_causally']

#: speeds followed, as multiples of a style's mean
_SPEEDS = np.geomspace(0.55, 1.8, 11)
#: how often a second a walker changes to a neighbouring speed, and to another style
_SPEED_RATE = 1.5
_STYLE_RATE = 0.05
#: standard deviation of the phase's own wandering, rad / sqrt(s)
_WANDER = 0.15
#: share of the residual's variance that is noise of the sensor, not of the motion
_SENSOR_SHARE = 0.02
#: the innovation (1 where the model fits), averaged over about half a second, above which the walker is lost
_LOST = 16.0
#: concentration of phase and time seen before an estimate is trusted
_CONCENTRATION, _WARM_UP_S = 0.9, 0.2
#: the walker's own cycle is computed again after this time, s
_PERSONAL_EVERY_S = 0.1


class LocomotionPredictor(InJointSpace):
    """Follow phase, speed and style of a walker frame by frame.

    The latent cycles, over M even steps of phase, make a grid of style, speed and phase. Each update moves the grid's
    probabilities on by the time that has passed and weighs them by the frame's density; both are exact sums. What the
    walker does differently from the style is learned on the way: a departure that repeats with the cycle and a residual
    that fades (`style_core.locomotion.personal`). Because that residual is correlated in time, a frame counts for less
    than an independent one would, by its age since the last.

    Parameters
    ----------
    model : LocomotionModel
    joint_names : sequence of str, optional
        Channels to follow, of those a cycle repeats (`FeatureMap.plain`); default: all joint angles, without the root.

    Raises
    ------
    ModelError
        If there is none, or one that does not repeat.

    Notes
    -----
    `Estimate.style` holds the probabilities of the C styles; ``behaviours`` the same by name.
    """

    def __init__(self, model, joint_names=None):
        plain = model.features.plain
        if joint_names is None:
            joint_names = [name for name, repeats, unit in zip(model.joint_names, plain, model.features.units)
                           if repeats and unit == 'rad']
        repeating = {name: column for column, name in enumerate(model.joint_names) if plain[column]}
        wrong = [name for name in joint_names if name not in repeating]
        if wrong or not joint_names:
            raise ModelError(f'the cycles of the model do not hold {", ".join(wrong) or "any joint angle"}')
        columns = np.array([repeating[name] for name in joint_names])
        self.joint_names = tuple(model.joint_names[i] for i in columns)
        self.style_names = model.style_names
        self._border = border_of(model.features.space, self.joint_names)
        self.orders = None if model.features.space is None else model.features.space.orders
        n_positions = model.n_positions
        self._grid = 2 * np.pi * np.arange(n_positions) / n_positions
        shapes = prototypes(model)
        self._cycles = np.ascontiguousarray(shapes.pose(self._grid)[:, :, columns])
        self._noise = model.noise[:, columns] + model.variance[:, :, columns].mean(axis=1)
        self._personal = Personal(*(value[columns] for value in vars(model.personal).values()))
        self._rate_hz = model.rate_hz
        self._weights = model.weights
        # speeds (C, S), rad/s
        self._speeds = (2 * np.pi / model.periods_s)[:, None] * _SPEEDS
        # what a person nobody has seen may differ by, before it is known
        nothing = np.zeros((n_positions, len(columns)))
        self._stranger = departure(self._personal, nothing, nothing).variance.mean(axis=0)
        self._observation = ObservationChecker(len(columns))
        self._doubts = Doubt(len(columns))
        self.reset()

    def _reset(self):
        self._observation.reset()
        self._forget()

    def _forget(self):
        self._doubts.reset()
        n_styles = len(self._speeds)
        n_positions, n_joints = self._cycles.shape[1:]
        near = np.exp(-0.5 * (np.log(_SPEEDS) / 0.25)**2)
        self._prob = (
            np.repeat((self._weights[:, None] * near / near.sum())[:, :, None], n_positions, axis=2) / n_positions
        )
        self._seen_s = 0.0
        self._strain = 1.0
        self._count = np.zeros((n_styles, n_positions, n_joints))
        self._total = np.zeros((n_styles, n_positions, n_joints))
        self._own = self._cycles.copy()         # the walker's own cycles: style and departure
        self._own_square = self._own**2
        self._own_slope = self._slopes(self._own)
        self._doubt = np.zeros((n_positions, n_joints))
        self._excess = 1.0
        self._personal_time = -np.inf
        self._rest = np.zeros(n_joints)
        self._rest_variance = self._personal.noise.copy()

    def _update(self, time, y, mask):
        first = self._observation.time is None
        elapsed = self._observation.check(time, y, mask)
        y, seen = self._observation.y, self._observation.flags()
        if first:
            elapsed = 1 / self._rate_hz
        else:
            # after minutes nothing is known of the phase, and steps stay numbers that can be counted
            self._prob = self._moved(self._prob, min(elapsed, 600.0))
        fade = self._personal.memory**(elapsed * self._rate_hz)
        self._rest *= fade
        self._rest_variance = fade**2 * self._rest_variance + (1 - fade**2) * self._excess * self._personal.noise
        expected, spread = self._mixture(self._prob.sum(axis=1).reshape(-1))
        innovation, log_likelihood = float('nan'), 0.0
        if seen.any():
            seen = self._believed(y, seen, expected, spread, elapsed)
        if self._doubts.out_s > FAREWELL_S:     # nothing fits any more: start anew, at the same time
            self._forget()
            seen = self._observation.flags()
            expected, spread = self._mixture(self._prob.sum(axis=1).reshape(-1))
        if seen.any():
            gap = (y - expected - self._rest)[seen]
            innovation = float(np.mean(gap**2 / (spread + self._rest_variance)[seen]))
            misfit = np.mean((y - expected)[seen]**2 / (spread + self._personal.noise)[seen])
            log_likelihood = self._weigh(y, seen, fade)
            # after a gap of g frames the average has forgotten all the more
            keep = np.exp(-elapsed / 0.5)
            self._strain = keep * self._strain + (1 - keep) * min(innovation, 100.0)
            slow = np.exp(-elapsed / 1.0)
            self._excess = max(1.0, slow * self._excess + (1 - slow) * min(misfit, 100.0))
            self._seen_s += min(elapsed, 0.1)
            self._learn(y, seen, fade)
            expected, spread = self._mixture(self._prob.sum(axis=1).reshape(-1))
            self._keep_rest(y, seen, expected)
        return self._estimate(expected, spread, seen, innovation, log_likelihood)

    def _believed(self, y, seen, expected, spread, elapsed):
        """Which joints of an observation to believe (`style_core.outliers`)."""
        doubt, gap, tracking = self._doubts, y - expected - self._rest, self._status() is Status.TRACKING
        variance = spread + self._rest_variance + (0.0 if tracking else self._stranger)
        believed = doubt.judge(y, gap, variance, seen, elapsed, tracking or doubt.out_s > 0)
        if doubt.moved.any():
            self._rest_variance = np.where(doubt.moved, self._rest_variance + gap**2, self._rest_variance)
        return believed

    def _predict(self, horizons):
        horizons = np.asarray(horizons, dtype=float)
        if horizons.ndim != 1 or not np.isfinite(horizons).all() or (horizons < 0).any():
            raise ValueError('horizons must be a one-dimensional array of finite times >= 0')
        size = self._prob[:, 0].size
        kept = np.flatnonzero(self._prob > 1e-6 * self._prob.max())
        prob = self._prob.reshape(-1)[kept]
        prob = prob / prob.sum()
        style, speed, position = np.unravel_index(kept, self._prob.shape)
        n_positions = len(self._grid)
        rate = self._speeds[style, speed]
        # every cell moves on by its own speed and is split between the two nearest phases, at every horizon (H, cells)
        steps = position + rate * (horizons[:, None] * n_positions / (2 * np.pi))
        whole = np.floor(steps)
        part = steps - whole
        first = (whole % n_positions).astype(np.intp)
        base = np.arange(len(horizons))[:, None] * size + style * n_positions
        cells = np.concatenate([base + first, base + (first + 1) % n_positions], axis=1).reshape(-1)
        share = np.concatenate([(1 - part) * prob, part * prob], axis=1)
        weight, pushed = (np.bincount(cells, value.reshape(-1), len(horizons) * size).reshape(-1, size)
                          for value in (share, share * np.concatenate([rate, rate])))
        own, square, slope = (table.reshape(size, -1) for table in (self._own, self._own_square, self._own_slope))
        expected = weight @ own
        spread = np.maximum(weight @ square - expected**2, 0.0) \
            + weight.reshape(-1, len(self._own), n_positions).sum(axis=1) @ self._doubt
        log_memory = np.log(np.maximum(self._personal.memory, 1e-30)) * self._rate_hz
        fade = np.exp(log_memory * np.minimum(horizons, 1e6)[:, None])
        noise = (1 - fade**2) * self._excess * self._personal.noise
        return Prediction((self._observation.time or 0.0) + horizons, expected + fade * self._rest,
                          np.sqrt(spread + fade**2 * self._rest_variance + noise),
                          pushed @ slope + log_memory * fade * self._rest)

    # the grid -----------------------------------------------------------------------------------------------------

    def _shifted(self, prob, elapsed):
        """Probabilities (C, S, M) moved on by each cell's speed, split between the two nearest phases."""
        n_positions = prob.shape[2]
        steps = self._speeds * (elapsed * n_positions / (2 * np.pi))
        whole = np.floor(steps).astype(int)
        part = (steps - whole)[:, :, None]
        index = (np.arange(n_positions) - whole[:, :, None]) % n_positions
        near = np.take_along_axis(prob, index, axis=2)
        return (1 - part) * near + part * np.roll(near, 1, axis=2)

    def _moved(self, prob, elapsed):
        """Shift, then let phase wander and speed and style change."""
        prob = self._shifted(prob, elapsed)
        cell = 2 * np.pi / prob.shape[2]
        # one step of a lazy walk on the ring; splitting between cells has spread the phase by itself already
        wander = min(0.25, 0.5 * _WANDER**2 * elapsed / cell**2)
        prob = prob + wander * (np.roll(prob, 1, axis=2) + np.roll(prob, -1, axis=2) - 2 * prob)
        change = 0.5 * (1 - np.exp(-_SPEED_RATE * elapsed))
        inner = change * np.diff(prob, axis=1)
        prob[:, :-1] += inner
        prob[:, 1:] -= inner
        other = 1 - np.exp(-_STYLE_RATE * elapsed)
        return (1 - other) * prob + other * self._weights[:, None, None] * prob.sum(axis=0)

    def _mixture(self, weight):
        """Mean and variance (D,) of the walker's own cycles under probabilities (C M,), without the fading residual."""
        kept = np.flatnonzero(weight > 1e-7)
        share = weight[kept] / weight[kept].sum()
        rows = self._own.reshape(len(weight), -1)[kept]
        mean = share @ rows
        doubt = share @ self._doubt[kept % len(self._grid)]
        return mean, share @ (rows - mean)**2 + doubt

    def _weigh(self, y, seen, fade):
        """Weigh the grid by the frame; returns the log density of the frame (its own, not discounted)."""
        variance = self._noise if self._personal_time == -np.inf else \
            np.minimum(self._noise, self._personal.noise + self._doubt.mean(axis=0))
        gain = np.where(seen, 1 / variance, 0.0)                                    # (C, D)
        # full and discounted distances to every cell by products with the cycles and their squares
        gains = np.stack([gain, gain * ((1 - fade) / (1 + fade))], axis=2)          # (C, D, 2)
        y = np.where(seen, y, 0.0)[:, None]
        distance = self._own_square @ gains - 2 * (self._own @ (gains * y)) + (gains * y * y).sum(axis=1)[:, None]
        # a style is weighed by its density: without the determinant the one with the widest noise would fit best
        constant = np.stack([np.ones_like(fade), (1 - fade) / (1 + fade)]) @ (seen * np.log(2 * np.pi * variance)).T
        density = -0.5 * (distance + constant.T[:, None, :])
        with np.errstate(divide='ignore'):
            whole = np.log(self._prob.sum(axis=1)) + density[:, :, 0]
        top = whole.max()
        score = density[:, :, 1]
        prob = self._prob * np.exp(score - score.max())[:, None, :]
        # a floor of one in a million keeps the way back open after a change that the model calls impossible
        floor = 1e-6 / prob.size
        self._prob = (prob / prob.sum() + floor) / (1 + floor * prob.size)
        return float(top + np.log(np.exp(whole - top).sum()))

    def _slopes(self, cycles):
        """Derivative by phase of cycles (..., M, D), central on the ring; per rad."""
        return (np.roll(cycles, -1, axis=-2) - np.roll(cycles, 1, axis=-2)) / (2 * self._grid[1])

    # the walker ---------------------------------------------------------------------------------------------------

    def _learn(self, y, seen, fade):
        """Collect the walker's residuals about each style's cycle and, now and then, its departure from them."""
        if self._status() is not Status.TRACKING:
            return
        weight = self._prob.sum(axis=1)
        style = int(weight.sum(axis=1).argmax())
        share = weight[style]
        # frames at the model's rate count one; the correlation in time is in `departure`
        worth = (1 - fade) / (1 + fade) / self._personal.frame_weight * seen
        self._count[style] += share[:, None] * worth
        self._total[style] += (
            share[:, None] * (worth * np.where(seen, y, 0.0)) - share[:, None] * worth * self._cycles[style]
        )
        if self._observation.time - self._personal_time < _PERSONAL_EVERY_S:
            return
        self._personal_time = self._observation.time
        found = departure(self._personal, self._count[style], self._total[style])
        self._own[style] = self._cycles[style] + found.mean
        self._own_square[style] = self._own[style]**2
        self._own_slope[style] = self._slopes(self._own[style])
        self._doubt = found.variance

    def _keep_rest(self, y, seen, expected):
        """Scalar Kalman update of each seen joint's fading residual."""
        sensor = _SENSOR_SHARE * self._personal.noise
        gain = np.where(seen, self._rest_variance / (self._rest_variance + sensor), 0.0)
        self._rest += gain * np.where(seen, y - expected - self._rest, 0.0)
        self._rest_variance = (1 - gain)**2 * self._rest_variance + gain**2 * sensor

    def _status(self):
        phases = self._prob.sum(axis=(0, 1))
        if self._doubts.out_s > 0 or self._strain > _LOST:
            return Status.LOST
        if self._seen_s < _WARM_UP_S or abs(phases @ np.exp(1j * self._grid)) < _CONCENTRATION:
            return Status.ACQUIRING
        return Status.TRACKING

    def _estimate(self, expected, spread, seen, innovation, log_likelihood):
        phases = self._prob.sum(axis=(0, 1))
        mean = phases @ np.exp(1j * self._grid)
        phase = float(np.angle(mean) % (2 * np.pi))
        off = (self._grid - phase + np.pi) % (2 * np.pi) - np.pi
        by_speed = self._prob.sum(axis=2)
        velocity = float((by_speed * self._speeds).sum())
        swing = self._speeds - velocity
        cross = float((self._prob * swing[:, :, None] * off).sum())
        covariance = np.array([[phases @ off**2, cross], [cross, (by_speed * swing**2).sum()]])
        styles = self._prob.sum(axis=(1, 2))
        styles = styles / styles.sum()
        return Estimate(
            self._observation.time, phase, velocity, covariance, styles, np.diag(styles) - np.outer(styles, styles),
            expected + self._rest, np.sqrt(spread + self._rest_variance), seen, innovation, log_likelihood,
            self._status(), dict(zip(self.style_names, map(float, styles))))


def fill_causally(model, motion):
    """Fill missing values of a recording frame by frame, each from the past alone.

    Parameters
    ----------
    model : LocomotionModel
    motion : Motion
        With the model's joints. Root travel is not filled, as in `style_core.locomotion.infer.fill`.

    Returns
    -------
    filled : Motion
        The same frames and joints, no value changed that was there.
    std : ndarray, shape (T, D)
        Standard deviation of the filled values, 0 where observed.
    """
    motion = fillable(model, motion)
    columns = np.flatnonzero(model.features.plain)
    predictor = LocomotionPredictor(model, [model.joint_names[i] for i in columns])
    positions, std = motion.positions.copy(), np.zeros(motion.positions.shape)
    for i, (time, y) in enumerate(zip(motion.times, motion.positions[:, columns])):
        found = predictor.update(time, y)
        missing = np.isnan(y)
        positions[i, columns] = np.where(missing, found.mean, y)
        std[i, columns] = np.where(missing, found.std, 0.0)
    return replace(motion, positions=positions), std
