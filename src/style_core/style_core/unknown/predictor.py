"""A predictor that knows what it does not know."""
import numpy as np

from style_core.phase_style.settings import GAP_S
from style_core.predictor import Status
from style_core.unknown.forecasts import SCORED, Forecasts
from style_core.unknown.short_range import FRAME_S, LEADS, cubic, read_short_range

__all__ = ['STILL', 'UNKNOWN', 'OpenPredictor']

#: Names of the two behaviours that need no model.
STILL, UNKNOWN = 'still', 'unknown'
#: Trust is the model's weight this many frames ahead: far enough for dynamics alone to be of little use.
TRUST_LEAD = SCORED.index(11)
#: Below the first the motion is unknown, above the second it is known again.
DOUBT, TRUST = 0.3, 0.7
#: A status worse than the present one holds once it has lasted for the first of these, a better one for the second, s.
WORSE_S, BETTER_S = 0.1, 0.5
_LEADS_S = np.array(SCORED) * FRAME_S
_EACH = np.arange(len(SCORED), dtype=np.int32), np.zeros(len(SCORED))


class OpenPredictor:
    """Any predictor, beside short-range dynamics that hold for all motion.

    Fulfils `style_core.predictor.OnlinePredictor`. Predictions are the combination of both that lately would have been
    best (`style_core.unknown.forecasts.Forecasts`), so what no model explains is predicted as well as can be without
    one. An estimate is the model's, with the behaviours ``unknown`` and ``still`` beside the model's own, and with the
    status UNKNOWN while the model's predictions are worth less than dynamics alone. A person who stands still is
    predicted to go on doing so.

    Parameters
    ----------
    first : OnlinePredictor
        Of a model.
    behaviour : str
        Name of the model's only behaviour, for models that give no probabilities.
    dynamics : ShortRange, optional
        Those that come with the package by default.
    """

    def __init__(self, first, behaviour, dynamics=None):
        self.joint_names = first.joint_names
        self.orders = getattr(first, 'orders', None)    # in which joints with three angles turn
        self._first = first
        self._forecasts = Forecasts(len(first.joint_names), read_short_range() if dynamics is None else dynamics)
        self._only = {behaviour: 1.0}
        self._asked = None      # horizons asked for last, and what follows from them
        self._forget()

    def reset(self):
        """Forget everything observed."""
        self._first.reset()
        self._forget()

    def _forget(self):
        self._forecasts.reset()
        self._time, self._known, self._searching = None, True, False
        self._stopped = None    # phase at which the person came to stand
        self._status, self._other, self._since = Status.ACQUIRING, Status.ACQUIRING, -np.inf

    def update(self, time, y, mask=None):
        """Take one observation (see `OnlinePredictor.update`)."""
        if self._forecasts.wanted:      # nobody has asked for a prediction that holds them
            made = self._first.predict(_LEADS_S)
            self._forecasts.keep(np.ascontiguousarray(made.mean), np.ascontiguousarray(made.std), *_EACH)
        estimate = self._first.update(time, y, mask)
        if self._time is not None and time - self._time > GAP_S:
            self._forget()
        self._time = time
        if self._searching and estimate.status == Status.TRACKING:
            self._forecasts.forgive()
        self._searching = estimate.status == Status.ACQUIRING
        self._forecasts.observe(time, np.asarray(y, dtype=float), estimate.observed.view(np.uint8))
        return self._judged(estimate)

    def _judged(self, estimate):
        """The estimate with what is known of the behaviour."""
        trust = float(self._forecasts.weight[TRUST_LEAD])
        self._known = trust > (DOUBT if self._known else TRUST)
        shares, changed = estimate.behaviours or self._only, {}
        status = estimate.status if self._known else Status.UNKNOWN
        if self._forecasts.still:
            self._stopped = estimate.phase if self._stopped is None else self._stopped
            behaviours = dict.fromkeys((*shares, UNKNOWN), 0.0)
            behaviours[STILL] = 1.0
            changed = {'phase': self._stopped, 'phase_velocity': 0.0 * estimate.phase_velocity}
            status = Status.TRACKING
        else:
            self._stopped = None
            behaviours = {name: trust * share for name, share in shares.items()}
            behaviours[UNKNOWN] = 1.0 - trust
        # in place: the estimate was made for this observation, and a copy takes as long as all of the above
        estimate.__dict__.update(changed, behaviours=behaviours, status=self._steady(estimate.time, status))
        return estimate

    def _steady(self, time, status):
        """The status that holds: a new one has to last."""
        if status != self._other:
            self._other, self._since = status, time
        wait = BETTER_S if status == Status.TRACKING and self._status != Status.ACQUIRING else WORSE_S
        if status != self._status and (time - self._since >= wait or self._status == Status.ACQUIRING):
            self._status = status
        return self._status

    def predict(self, horizons):
        """Predict ``horizons`` s ahead (see `OnlinePredictor.predict`)."""
        model = self._first.predict(horizons)
        if self._time is None:
            return model
        if not np.array_equal(self._asked, horizons):
            self._asked = np.array(horizons, dtype=float)
            self._places, self._basis = places(self._asked), basis(self._asked)
        if self._forecasts.wanted and self._places is not None:
            self._forecasts.keep(model.mean, model.std, *self._places)
        self._forecasts.combine(self._asked, *self._basis, model.mean, model.std, model.velocity)
        return model


def places(horizons):
    """Where the leads that are scored lie among horizons.

    Returns
    -------
    low : ndarray of int32, shape (L,)
        Each lies between this horizon and the next,
    share : ndarray, shape (L,)
        at this share of the way. None in place of both where one lies outside, or between horizons farther apart than
        two frames.
    """
    if len(horizons) < 2 or np.any(np.diff(horizons) <= 0):
        return None
    if horizons[0] > _LEADS_S[0] + 1e-9 or horizons[-1] < _LEADS_S[-1] - 1e-9:
        return None
    low = np.clip(np.searchsorted(horizons, _LEADS_S + 1e-9, side='right') - 1, 0, len(horizons) - 2)
    width = horizons[low + 1] - horizons[low]
    if np.any(width > 2 * FRAME_S + 1e-9):
        return None
    return low.astype(np.int32), (_LEADS_S - horizons[low]) / width


def basis(horizons):
    """Interpolation from the angle now and `LEADS` to horizons (see `cubic`)."""
    return cubic(np.concatenate([[0.0], np.array(LEADS) * FRAME_S]), horizons)
