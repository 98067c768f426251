"""Errors that a user can mend; the commands print them as one line, the nodes log them."""

__all__ = ['MotionError', 'ModelError', 'UsageError']


class MotionError(ValueError):
    """A recording or an array that cannot be used as motion; the message says why and what to do."""


class ModelError(ValueError):
    """A model file, or data for a model, that does not fit; the message says what differs."""


class UsageError(ValueError):
    """A request that makes no sense as asked (exit status 2 on the command line)."""
