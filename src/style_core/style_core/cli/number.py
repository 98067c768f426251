"""Numbers on the command line: one outside its limits is wrong use, said in one line before anything is read."""
import argparse
import math
from functools import partial

from style_core.errors import UsageError

__all__ = ['Number', 'Positive', 'Count', 'Seed']


class Number(argparse.Action):
    """Stores the finite number of an option; argparse lets the UsageError through.

    Parameters
    ----------
    option_strings, dest, **options
        As of every action; ``type`` is float where it is not given.
    least, most, above : float, optional
        Limits; only the last is no value itself.
    """

    def __init__(self, option_strings, dest, least=-math.inf, most=math.inf, above=-math.inf, **options):
        super().__init__(option_strings, dest, **{'type': float, **options})
        self._least, self._most, self._above = least, most, above

    def __call__(self, parser, namespace, value, option_string=None):
        """Store it."""
        if not (math.isfinite(value) and self._least <= value <= self._most and value > self._above):
            raise UsageError(f'{option_string} must {self._wanted()}, not {value:g}')
        setattr(namespace, self.dest, value)

    def _wanted(self):
        least, most, above = self._least, self._most, self._above
        if math.isfinite(least) and math.isfinite(most):
            return f'lie between {least} and {most}'
        if above == 0:
            words = ['be positive (more than 0)']
        else:
            words = [f'be {word} {limit}' for word, limit in (('more than', above), ('at least', least))
                     if math.isfinite(limit)]
        if math.isfinite(most):
            words.append(f'{"at most" if words else "be at most"} {most}')
        return ' and '.join(words) or 'be finite'


#: rates, and lengths of time or of units
Positive = partial(Number, above=0)
Count = partial(Number, type=int, least=1)
Seed = partial(Number, type=int, least=0)
