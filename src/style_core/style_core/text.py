"""Texts from outside, made fit to be printed: short, on one line, without codes that a terminal obeys."""
import difflib
import re
from itertools import islice

from style_core.budgets import SHOWN_TEXT

__all__ = ['did_you_mean', 'fitting', 'shown']

#: names that a word is compared with at most: a file from outside may hold any number
_MOST = 1000
#: control characters, line and paragraph separators, marks that turn the direction of writing, halves of characters
_UNFIT = re.compile('[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]')


def shown(text, most=SHOWN_TEXT):
    """A text of at most ``most`` characters (and what was left out) with every unfit character escaped."""
    cut = len(text) > most
    end = f'... ({len(text)} characters)' if cut else ''
    return _UNFIT.sub(lambda found: found[0].encode('unicode_escape').decode(), text[:most]) + end


def fitting(names, most):
    """Names one after the other, each shown, as long as they take no more than ``most`` characters together."""
    parts, room = [], most
    for place, name in enumerate(names):
        part = shown(name)
        room -= len(part) + 1
        if room < 0:
            return ' '.join([*parts, f'and {len(names) - place} more'])
        parts.append(part)
    return ' '.join(parts)


def did_you_mean(word, names, most=2, before=''):
    """Words to append to a complaint: the names most like a word that is none of them; empty where none is like it.

    What stands ``before`` every name is shown and not compared.
    """
    word = word[:SHOWN_TEXT]
    short = {name.lower(): name for name in islice(names, _MOST) if len(name) <= SHOWN_TEXT}
    near = difflib.get_close_matches(word.lower(), list(short), n=most, cutoff=0.6)
    return f'; did you mean {" or ".join(before + shown(short[name]) for name in near)}?' if near else ''
