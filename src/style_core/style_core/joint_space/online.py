"""On-line predictors that work in a `JointSpace`: angles in, angles out."""
from style_core.joint_space.kernels import Border
from style_core.predictor import Estimate, Prediction

__all__ = ['Border', 'InJointSpace', 'SpacedPredictor', 'border_of']


def in_angles(border, estimate):
    """An estimate in angles. Innovation and log likelihood stay those of the coordinates."""
    mean, std = border.leave(estimate.mean, estimate.std)
    changed = Estimate.__new__(Estimate)
    changed.__dict__.update(estimate.__dict__, mean=mean, std=std, observed=border.flags(estimate.observed))
    return changed


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
        return in_angles(self._border, self._update(time, self._border.enter(y, mask), None))

    def predict(self, horizons):
        """Predict ``horizons`` (H,) s after the last update (see `style_core.predictor.OnlinePredictor.predict`)."""
        found = self._predict(horizons)
        if self._border is None:
            return found
        return Prediction(found.times, *self._border.ahead(found.mean, found.std, found.velocity))


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
