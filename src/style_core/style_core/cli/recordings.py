"""The recordings that a command is given."""
import warnings
from pathlib import Path

from style_core.cli.number import Positive
from style_core.formats import carried
from style_core.recordings import read_recording as read

__all__ = ['add_joints_of', 'add_recorded_rate', 'read_recording', 'named_recording']


def add_recorded_rate(parser):
    """The options for recordings that do not say their rate or unit."""
    parser.add_argument('--recorded-rate', action=Positive, metavar='HZ',
                        help='rate of recordings whose format does not say it (AMC; default: 120)')
    parser.add_argument('--unit', choices=('rad', 'deg'),
                        help='of the columns of a table that name no unit (default: rad)')


def add_joints_of(parser):
    """The option for tables without a header."""
    parser.add_argument('--joints-of', metavar='URDF',
                        help="a table without header holds this robot's joints, in the file's order; before them may "
                             'stand the time, and place and quaternion x y z w of the root')


def read_recording(path, recorded_rate=None, unit=None, **options):
    """A recording with continuous angles; rate and unit count where the format says none.

    Among several recordings a rate is not for those that say their own; a command for a single one passes ``rate_hz``,
    which is refused where it means nothing.
    """
    known = carried(path)['options'] if recorded_rate or unit else ()
    timed = Path(path).suffix.lower() == '.csv' and 'joints_of' not in options
    if recorded_rate and 'rate_hz' in known and not timed:
        options['rate_hz'] = recorded_rate
    if unit and 'unit' in known:
        options['unit'] = unit
    with warnings.catch_warnings():
        if recorded_rate:
            warnings.filterwarnings('ignore', '.* is not used$')
        return read(path, **options)


def named_recording(path, recorded_rate=None, unit=None):
    """The same, named by its file whatever name it carries."""
    return read_recording(path, recorded_rate, unit).replace(name=Path(path).stem)
