"""The style machine as an on-line predictor: filtering over states and styles from whatever joints are observed."""
import numpy as np

from style_core.joint_space.online import InJointSpace, border_of
from style_core.outliers import FAREWELL_S, Doubt
from style_core.phase_style.observation import ObservationChecker
from style_core.predictor import Estimate, Prediction, Status
from style_core.style_machine.analysis import joint_gaussians
from style_core.style_machine.emission import interpolate

__all__ = ['StyleMachinePredictor']

_OFFSET_GAIN = 0.02          # of the slow posture offset, a frame
_STYLE_MEMORY = 0.995        # a frame: how long evidence for a style counts
_ACQUIRED_FRAMES = 15.0
_LOST_INNOVATION = 25.0
_TABLES = 8                  # sensor patterns whose whitening matrices are kept
_SENSOR_SHARE = 0.02         # of a residual's variance: what remains unknown of a joint that was just measured
_FAR = 3.0                   # standard deviations of a joint that count at most for its posture
_SAYS_AT_MOST = 10.0         # nats by which one observation can speak against a style


class StyleMachinePredictor(InJointSpace):
    """Filter the hidden states of every training style (and the generic model) and predict by their transitions.

    Beside the state a slow offset of each joint (posture the styles do not know) and the residual of the last
    frame, which decays with the persistence learned in training, carry over into predictions.

    The model has no phase: ``phase`` and its covariance are NaN. ``behaviours`` holds the styles' probabilities.

    Parameters
    ----------
    machine : StyleMachine
    """

    def __init__(self, machine):
        self.machine = machine
        self.joint_names = machine.joint_names
        self._names = ['generic', *machine.styles]
        emissions = [machine.generic, *(machine.at(v) for v in machine.styles.values())]
        emissions = [interpolate(one, emissions[0], 0.1) for one in emissions]  # wider: others than those seen come
        gaussians = [joint_gaussians(machine, one) for one in emissions]
        self._means = np.concatenate([means for means, _ in gaussians])
        self._covs = np.concatenate([covs for _, covs in gaussians])
        self._variances = np.einsum('nii->ni', self._covs).copy()
        self._coordinates = np.array([np.zeros(machine.dof), *machine.styles.values()])
        self._patterns = {}
        self._observation = ObservationChecker(len(self.joint_names))
        self._doubts = Doubt(len(self.joint_names))
        self._border = border_of(machine.space, machine.joint_names)
        self.orders = machine.orders
        self.reset()

    def _reset(self):
        self._observation.reset()
        self._forget()

    def _forget(self):
        self._doubts.reset()
        n, count = self.machine.n_states, len(self._names)
        self._belief = np.tile(self.machine.start, (count, 1))
        self._score = np.zeros(count)
        self._offset = np.zeros(len(self.joint_names))
        self._residual = np.zeros(len(self.joint_names))
        # share of each joint's residual variance that is not known
        self._unknown = np.ones(len(self.joint_names))
        self._frames, self._innovation, self._n = 0.0, 1.0, n

    def _pattern(self, seen):
        key = seen.tobytes()
        if key not in self._patterns:
            if len(self._patterns) >= _TABLES:
                self._patterns.pop(next(iter(self._patterns)))
            covs = self._covs[:, seen][:, :, seen]
            lower = np.linalg.cholesky(covs)
            white = np.linalg.inv(lower)
            offset = np.einsum('nij,nj->ni', white, self._means[:, seen])
            constant = -0.5 * seen.sum() * np.log(2 * np.pi) - np.log(np.einsum('nii->ni', lower)).sum(axis=1)
            self._patterns[key] = (white.reshape(-1, int(seen.sum())), offset, constant)
        return self._patterns[key]

    def _update(self, time, y, mask):
        first = self._observation.time is None
        elapsed = self._observation.check(time, y, mask)
        y, seen = self._observation.y, self._observation.flags()
        frames = 1.0 if first else elapsed * self.machine.rate_hz
        if not first:
            self._belief = self._propagate(self._belief, frames)
        self._frames += min(frames, 1.0)
        if seen.any():
            seen = self._believed(y, seen, frames)
        if self._doubts.out_s > FAREWELL_S:     # nothing fits any more: start anew, at the same time
            self._forget()
            seen = self._observation.flags()
        likelihood, innovation = 0.0, float('nan')
        persistence = self.machine.persistence
        # residuals are correlated in time: an observation says as much as its share of a frame, and of a new residual
        share = min(frames, 1.0)
        if seen.any():
            white, offset, constant = self._pattern(seen)
            z = (white @ (y - self._offset)[seen]).reshape(len(offset), -1) - offset
            square = np.einsum('ni,ni->n', z, z)
            density = (constant - 0.5 * square).reshape(self._belief.shape)
            peak = density.max()
            scaled = np.exp((density - peak) * share * _tempering(persistence[seen]))
            joint = self._belief * scaled
            sums = joint.sum(axis=1)
            if not (sums > 0).all():  # a style without any state left starts over
                joint = np.where((sums > 0)[:, None], joint, scaled + 1e-300)
                sums = joint.sum(axis=1)
            weights = self._style_weights()
            likelihood = float(np.log(weights @ sums) + peak)
            said = np.log(sums)
            self._score = _STYLE_MEMORY ** frames * self._score + np.maximum(said, said.max() - _SAYS_AT_MOST)
            self._belief = joint / sums[:, None]
            posterior = self._posterior()
            innovation = float(posterior.ravel() @ square) / int(seen.sum())
            self._innovation += 0.1 * share * (min(innovation, 100.0) - self._innovation)
            mean = posterior.ravel() @ self._means
            # what lies far out says little about the posture: one wild sample must not be remembered for seconds
            most = _FAR * np.sqrt(self._spread(posterior.ravel(), mean))
            gap = np.where(seen, np.clip(y - mean - self._offset, -most, most), 0.0)
            self._offset += _OFFSET_GAIN * share * gap
        else:
            posterior = self._posterior()
            mean = posterior.ravel() @ self._means
        decay = persistence ** min(frames, 1e3)
        self._residual = np.where(seen, y - mean - self._offset, decay * self._residual)
        self._unknown = np.where(seen, _SENSOR_SHARE, 1 - decay**2 * (1 - self._unknown))
        flat = posterior.ravel()
        spread = self._spread(flat, mean)
        v = posterior.sum(axis=1) @ self._coordinates
        gaps = self._coordinates - v
        nan = float('nan')
        return Estimate(
            self._observation.time, nan, nan, np.full((2, 2), nan), v, (gaps * posterior.sum(axis=1)[:, None]).T @ gaps,
            mean + self._offset + self._residual, np.sqrt(self._unknown * spread), seen, innovation, likelihood,
            self._status(), dict(zip(self._names, posterior.sum(axis=1).tolist())))

    def _status(self):
        if self._frames < _ACQUIRED_FRAMES:
            return Status.ACQUIRING
        elsewhere = self._doubts.out_s > 0 or self._innovation > _LOST_INNOVATION
        return Status.LOST if elsewhere else Status.TRACKING

    def _believed(self, y, seen, frames):
        """Which joints of an observation to believe (`style_core.outliers`)."""
        doubt, flat = self._doubts, self._posterior().ravel()
        mean = flat @ self._means
        decay = self.machine.persistence ** min(frames, 1e3)
        gap = y - mean - self._offset - decay * self._residual
        tracking = self._status() is Status.TRACKING
        variance = self._spread(flat, mean)
        if tracking:    # then most of what a joint differs by from its state is known from the last frame
            variance = variance * (1 - decay**2 * (1 - self._unknown))
        return doubt.judge(y, gap, variance, seen, frames / self.machine.rate_hz,
                           tracking or doubt.out_s > 0)

    def _spread(self, flat, mean):
        """Variance (D,) of the joints under probabilities of the states."""
        return flat @ (self._variances + (self._means - mean) ** 2)

    def _style_weights(self):
        weights = np.exp(self._score - self._score.max())
        return weights / weights.sum()

    def _posterior(self):
        return self._belief * self._style_weights()[:, None]

    def _propagate(self, belief, frames):
        """Beliefs ``frames`` (not necessarily whole) later; far ahead they stay what they have become."""
        whole = int(min(frames, 1000))
        for _ in range(whole):
            belief = belief @ self.machine.trans
        rest = min(frames, 1000) - whole
        return (1 - rest) * belief + rest * (belief @ self.machine.trans) if rest > 1e-9 else belief

    def _predict(self, horizons):
        horizons = np.asarray(horizons, dtype=float)
        if horizons.ndim != 1 or not (np.isfinite(horizons).all() and (horizons >= 0).all()):
            raise ValueError('horizons must be a one-dimensional array of finite times >= 0')
        frames = np.minimum(horizons * self.machine.rate_hz, 1000.0)
        belief, chain = self._posterior(), []
        for _ in range(int(np.ceil(frames.max(initial=0.0))) + 2):
            chain.append(belief.ravel())
            belief = belief @ self.machine.trans
        chain = np.array(chain)
        whole = frames.astype(int)
        part = (frames - whole)[:, None]
        flat = (1 - part) * chain[whole] + part * chain[whole + 1]
        mean = flat @ self._means
        spread = np.maximum(flat @ (self._variances + self._means ** 2) - mean ** 2, 0.0)
        decay = self.machine.persistence ** frames[:, None]
        slope = (chain[whole + 1] - chain[whole]) @ self._means
        fading = np.log(np.maximum(self.machine.persistence, 1e-6)) * decay * self._residual
        return Prediction((self._observation.time or 0.0) + horizons, mean + self._offset + decay * self._residual,
                          np.sqrt((1 - decay ** 2 * (1 - self._unknown)) * spread),
                          (slope + fading) * self.machine.rate_hz)


def _tempering(persistence):
    """Share of an observation that is new: residuals with correlation rho repeat themselves."""
    rho = float(np.mean(persistence))
    return (1 - rho) / (1 + rho) * 2
