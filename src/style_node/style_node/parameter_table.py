"""Parameters of a node, written down once: name, default, unit, range and meaning."""
from dataclasses import dataclass
from typing import Callable, Mapping, Optional, Tuple

import numpy as np

from style_core.errors import UsageError

__all__ = ['Parameter', 'ParameterTable']

_KINDS = {bool: 'true or false', int: 'integer', float: 'number', str: 'text', tuple: 'list of text'}


@dataclass(frozen=True)
class Parameter:
    """One parameter; its type is that of its default.

    Attributes
    ----------
    name : str
    default : bool, int, float, str or tuple of str
    description : str
    unit : str
    lower, upper : float, optional
        Inclusive range of a number.
    choices : tuple of str
        What a text may be; anything where empty.
    live : bool
        Whether it may be changed while the node is configured.
    fixed : bool
        It is what it was when the node was started, for ever: nobody on the network can change it.
    """

    name: str
    default: object
    description: str
    unit: str = ''
    lower: Optional[float] = None
    upper: Optional[float] = None
    choices: Tuple[str, ...] = ()
    live: bool = True
    fixed: bool = False

    @property
    def text(self):
        """Description with unit, range and choices in words."""
        facts = [self.unit] if self.unit else []
        if self.lower is not None:
            facts.append(f'{self.lower:g} to {self.upper:g}')
        if self.choices:
            facts.append('one of ' + ', '.join(self.choices))
        if self.fixed:
            facts.append('fixed when the node is started')
        elif not self.live:
            facts.append('takes effect when the node is configured')
        return self.description + (f' ({"; ".join(facts)})' if facts else '')

    def problem(self, value):
        """What is wrong with a value, or ''."""
        kind = type(self.default)
        if kind is float and type(value) is int:
            value = float(value)
        if kind is tuple:
            fits = isinstance(value, (tuple, list)) and all(isinstance(part, str) for part in value)
        else:
            fits = type(value) is kind
        if not fits:
            return f'{self.name} must be {_KINDS[kind]}, not {value!r}'
        if self.lower is not None and not (np.isfinite(value) and self.lower <= value <= self.upper):
            return f'{self.name} must lie in {self.lower:g} to {self.upper:g}{" " + self.unit if self.unit else ""}, ' \
                   f'not {value}'
        if self.choices and value not in self.choices:
            return f'{self.name} must be one of {", ".join(self.choices)}, not {value!r}'
        return ''


@dataclass(frozen=True)
class ParameterTable:
    """All parameters of a node, and what must hold between them.

    Attributes
    ----------
    parameters : tuple of Parameter
    together : callable, optional
        Takes all values as a dict and raises UsageError where they do not go together.
    """

    parameters: Tuple[Parameter, ...]
    together: Optional[Callable[[Mapping[str, object]], object]] = None

    def __iter__(self):
        return iter(self.parameters)

    def check(self, values):
        """Check a complete set of values.

        Raises
        ------
        UsageError
            Naming everything that is wrong.
        """
        problems = [problem for problem in (one.problem(values[one.name]) for one in self.parameters) if problem]
        if problems:
            raise UsageError('; '.join(problems))
        if self.together is not None:
            self.together(values)

    def check_change(self, current, changes, configured):
        """Check changes to a running node; returns the new complete set of values.

        Parameters
        ----------
        current : mapping of str to value
        changes : mapping of str to value
            Names that are not in the table are left to others.
        configured : bool
            Whether the node is configured, so that parameters that are not live cannot change.

        Raises
        ------
        UsageError
            With the reason; then nothing is to be changed.
        """
        known = {one.name: one for one in self.parameters}
        changes = {name: value for name, value in changes.items() if name in known}
        fixed = [name for name, value in changes.items() if known[name].fixed and value != current[name]]
        if fixed:
            raise UsageError(f'{", ".join(fixed)} cannot change while the node runs: start it with other values')
        fixed = [name for name, value in changes.items()
                 if configured and not known[name].live and value != current[name]]
        if fixed:
            raise UsageError(f'{", ".join(fixed)} cannot change while the node is configured: clean it up first')
        values = {**current, **changes}
        self.check(values)
        return values

    def markdown(self):
        """Table for the documentation."""
        rows = [f'| `{one.name}` | {_shown(one.default)} | {one.text} |' for one in self.parameters]
        return '\n'.join(['| parameter | default | meaning |', '| --- | --- | --- |'] + rows)


def _shown(value):
    if isinstance(value, tuple):
        return f'`[{", ".join(value)}]`'
    if value == '':
        return '`""`'
    return f'`{str(value).lower() if isinstance(value, bool) else value}`'
