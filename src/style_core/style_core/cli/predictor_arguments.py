"""What the commands that predict share: masks and the method."""
import numpy as np

from style_core.angles import reordered
from style_core.cli.number import Number
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate
from style_core.errors import MotionError, UsageError
from style_core.motion import matching_names
from style_core.phase_style import FORGETTING, KIND, METHODS
from style_core.phase_style.full import PARTS
from style_core.predictor_file import read_predictor

__all__ = ['add_reading', 'add_method', 'add_published', 'predictor_of', 'read_of', 'fitted', 'hide']


def add_reading(parser):
    """Rate of formats without one, and joints to hide."""
    add_recorded_rate(parser)
    parser.add_argument('--mask', action=Several, default=[], metavar='PATTERN',
                        help="joints to hide from the model, as shell patterns ('lfemur.*'); '!PATTERN' excludes")


def add_method(parser):
    """Method and behaviours left out."""
    parser.add_argument('--method', choices=METHODS, default=METHODS[0],
                        help='of a phase-style model: full, the full filter (default); paper, the published method '
                             'with one behaviour')
    add_published(parser)
    parser.add_argument('--without', action=Several, default=[], metavar='PART',
                        choices=(*PARTS, 'histories', 'unknown'),
                        help=f'parts of the full filter to leave out: {", ".join(PARTS)}, or histories (the recorded '
                             'motion that a model trained with --histories holds)')


def add_published(parser):
    """Settings of the published method."""
    parser.add_argument('--forgetting', action=Number, above=0, most=1, metavar='LAMBDA',
                        help='with --method paper: forgetting factor of the style for a frame at the rate of the '
                             f'model, up to 1, which forgets nothing (default: {FORGETTING})')
    parser.add_argument('--behaviour', metavar='NAME',
                        help='with --method paper: the behaviour to follow (default: the first of the file)')


def read_of(args):
    """What `read_predictor` makes of the model, the method and the settings that were asked for."""
    return read_predictor(args.model, args.method, args.without, forgetting=args.forgetting, behaviour=args.behaviour)


def predictor_of(args):
    """Predictor of the model and method that were asked for, and the method: None for kinds that have only one."""
    found = read_of(args)
    return found.predictor, args.method if found.kind == KIND else None


def fitted(motion, predictor):
    """The predictor's joints of a recording, in its order; each turns in the order that the model learned."""
    orders = getattr(predictor, 'orders', None)
    if orders is not None:
        motion = reordered(motion, {**motion.orders, **orders})
    return motion.joints(list(predictor.joint_names))


def hide(motion, names, patterns):
    """Copy of a motion with the joints that match set missing, and their names."""
    if not patterns:
        return motion, []
    try:
        hidden = matching_names(names, patterns)
    except MotionError as error:
        raise UsageError(f'--mask: {error}') from None
    if len(hidden) == len(names):
        raise UsageError('--mask hides every joint of the model')
    positions = motion.positions.copy()
    for name in hidden:
        if name in motion.joint_names:
            positions[:, motion.joint_names.index(name)] = np.nan
    return motion.replace(positions=positions), hidden
