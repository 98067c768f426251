"""The parser of the commands: options and files in any order, and what may have been meant by a word that is none."""
import argparse
import os
import re

from style_core.formats import FORMATS
from style_core.text import did_you_mean, shown

__all__ = ['Parser', 'Several', 'divide']

#: a value, though it begins like an option: -1.5, -.5*walk
_NUMBER = re.compile(r'-\.?\d')


class Several(argparse.Action):
    """Stores one or more words, of every time the option is given; a recording or model among them ends the list.

    Parameters
    ----------
    option_strings, dest, **options
        As of every action; ``nargs`` is '+'.
    """

    def __init__(self, option_strings, dest, **options):
        super().__init__(option_strings, dest, nargs='+', **options)

    def __call__(self, parser, namespace, values, option_string=None):
        """Add them."""
        setattr(namespace, self.dest, [*(getattr(namespace, self.dest) or []), *values])


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that takes options before, between and after files."""

    def parse_known_args(self, args=None, namespace=None):
        """As of ``ArgumentParser``, but an unknown option is an error that names what is like it."""
        if self._subparsers is None and args is not None:
            words, options, unknown = divide(self._option_string_actions, args)
            if unknown:
                self.error(f'no option {shown(unknown[0])}'
                           + did_you_mean(unknown[0].partition('=')[0].lstrip('-'), [
                               name[2:] for name in self._option_string_actions if name.startswith('--')], before='--'))
            # words side by side: argparse gives an optional list of files the first of several groups only
            args = [*options, '--', *words] if any(map(_begins_with_dash, words)) else [*words, *options]
        return super().parse_known_args(args, namespace)

    def _check_value(self, action, value):
        if action.choices is not None and value not in action.choices:
            names = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(action, f'there is no {shown(str(value))}'
                                         + (did_you_mean(str(value), names) or f'; there are {", ".join(names)}'))


def divide(actions, args):
    """Tell the words that stand for themselves from options and their values.

    Parameters
    ----------
    actions : mapping of str to argparse.Action
        By option string.
    args : sequence of str

    Returns
    -------
    words : list of str
    options : list of str
        Each followed by its values.
    unknown : list of str
        Words that look like options and are none.
    """
    words, options, unknown, left = [], [], [], list(args)
    while left:
        word = left.pop(0)
        if word == '--':
            words += left
            break
        if not _looks_like_option(word):
            words.append(word)
            continue
        action, has_value = _action_of(actions, word)
        if action is None:
            unknown.append(word)
        elif action == 'ambiguous' or has_value:
            options.append(word)    # argparse says so
        else:
            options += _with_values(word, action, left)
    return words, options, unknown


def _action_of(actions, word):
    """Action of an option as it was written, and whether the value hangs on it; None where there is none."""
    name, equals, _ = word.partition('=')
    if name in actions:
        return actions[name], bool(equals)
    if not word.startswith('--'):
        short = actions.get(word[:2])
        return short, short is not None
    meant = {id(action): action for option, action in actions.items() if option.startswith(name)}
    if len(meant) > 1:
        return 'ambiguous', False
    return next(iter(meant.values()), None), bool(equals)


def _with_values(word, action, left):
    """An option and its values, taken from what is left."""
    if action.nargs == 0 or not left or _looks_like_option(left[0]) or left[0] == '--':
        return [word]
    value = left.pop(0)
    if action.nargs is None:
        if value.startswith('-') and word.startswith('--'):
            return [f'{word}={value}']      # argparse takes -1e-3 and -0.5*walk for options
        return [word, value]
    values = [value]
    while left and left[0] != '--' and not _looks_like_option(left[0]) and not (
            isinstance(action, Several) and _names_a_file(left[0])):
        values.append(left.pop(0))
    return [word, *values]


def _looks_like_option(word):
    return _begins_with_dash(word) and word != '--' and ' ' not in word.partition('=')[0] and not _NUMBER.match(word)


def _begins_with_dash(word):
    return word.startswith('-') and word != '-'


def _names_a_file(word):
    """A recording or model: no joint and no part has such a name."""
    return os.path.splitext(word)[1].lower() in {*filter(None, FORMATS), '.npz'} or \
        os.path.isfile(os.path.join(word, 'metadata.yaml'))
