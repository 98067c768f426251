"""The style machine as an on-line predictor: filtering over states and styles from whatever joints are observed."""
import numpy as np

from style_core.errors import ModelError
from style_core.joint_space.online import InJointSpace, border_of
from style_core.predictor import Estimate, Prediction, Status
from style_core.style_machine.analysis import joint_gaussians
from style_core.style_machine.emission import interpolate

__all__ = ['StyleMachinePredictor']

_OFFSET_GAIN = 0.02          # of the slow posture offset, a frame
_STYLE_MEMORY = 0.995        # a frame: how long evidence for a style counts
_ACQUIRED_FRAMES = 15.0
_LOST_INNOVATION = 25.0
_TABLES = 8                  # sensor patterns whose whitening matrices are kept


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
        self._coordinates = np.array([np.zeros(machine.dof), *machine.styles.values()])
        self._patterns = {}
        self._border = border_of(machine.space, machine.joint_names)
        self.orders = machine.orders
        self.reset()

    def _reset(self):
        n, count = self.machine.n_states, len(self._names)
        self._belief = np.tile(self.machine.start, (count, 1))
        self._score = np.zeros(count)
        self._offset = np.zeros(len(self.joint_names))
        self._residual = np.zeros(len(self.joint_names))
        self._time, self._frames, self._innovation, self._n = None, 0.0, 1.0, n

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
        y = np.asarray(y, dtype=float)
        d = len(self.joint_names)
        if y.shape != (d,) or (mask is not None and np.shape(mask) != (d,)):
            raise ValueError(f'an observation has shape ({d},), got {y.shape}'
                             + ('' if mask is None else f' with a mask of shape {np.shape(mask)}'))
        if not np.isfinite(time) or (self._time is not None and not time > self._time):
            raise ValueError(f'time must increase: {time} after {self._time}')
        if np.isinf(y).any():
            raise ValueError('an observation is infinite')
        seen = ~np.isnan(y) if mask is None else np.asarray(mask, dtype=bool) & ~np.isnan(y)
        frames = 1.0 if self._time is None else (time - self._time) * self.machine.rate_hz
        if self._time is not None:
            self._belief = self._propagate(self._belief, frames)
        self._time = time
        self._frames += min(frames, 1.0)
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
            self._score = _STYLE_MEMORY ** frames * self._score + np.log(sums)
            self._belief = joint / sums[:, None]
            posterior = self._posterior()
            innovation = float(posterior.ravel() @ square) / int(seen.sum())
            self._innovation += 0.1 * share * (innovation - self._innovation)
            mean = posterior.ravel() @ self._means
            gap = np.where(seen, y - mean - self._offset, 0.0)
            self._offset += _OFFSET_GAIN * share * gap
            decay = persistence ** min(frames, 1e3)
            self._residual = np.where(seen, y - mean - self._offset, decay * self._residual)
        else:
            posterior = self._posterior()
            mean = posterior.ravel() @ self._means
            self._residual = persistence ** min(frames, 1e3) * self._residual
        flat = posterior.ravel()
        spread = flat @ (np.einsum('nii->ni', self._covs) + (self._means - mean) ** 2)
        v = posterior.sum(axis=1) @ self._coordinates
        gaps = self._coordinates - v
        nan = float('nan')
        if self._frames < _ACQUIRED_FRAMES:
            status = Status.ACQUIRING
        else:
            status = Status.LOST if self._innovation > _LOST_INNOVATION else Status.TRACKING
        return Estimate(
            float(time), nan, nan, np.full((2, 2), nan), v, (gaps * posterior.sum(axis=1)[:, None]).T @ gaps,
            mean + self._offset + self._residual, np.where(seen, 0.0, np.sqrt(spread)), seen, innovation, likelihood,
            status, dict(zip(self._names, posterior.sum(axis=1).tolist())))

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
        if self._time is None:
            raise ModelError('nothing observed yet: no prediction')
        horizons = np.asarray(horizons, dtype=float)
        if horizons.ndim != 1 or not (np.isfinite(horizons).all() and (horizons >= 0).all()):
            raise ValueError('horizons must have shape (H,), finite and not negative')
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
        spread = np.maximum(flat @ (np.einsum('nii->ni', self._covs) + self._means ** 2) - mean ** 2, 0.0)
        decay = self.machine.persistence ** frames[:, None]
        slope = (chain[whole + 1] - chain[whole]) @ self._means
        fading = np.log(np.maximum(self.machine.persistence, 1e-6)) * decay * self._residual
        return Prediction(self._time + horizons, mean + self._offset + decay * self._residual,
                          np.sqrt((1 - decay ** 2) * spread + 1e-12), (slope + fading) * self.machine.rate_hz)


def _tempering(persistence):
    """Share of an observation that is new: residuals with correlation rho repeat themselves."""
    rho = float(np.mean(persistence))
    return (1 - rho) / (1 + rho) * 2
