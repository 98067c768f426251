"""The recordings that a command is given."""
import fnmatch
from pathlib import Path

from style_core.angles import continuous
from style_core.cli.number import Positive
from style_core.formats import read_motion

__all__ = ['add_recorded_rate', 'read_recording', 'named_recording', 'chosen_joints', 'EXTREMITIES', 'FURNITURE']

#: what is left out where nothing else is said: fingers and thumbs, which recordings hold as noise; and the root
EXTREMITIES = ('*fingers*', '*thumb*')
FURNITURE = ('root.*', *EXTREMITIES)


def add_recorded_rate(parser):
    """The option for recordings that do not say their rate."""
    parser.add_argument('--recorded-rate', action=Positive, metavar='HZ',
                        help='rate of recordings whose format does not say it (AMC; default: 120)')


def read_recording(path, recorded_rate=None):
    """A recording with continuous angles; ``recorded_rate`` counts where the format says none."""
    options = {'rate_hz': recorded_rate} if recorded_rate and Path(path).suffix.lower() == '.amc' else {}
    return continuous(read_motion(path, **options))


def chosen_joints(motion, patterns=None, without=EXTREMITIES):
    """Channels of a motion: by ``patterns``, or all but those in ``without``, of which a body need not have any."""
    if not patterns:
        patterns = ['!' + pattern for pattern in without if fnmatch.filter(motion.joint_names, pattern)]
    return motion.select(*patterns) if patterns else motion


def named_recording(path, recorded_rate=None):
    """The same, named by its file whatever name it carries."""
    return read_recording(path, recorded_rate).replace(name=Path(path).stem)
