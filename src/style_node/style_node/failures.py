"""Exceptions of callbacks: none ends a node. Each is counted, told once in the log and reported on /diagnostics."""
import traceback
from collections import Counter

from style_core.text import shown

__all__ = ['CannotGoOn', 'Failures', 'refusal']

#: kinds of failure that are told apart; characters of a traceback in the log
_KINDS, _TRACEBACK = 100, 8000


class CannotGoOn(RuntimeError):
    """Raised by a callback whose failure leaves a node of no use, or motors without a stop: it ends the program."""


class Failures:
    """What callbacks have raised.

    Attributes
    ----------
    total : int
    newest : str
        What was raised last, and where; '' before the first.
    """

    def __init__(self):
        self._counts = Counter()
        self.total, self.newest = 0, ''
        self._reported = 0

    def note(self, error, logger):
        """Count an exception; the first of its kind and place is logged with its traceback."""
        self.total += 1
        places = traceback.extract_tb(error.__traceback__, -1) if error.__traceback__ else []
        place = f'{places[0].name}, line {places[0].lineno}' if places else 'nowhere'
        self.newest = shown(f'{type(error).__name__} in {place}: {error}', 200)
        kind = type(error).__name__, place
        if kind not in self._counts and len(self._counts) < _KINDS:
            trace = ''.join(traceback.format_exception(type(error), error, error.__traceback__, limit=-12))
            lines = [shown(line, 400) for line in trace[-_TRACEBACK:].split('\n')]
            logger.error('a callback failed; what it was called with is refused (told once, counted on /diagnostics)\n'
                         + '\n'.join(lines))
            self._counts[kind] = 0
        if kind in self._counts:
            self._counts[kind] += 1

    def fresh(self):
        """How many since this was asked last."""
        since, self._reported = self.total - self._reported, self.total
        return since


def refusal(kind, request, error):
    """The response of a service whose callback has failed: no success, and why, wherever the type has room for it."""
    response = kind.Response()
    reason = shown(f'the request failed: {type(error).__name__}: {error}', 400)
    for field in ('message', 'reason'):
        if isinstance(getattr(response, field, None), str):
            setattr(response, field, reason)
    result = getattr(response, 'result', None)
    if hasattr(result, 'reason'):
        result.reason = reason
    if hasattr(response, 'results') and hasattr(request, 'parameters'):     # set_parameters: one answer each
        from rcl_interfaces.msg import SetParametersResult
        response.results = [SetParametersResult(successful=False, reason=reason) for _ in request.parameters]
    return response
