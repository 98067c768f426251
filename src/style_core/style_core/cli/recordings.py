"""The recordings that a command is given."""
from pathlib import Path

from style_core.angles import continuous
from style_core.cli.number import Positive
from style_core.formats import read_motion

__all__ = ['add_recorded_rate', 'read_recording']


def add_recorded_rate(parser):
    """The option for recordings that do not say their rate."""
    parser.add_argument('--recorded-rate', action=Positive, metavar='HZ',
                        help='rate of recordings whose format does not say it (AMC; default: 120)')


def read_recording(path, recorded_rate=None, skeleton=None):
    """A recording with continuous angles, named by its file; ``recorded_rate`` counts where the format says none."""
    options = {'rate_hz': recorded_rate} if recorded_rate and Path(path).suffix.lower() == '.amc' else {}
    return continuous(read_motion(path, skeleton=skeleton, **options)).replace(name=Path(path).stem)
