"""Errors that a user can mend; the commands print them as one line, the nodes log them.

Their messages quote what came from outside, so each is cut to one line of bounded length when it is made.
"""
from style_core.budgets import ERROR_TEXT
from style_core.text import shown

__all__ = ['MotionError', 'ModelError', 'UsageError']


class _MendableError(ValueError):
    def __init__(self, message=''):
        super().__init__(shown(str(message), ERROR_TEXT))


class MotionError(_MendableError):
    """A recording or an array that cannot be used as motion; the message says why and what to do."""


class ModelError(_MendableError):
    """A model file, or data for a model, that does not fit; the message says what differs."""


class UsageError(_MendableError):
    """A request that makes no sense as asked (exit status 2 on the command line)."""
