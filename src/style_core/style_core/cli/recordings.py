"""The recordings that a command is given."""
from pathlib import Path

from style_core.cli.number import Positive
from style_core.formats import carried
from style_core.recordings import read_recording as read

__all__ = ['add_recorded_rate', 'read_recording', 'named_recording']


def add_recorded_rate(parser):
    """The options for recordings that do not say their rate or unit."""
    parser.add_argument('--recorded-rate', action=Positive, metavar='HZ',
                        help='rate of recordings whose format does not say it (AMC; default: 120)')
    parser.add_argument('--unit', choices=('rad', 'deg'),
                        help='of the columns of a table that name no unit (default: rad)')


def read_recording(path, recorded_rate=None, unit=None, **options):
    """A recording with continuous angles; rate and unit count where the format says none.

    Among several recordings a rate is not for those that say their own; a command for a single one passes ``rate_hz``,
    which is refused where it means nothing.
    """
    known = carried(path)['options'] if recorded_rate or unit else ()
    if recorded_rate and 'rate_hz' in known:
        options['rate_hz'] = recorded_rate
    if unit and 'unit' in known:
        options['unit'] = unit
    return read(path, **options)


def named_recording(path, recorded_rate=None, unit=None):
    """The same, named by its file whatever name it carries."""
    return read_recording(path, recorded_rate, unit).replace(name=Path(path).stem)
