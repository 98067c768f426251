"""Load a model for live use: read, build the predictor, put it through its paces."""
from dataclasses import dataclass
from pathlib import Path
from typing import Mapping

from style_core.predictor import OnlinePredictor
from style_core.predictor_file import read_predictor
from style_core.stream.stream import warm_up

__all__ = ['LiveModel', 'load_live']


@dataclass(frozen=True, eq=False)
class LiveModel:
    """A predictor ready for its first message.

    Attributes
    ----------
    name : str
        File name without ending.
    kind : str
    method : str
    predictor : OnlinePredictor
    rhythmic : mapping of str to bool
        Of every behaviour: does it repeat, or go from a start to a goal.
    rate_hz : float
        Of the training sequences.
    """

    name: str
    kind: str
    method: str
    predictor: OnlinePredictor
    rhythmic: Mapping[str, bool]
    rate_hz: float

    def is_discrete(self, estimate):
        """Whether the phase of ``estimate`` runs from start to goal: that of its most probable behaviour."""
        behaviour = max(estimate.behaviours, key=estimate.behaviours.get, default=next(iter(self.rhythmic)))
        return not self.rhythmic.get(behaviour, True)  # standing still, which the filter adds, has no goal


def load_live(path, method, horizons, histories=True):
    """Load a model that predicts and warm it up.

    Parameters
    ----------
    path : path-like
    method : str
        See `style_core.predictor_file.read_predictor`.
    horizons : ndarray, shape (H,)
        What will be predicted, s.
    histories : bool
        Use the recorded motion that a phase-style model may hold.

    Raises
    ------
    ModelError
        If the file is not a readable model of a kind that predicts.
    UsageError
        If its kind has no such method.
    """
    found = read_predictor(path, method, () if histories else ('histories',))
    warm_up(found.predictor, horizons)
    return LiveModel(Path(path).stem, found.kind, method, found.predictor, found.rhythmic, found.rate_hz)
