"""How far outside the styles learned a command may go: as far as the synthesizer node does."""
import numpy as np

from style_core.cli.number import Number
from style_core.errors import UsageError

__all__ = ['add_exaggeration', 'check_far']

#: that of `style_core.synthesis.stage.StageSettings`
_DEFAULT = 2.0


def add_exaggeration(parser):
    """The option."""
    parser.add_argument('--max-exaggeration', action=Number, least=0, default=_DEFAULT, metavar='X',
                        help='a style may lie this many training ranges outside those learned (default: '
                             f'{_DEFAULT:g}); beyond them angles soon are such as no body has')


def check_far(styles, dof, v, exaggeration, labels=None):
    """Refuse coordinates far outside those of the styles learned and of the generic one.

    Parameters
    ----------
    styles : mapping of str to ndarray, shape (K,)
    dof : int
        K.
    v : ndarray, shape (K,)
    exaggeration : float
        Training ranges.
    labels : sequence of str, optional
        Names of the coordinates.

    Raises
    ------
    UsageError
        Naming the coordinate that is farthest out.
    """
    known = np.array([np.zeros(dof), *styles.values()])
    lower, upper = known.min(axis=0), known.max(axis=0)
    out = np.maximum(lower - v, v - upper) / np.maximum(upper - lower, 1e-6)
    worst = int(np.argmax(out))
    if not out[worst] <= exaggeration:
        label = f'coordinate {worst + 1}' if labels is None else labels[worst]
        raise UsageError(f'the style lies too far outside those learned: {label} is {v[worst]:.3g}, they lie between '
                         f'{lower[worst]:.3g} and {upper[worst]:.3g} (--max-exaggeration {exaggeration:g})')
