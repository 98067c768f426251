"""Files that commands read by name (`add_input`) or write (`add_output`): found and checked before any work."""
import argparse
import contextlib
import os
import sys
from pathlib import Path

from style_core.errors import UsageError
from style_core.formats import written_suffixes
from style_core.places import find_file

__all__ = ['add_input', 'add_output', 'check_outputs', 'find_inputs', 'say_written', 'saying_written']

#: what is written -> suffixes that say so
_SUFFIXES = {
    'motion': None,  # of the formats that are written
    'model': ('.npz',), 'table': ('.csv',),
    'picture': ('.png', '.pdf', '.svg'), 'graph': ('.png', '.pdf', '.svg', '.dot'), 'robot': ('.yaml', '.yml')}


class _Written(str):
    """Name of a file that a command writes; ``what`` is a key of `_SUFFIXES`."""

    what = 'motion'


class _Store(argparse.Action):
    """Stores the name of a file to write."""

    def __init__(self, option_strings, dest, what='motion', **options):
        super().__init__(option_strings, dest, **options)
        self._what = what

    def __call__(self, parser, namespace, value, option_string=None):
        """Store it."""
        value = _Written(value)
        value.what = self._what
        setattr(namespace, self.dest, value)


class _Named(str):
    """Name of a file that may come with the suite; ``what`` is that of `find_file`."""

    what = 'model'


class _Name(argparse.Action):
    """Stores the name of a file that may come with the suite."""

    def __init__(self, option_strings, dest, what='model', **options):
        super().__init__(option_strings, dest, **options)
        self._what = what

    def __call__(self, parser, namespace, value, option_string=None):
        """Store it."""
        value = _Named(value)
        value.what = self._what
        setattr(namespace, self.dest, value)


def add_input(parser, *flags, what='model', **options):
    """Add the argument for a file that may be one of those that come with the suite (`style_core.places`).

    Parameters
    ----------
    parser : argparse.ArgumentParser
    *flags : str
        As of ``add_argument``.
    what : {'model', 'robot'}
    **options
        As of ``add_argument``.
    """
    parser.add_argument(*flags, action=_Name, what=what, **options)


def add_output(parser, *flags, what='motion', **options):
    """Add the argument for a file to write, and ``--force`` with the first of them.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    *flags : str
        As of ``add_argument``.
    what : {'motion', 'model', 'table', 'picture', 'graph', 'robot'}
    **options
        As of ``add_argument``.
    """
    parser.add_argument(*flags, action=_Store, what=what, **options)
    if '--force' not in parser._option_string_actions:
        parser.add_argument('--force', action='store_true',
                            help='write even where that replaces a file which this command reads, or writes itself')


def find_inputs(args):
    """Put where they are in the place of the files named by `add_input`; DEST_given keeps the name.

    Raises
    ------
    ModelError
        Where there is none.
    """
    for key, name in [pair for pair in vars(args).items() if isinstance(pair[1], _Named)]:
        setattr(args, f'{key}_given', str(name))
        setattr(args, key, find_file(name, name.what))


def check_outputs(args):
    """Refuse outputs that cannot be meant: without their suffix, where nothing can be written, or over an input.

    Every other word of the command line that names something there is counts as an input.

    Raises
    ------
    UsageError
        Naming the file as it was given.
    """
    words = list(_words(vars(args).values()))
    outputs = [word for word in words if isinstance(word, _Written)]
    inputs = [word for word in words if not isinstance(word, _Written) and word and os.path.exists(word)]
    for output in outputs:
        _check_name(output, getattr(args, 'storage', None))
    if getattr(args, 'force', False):
        return
    for index, output in enumerate(outputs):
        for other, what in [*((word, 'is read as well') for word in inputs),
                            *((word, 'is written twice') for word in outputs[:index])]:
            if os.path.realpath(output) == os.path.realpath(other) or (
                    os.path.exists(output) and os.path.exists(other) and os.path.samefile(output, other)):
                raise UsageError(f'{output} {what}: give another name, or --force')


@contextlib.contextmanager
def saying_written(args):
    """Say of every output that has become another meanwhile that it was written."""
    before = {word: _stamp(word) for word in _words(vars(args).values()) if isinstance(word, _Written)}
    yield
    for output, stamp in before.items():
        if _stamp(output) != stamp:
            say_written(output, args)


def say_written(path, args):
    """Say that a file was written; beside JSON, on stderr."""
    print(f'wrote {path}', file=sys.stderr if getattr(args, 'json', False) else sys.stdout)


def _stamp(path):
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns, found.st_size


def _check_name(output, storage):
    suffixes, path = _SUFFIXES[output.what] or written_suffixes(), Path(output)
    suffix = path.suffix.lower()
    if output.what == 'motion' and not suffix:
        if storage is None:
            raise UsageError(f'{output} has no suffix, which would say the format ({" ".join(suffixes)}); a bag, which '
                             'is a folder, is written by motion-style convert --storage')
    elif suffix not in suffixes:
        raise UsageError(f'{output}: a {output.what} file must end in {" or ".join(suffixes)}')
    elif path.is_dir():
        raise UsageError(f'{output} is a folder')
    if output.what not in ('picture', 'graph') and not Path(os.path.realpath(path)).parent.is_dir():
        raise UsageError(f'the folder {path.parent} does not exist')


def _words(values):
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, (list, tuple)):
            yield from _words(value)
