"""Two predictors stacked: the mean of both with weights by horizon, learned on people left out of the training.

A filter and a memory of what training motion did next are wrong in different ways, so their mean is better than either.
The memory has to be carried along (it is recorded motion), which is why stacking is an option and not the default.
"""
import numpy as np

from style_core.predictor import Prediction

__all__ = ['Stacked', 'stacking_weights']


def stacking_weights(first, second, groups):
    """Weights of a second predictor beside a first that minimise the squared error, by horizon.

    Parameters
    ----------
    first, second : sequence of ndarray, each (N_i, H, D)
        Errors of both predictors on recordings that neither was trained on.
    groups : sequence
        Who each recording is from; everyone counts the same, however many recordings there are.

    Returns
    -------
    weight : ndarray, shape (H,)
        Of the second, in [0, 1].
    spread : ndarray, shape (H,)
        Root mean square error of the stack relative to the first's.
    """
    groups = np.asarray(groups)
    share = np.array([1.0 / np.sum(groups == group) for group in groups])
    share /= share.sum()
    own, both, other = (sum(w * np.mean(a * b, axis=(0, 2)) for w, a, b in zip(share, left, right))
                        for left, right in ((first, first), (first, second), (second, second)))
    apart = np.maximum(own - 2.0 * both + other, 1e-300)  # mean square of the difference of the two
    weight = np.clip((own - both) / apart, 0.0, 1.0)
    stacked = (1 - weight) ** 2 * own + 2 * weight * (1 - weight) * both + weight ** 2 * other
    return weight, np.sqrt(stacked / np.maximum(own, 1e-300))


class Stacked:
    """Predicts the weighted mean of two predictors; everything else is the first's.

    Parameters
    ----------
    first, second : OnlinePredictor
        With the same joints in the same order.
    horizons : ndarray, shape (H,)
        S, increasing; weights in between are interpolated.
    weight, spread : ndarray, shape (H,)
        As `stacking_weights` returns them.

    Raises
    ------
    ValueError
        If the joints differ.
    """

    def __init__(self, first, second, horizons, weight, spread):
        if tuple(first.joint_names) != tuple(second.joint_names):
            raise ValueError('stacked predictors need the same joints in the same order')
        self.joint_names = first.joint_names
        self._first, self._second = first, second
        # nothing is gained at once: at horizon zero the first predictor's own pose stands
        self._horizons = np.concatenate([[0.0], horizons])
        self._weight = np.concatenate([[0.0], weight])
        self._spread = np.concatenate([[1.0], spread])

    def reset(self):
        """Forget everything observed."""
        self._first.reset()
        self._second.reset()

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`); the estimate is the first predictor's."""
        estimate = self._first.update(time, y, mask)
        self._second.update(time, y, mask)
        return estimate

    def predict(self, horizons):
        """Predict ``horizons`` s ahead (see `OnlinePredictor.predict`)."""
        horizons = np.asarray(horizons, dtype=float)
        one, two = self._first.predict(horizons), self._second.predict(horizons)
        weight = np.interp(horizons, self._horizons, self._weight)[:, None]
        spread = np.interp(horizons, self._horizons, self._spread)[:, None]
        return Prediction(times=one.times, mean=(1 - weight) * one.mean + weight * two.mean, std=spread * one.std,
                          velocity=(1 - weight) * one.velocity + weight * two.velocity)
