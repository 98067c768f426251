"""Load a model for live use: read, build the predictor, put it through its paces."""
from dataclasses import dataclass
from pathlib import Path
from typing import Mapping, Optional

from style_core.phase_style import METHODS, PaperPredictor
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
    published : PaperPredictor, optional
        The published method where the predictor is that, for what may be set while it runs.
    """

    name: str
    kind: str
    method: str
    predictor: OnlinePredictor
    rhythmic: Mapping[str, bool]
    rate_hz: float
    published: Optional[PaperPredictor] = None

    def forget(self, forgetting):
        """Set lambda of the published method while it runs; nothing where the filter is another."""
        if self.published is not None:
            self.published.forgetting = forgetting

    def is_discrete(self, estimate):
        """Whether the phase of ``estimate`` runs from start to goal: that of its most probable behaviour."""
        behaviour = max(estimate.behaviours, key=estimate.behaviours.get, default=next(iter(self.rhythmic)))
        return not self.rhythmic.get(behaviour, True)  # standing still, which the filter adds, has no goal


def load_live(path, method, horizons, histories=True, behaviour='', forgetting=None):
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
    behaviour : str
        That the published method follows, the first where empty; the full filter follows all.
    forgetting : float, optional
        lambda of the published method; the full filter, which has none, ignores it.

    Raises
    ------
    ModelError
        If the file is not a readable model of a kind that predicts.
    UsageError
        If its kind has no such method, or a behaviour is not in the file or named for the full filter.
    """
    options = {} if method == METHODS[0] else {'forgetting': forgetting}
    found = read_predictor(path, method, () if histories else ('histories',), behaviour=behaviour or None, **options)
    warm_up(found.predictor, horizons)
    return LiveModel(Path(path).stem, found.kind, method, found.predictor, found.rhythmic, found.rate_hz,
                     found.published)
