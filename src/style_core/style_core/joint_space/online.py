"""On-line predictors that work in a `JointSpace`: angles in, angles out."""
import numpy as np

from style_core.predictor import Estimate, Prediction

__all__ = ['Border', 'InJointSpace', 'SpacedPredictor', 'border_of']


class Border:
    """Between the angles of sensors and the coordinates of a predictor, sample by sample.

    A ball joint of which some angles are missing counts by the coordinates of those that are there, the others taken as
    last estimated (at home before the first estimate); this is exact to first order about home. Where the joint's
    home is so near the gimbal lock that single angles say nothing (more than 37 degrees of middle angle), the joint
    counts as missing. Angles that come out take the turn and, of equivalent triples, the branch of those observed last.

    Parameters
    ----------
    space : JointSpace
    """

    def __init__(self, space):
        self.space = space
        self._columns = space.columns
        self.reset()

    def reset(self):
        """Forget all samples."""
        self._near = self.space.home.copy()
        self._turns = np.zeros(len(self._near))
        self._seen = np.zeros(len(self._near), dtype=bool)

    def enter(self, y, mask):
        """Coordinates of a sample, and what of it counts.

        Parameters
        ----------
        y : ndarray, shape (D,)
            Rad; NaN is missing.
        mask : ndarray of bool, shape (D,), optional

        Returns
        -------
        ndarray, shape (D,)
            NaN where a coordinate is not observed.
        """
        y = np.array(y, dtype=np.float64)
        if y.shape != self._near.shape or (mask is not None and np.shape(mask) != y.shape):
            raise ValueError(f'an observation has shape {self._near.shape}, got {y.shape}'
                             + ('' if mask is None else f' with a mask of shape {np.shape(mask)}'))
        if mask is not None:
            y[~np.asarray(mask, dtype=bool)] = np.nan
        there = np.isfinite(y)
        self._seen = ~np.isnan(y)
        self._turns = np.where(there, self.space.turns(y), self._turns)
        whole = there[self._columns].all(axis=1)
        partly = np.flatnonzero(there[self._columns].any(axis=1) & ~whole & self.space.apart)
        given = y
        if len(partly):
            columns = self._columns[partly].ravel()
            given = y.copy()
            given[columns] = np.where(there[columns], y[columns], self._near[columns])
        values = self.space.encode(given)
        if len(partly):
            values[columns] = np.where(there[columns], values[columns], np.nan)
        observed = self._columns[whole].ravel()
        self._near[observed] = y[observed]
        return values

    def _decode(self, values, std, velocity=None, near=None):
        found = self.space.decode(values, self._near if near is None else near, std, velocity)
        angles = found[0]
        angles -= self._turns
        return found

    def leave(self, estimate):
        """An estimate in angles. Innovation and log likelihood stay those of the coordinates."""
        mean, std = self._decode(estimate.mean, estimate.std)
        if np.isfinite(mean).all():
            in_ball = self._columns.ravel()
            self._near[in_ball] = mean[in_ball]
        observed = np.asarray(estimate.observed, dtype=bool) & self._seen
        return Estimate(estimate.time, estimate.phase, estimate.phase_velocity, estimate.phase_covariance,
                        estimate.style, estimate.style_covariance, mean, std, observed,
                        estimate.innovation, estimate.log_likelihood, estimate.status, estimate.behaviours)

    def ahead(self, prediction):
        """A prediction in angles; every horizon follows the one before it."""
        return Prediction(prediction.times, *self._decode(prediction.mean, prediction.std, prediction.velocity))


class InJointSpace:
    """What a predictor inherits whose model may have a joint space.

    It sets ``_border`` to a `Border`, or None where its model was learned in angles, and defines ``_update(time, y,
    mask)``, ``_predict(horizons)`` and ``_reset()`` in coordinates.
    """

    _border = None

    def reset(self):
        """Forget everything observed; the next update starts a search."""
        if self._border is not None:
            self._border.reset()
        self._reset()

    def update(self, time, y, mask=None):
        """Take one observation (see `style_core.predictor.OnlinePredictor.update`)."""
        if self._border is None:
            return self._update(time, y, mask)
        return self._border.leave(self._update(time, self._border.enter(y, mask), None))

    def predict(self, horizons):
        """Predict ``horizons`` (H,) s after the last update (see `style_core.predictor.OnlinePredictor.predict`)."""
        found = self._predict(horizons)
        return found if self._border is None else self._border.ahead(found)


class SpacedPredictor(InJointSpace):
    """Any predictor, in a joint space.

    Parameters
    ----------
    predictor : OnlinePredictor
        Of coordinates.
    space : JointSpace
    """

    def __init__(self, predictor, space):
        self.predictor = predictor
        self._border = Border(space.select(predictor.joint_names))
        self.joint_names = predictor.joint_names
        self._update, self._predict, self._reset = predictor.update, predictor.predict, predictor.reset

    @property
    def orders(self):
        """Order in which each joint with three angles turns."""
        return self._border.space.orders


def border_of(space, joint_names):
    """Border of a model's predictor, None where there is nothing to do."""
    space = None if space is None else space.select(joint_names)
    return None if space is None or space.plain else Border(space)
