"""Styles written as arithmetic: mixtures, exaggerations and analogies of named styles.

    ballet                        a style
    1.5*ballet - 0.5*languid      more ballet than ballet
    0.5*(walk + run)              halfway
    walk:run :: strut:X           what strutting is to X as walking is to running: strut + (run - walk)
    [0.3, -1.2]                   coordinates
    generic                       the origin
"""
import re
from dataclasses import dataclass

import numpy as np

from style_core.budgets import STYLE_DEPTH, STYLE_TEXT
from style_core.errors import UsageError
from style_core.text import did_you_mean, shown

__all__ = ['evaluate_style']

_TOKEN = re.compile(r"""\s*(?:
    (?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(?![\w.])
  | (?P<name>[A-Za-z0-9_][\w.]*|"[^"]+")
  | (?P<analogy>::)
  | (?P<symbol>[-+*/():,\[\]])
)""", re.VERBOSE)


def evaluate_style(text, styles, dof):
    """Coordinates of a style expression.

    Parameters
    ----------
    text : str
        Names with other characters than letters, digits, ``_`` and ``.`` stand in double quotes.
    styles : mapping of str to ndarray, shape (dof,)
    dof : int
        Number of style coordinates; ``[...]`` may give fewer, the rest is zero.

    Returns
    -------
    ndarray, shape (dof,)

    Raises
    ------
    UsageError
        Where the expression cannot be read, with the place; or for a style that does not exist, with those that do;
        or where it is longer or nested deeper than `style_core.budgets` allows, or gives no finite coordinates.
    """
    if len(text) > STYLE_TEXT:
        raise UsageError(f'a style of {len(text)} characters is refused: {STYLE_TEXT} at most')
    tokens = _tokens(text)
    with np.errstate(all='ignore'):     # what overflows is found below
        if any(token.kind == 'analogy' for token in tokens):
            value = _analogy(text, tokens, styles, dof)
        else:
            value = _value(text, tokens, styles, dof)
    if not np.isfinite(value).all():
        raise UsageError(f'style {_quoted(text)}: its numbers are too large')
    return value


def _quoted(text):
    return repr(shown(text))


def _value(text, tokens, styles, dof):
    parser = _Parser(text, tokens, styles, dof)
    value = parser.sum()
    parser.expect_end()
    return parser.as_style(value)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    place: int


def _tokens(text):
    tokens, place, end = [], 0, len(text.rstrip())
    while place < end:
        match = _TOKEN.match(text, place)
        if match is None:
            odd = text[place:place + 20].strip()[:10]
            raise UsageError(f'style {_quoted(text)}: cannot read {odd!r} at character {place + 1}')
        tokens.append(_Token(match.lastgroup, match.group(match.lastgroup), match.start(match.lastgroup)))
        place = match.end()
    if not tokens:
        raise UsageError('the style is empty: give a name such as ballet, or 1.5*ballet - 0.5*languid')
    return tokens


def _analogy(text, tokens, styles, dof):
    """``a:b :: c:X`` is c + (b - a)."""
    sides, side = [[]], 0
    for token in tokens:
        if token.kind == 'analogy' or token.text == ':':
            sides.append([])
            side += 1
        else:
            sides[-1].append(token)
    order = [token.text for token in tokens if token.text in (':', '::')]
    if order != [':', '::', ':'] or len(sides[3]) != 1 or sides[3][0].text.upper() != 'X' or not all(sides[:3]):
        raise UsageError(f'style {_quoted(text)}: an analogy is written walk:run :: strut:X')
    first, second, third = (_value(text, part, styles, dof) for part in sides[:3])
    return third + second - first


class _Parser:
    """Recursive descent of bounded depth; a value is a float or a vector."""

    def __init__(self, text, tokens, styles, dof):
        self.text, self.tokens, self.styles, self.dof = text, tokens, styles, dof
        self.next = self.depth = 0

    def fail(self, reason):
        raise UsageError(f'style {_quoted(self.text)}: {reason}')

    def peek(self):
        return self.tokens[self.next].text if self.next < len(self.tokens) else ''

    def take(self):
        self.next += 1
        return self.tokens[self.next - 1]

    def expect_end(self):
        if self.next < len(self.tokens):
            token = self.tokens[self.next]
            self.fail(f'{_quoted(token.text)} at character {token.place + 1} does not fit there (is a * missing?)')

    def as_style(self, value):
        if isinstance(value, float):
            self.fail('gives a number, not a style')
        return value

    def sum(self):
        value = self.product()
        while self.peek() in ('+', '-'):
            sign = 1.0 if self.take().text == '+' else -1.0
            other = self.product()
            if isinstance(value, float) != isinstance(other, float):
                self.fail('adds a number to a style; did you mean to multiply?')
            value = value + sign * other
        return value

    def product(self):
        value = self.factor()
        while self.peek() in ('*', '/'):
            operator, other = self.take().text, self.factor()
            if operator == '/':
                if not isinstance(other, float) or other == 0.0:
                    self.fail('divides by something that is not a number other than zero')
                value = value / other
            elif not isinstance(value, float) and not isinstance(other, float):
                self.fail('multiplies two styles; only numbers multiply')
            else:
                value = value * other
        return value

    def factor(self):
        negative = False
        while self.peek() in ('+', '-'):
            negative ^= self.take().text == '-'
        if self.next >= len(self.tokens):
            self.fail('ends too early')
        value = self.operand(self.take())
        return -value if negative else value

    def operand(self, token):
        if token.text in ('(', '['):
            self.depth += 1
            if self.depth > STYLE_DEPTH:
                self.fail(f'brackets are nested deeper than {STYLE_DEPTH}')
            value = self.vector() if token.text == '[' else self.sum()
            self.close(']' if token.text == '[' else ')')
            self.depth -= 1
            return value
        if token.kind == 'number':
            value = float(token.text)
            if not np.isfinite(value):
                self.fail(f'{shown(token.text)} is too large')
            return value
        if token.kind == 'name':
            return self.named(token.text.strip('"'))
        self.fail(f'{_quoted(token.text)} at character {token.place + 1} does not fit there')

    def close(self, bracket):
        if self.peek() != bracket:
            self.fail(f'lacks a {bracket!r}')
        self.take()

    def vector(self):
        values = [self.sum()]
        while self.peek() == ',':
            self.take()
            values.append(self.sum())
        if not all(isinstance(value, float) for value in values):
            self.fail('coordinates in [...] must be numbers')
        if len(values) > self.dof:
            self.fail(f'gives {len(values)} coordinates, the model has {self.dof}')
        return np.array(values + [0.0] * (self.dof - len(values)))

    def named(self, name):
        if name in self.styles:
            return np.array(self.styles[name], dtype=float)
        if name == 'generic':
            return np.zeros(self.dof)
        self.fail(f'there is no style {_quoted(name)}; the styles are {", ".join(sorted(self.styles))} and generic'
                  + did_you_mean(name, [*self.styles, 'generic']))
