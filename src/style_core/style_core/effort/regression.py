"""Regression of effort from what was blended and how (section 6, table 1)."""
import itertools

import numpy as np
from scipy.spatial.distance import cdist
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import Ridge
from sklearn.multioutput import MultiOutputRegressor
from sklearn.svm import SVR

from style_core.errors import ModelError, UsageError

__all__ = ['METHODS', 'features', 'fit_regression', 'LinearInterpolation']

#: methods of table 1 of the paper, in its order
METHODS = ('linear-interpolation', 'linear-ridge', 'kernel-ridge', 'support-vectors')

_FOLDS = 10
_ESTIMATORS = {
    'linear-ridge': Ridge,
    'kernel-ridge': lambda **chosen: KernelRidge(kernel='rbf', **chosen),
    'support-vectors': lambda **chosen: MultiOutputRegressor(SVR(kernel='rbf', epsilon=0.1, **chosen)),
}
_GRIDS = {
    'linear-ridge': {'alpha': [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]},
    'kernel-ridge': {'alpha': [0.001, 0.01, 0.1, 1.0, 10.0], 'gamma': [0.001, 0.003, 0.01, 0.03, 0.1, 0.3]},
    'support-vectors': {'C': [0.1, 1.0, 10.0, 100.0], 'gamma': [0.001, 0.003, 0.01, 0.03, 0.1, 0.3]},
}


def features(contents, efforts, first, second, alpha):
    """Regression inputs z = [c_i, c_j, e_i, e_j, alpha].

    Parameters
    ----------
    contents : ndarray, shape (N, K)
    efforts : ndarray, shape (N, 3)
    first, second : array_like of int, shape (M,)
    alpha : array_like, shape (M,)

    Returns
    -------
    ndarray, shape (M, 2 K + 7)
    """
    alpha = np.asarray(alpha, dtype=float)
    return np.column_stack([contents[first], contents[second], efforts[first], efforts[second], alpha])


class LinearInterpolation:
    """Effort of a blend = blend of the efforts: what earlier work assumed, and the baseline of table 1."""

    def predict(self, z):
        """Return (1 - alpha) e_i + alpha e_j, shape (M, 3)."""
        alpha = z[:, -1:]
        return (1 - alpha) * z[:, -7:-4] + alpha * z[:, -4:-1]


class _PerEffort:
    """One function an effort factor, on standardised inputs and around the mean effort."""

    def __init__(self, functions, centre, spread, mean):
        self.functions = functions
        self.centre, self.spread, self.mean = centre, spread, mean

    def predict(self, z):
        inputs = (z - self.centre) / self.spread
        return np.column_stack([function(inputs) for function in self.functions]) + self.mean


def _function_of(model):
    """The function (M, P) -> (M,) that an estimator fitted to one effort is.

    A choice asks for thirty values at a time and forty times over; scikit-learn's checks of its input would take most
    of the time.
    """
    if isinstance(model, Ridge):
        return lambda inputs: inputs @ model.coef_.reshape(-1) + model.intercept_
    if isinstance(model, KernelRidge):
        support, weights, gamma, offset = model.X_fit_, model.dual_coef_.reshape(-1), model.gamma, 0.0
    else:
        (machine,) = model.estimators_
        support, weights, gamma, offset = machine.support_vectors_, machine.dual_coef_[0], machine.gamma, \
            machine.intercept_[0]
    return lambda inputs: np.exp(-gamma * cdist(inputs, support, 'sqeuclidean')) @ weights + offset


def fit_regression(method, z, efforts, settings=None, seed=0):
    """Fit f of equation (1).

    Parameters
    ----------
    method : str
        One of `METHODS`.
    z : ndarray, shape (M, P)
        See `features`.
    efforts : ndarray, shape (M, 3)
    settings : list of dict, optional
        Hyperparameters of each effort factor; chosen by tenfold cross-validation where not given.
    seed : int
        Of the folds.

    Returns
    -------
    model
        With ``predict(z) -> (M, 3)``.
    settings : list of dict
        Hyperparameters used (empty for linear interpolation, which has none).

    Raises
    ------
    UsageError
        For an unknown method.
    ModelError
        If there are fewer than ten examples.
    """
    if method not in METHODS:
        raise UsageError(f'unknown regression method {method!r}: choose among {", ".join(METHODS)}')
    if method == 'linear-interpolation':
        return LinearInterpolation(), []
    if len(z) < _FOLDS:
        raise ModelError(f'{method} needs at least {_FOLDS} labelled interpolations, got {len(z)}')
    centre, spread = z.mean(axis=0), z.std(axis=0)
    spread = np.where(spread > 1e-12, spread, 1.0)
    mean = efforts.mean(axis=0)
    inputs, targets = (z - centre) / spread, efforts - mean
    if settings is None:
        settings = _chosen(method, inputs, targets, seed)
    models = [_ESTIMATORS[method](**chosen).fit(inputs, targets[:, [effort]])
              for effort, chosen in enumerate(settings)]
    return _PerEffort([_function_of(model) for model in models], centre, spread, mean), \
        [dict(chosen) for chosen in settings]


def _chosen(method, inputs, targets, seed):
    """Settings of each effort factor with the least squared error in tenfold cross-validation."""
    order = np.random.default_rng(seed).permutation(len(inputs))
    folds = np.array_split(order, _FOLDS)
    grid = [dict(zip(_GRIDS[method], values)) for values in itertools.product(*_GRIDS[method].values())]
    errors = np.zeros((len(grid), 3))
    for held in folds:
        rest = np.setdiff1d(order, held)
        for row, chosen in enumerate(grid):
            model = _ESTIMATORS[method](**chosen).fit(inputs[rest], targets[rest])
            errors[row] += np.sum((model.predict(inputs[held]) - targets[held])**2, axis=0)
    return [grid[row] for row in errors.argmin(axis=0)]
