"""Who moves in which recording: what is learned about new people depends on it."""
import re
import warnings
from pathlib import Path

from style_core.errors import UsageError
from style_core.formats.files import read_table
from style_core.phase_style.learning import group_of

__all__ = ['add_person', 'people_of']

_FILE_COLUMNS = ('file', 'recording', 'trial', 'name')


def add_person(parser):
    """The option."""
    parser.add_argument('--person', metavar='HOW',
                        help="who moves: 'folder' (the file's folder), a pattern of the file's name such as "
                             "'sub{person}_*', or TABLE.csv:COLUMN with the files in a column "
                             f"{', '.join(_FILE_COLUMNS[:-1])} or {_FILE_COLUMNS[-1]} (default: the name up to the "
                             'first "_" or "-")')


def people_of(paths, how=None):
    """Person of each recording; prints who is whom, and warns where uncertainty about people cannot be learned.

    Parameters
    ----------
    paths : sequence of path-like
    how : str, optional
        As ``--person`` has it.

    Returns
    -------
    dict of str to str
        Path -> person.

    Raises
    ------
    UsageError
        If a file does not match.
    """
    person = _rule(how)
    people = {str(path): person(Path(path)) for path in paths}
    members = {}
    for path, name in people.items():
        members.setdefault(name, []).append(Path(path).stem)
    listed = [f'{name} ({", ".join(own[:4])}{f" and {len(own) - 4} more" if len(own) > 4 else ""})'
              for name, own in members.items()]
    more = f' and {len(listed) - 12} more' if len(listed) > 12 else ''
    print(f'{len(members)} {"person" if len(members) == 1 else "people"}: {", ".join(listed[:12])}{more}')
    if len(paths) > 1 and len(members) == 1:
        warnings.warn('all recordings count as one person: how much people differ cannot be learned, and bands about a '
                      'new person are too narrow (--person says who is who)', stacklevel=2)
    elif len(members) == len(paths) > 1:
        warnings.warn('every recording counts as a person of its own: if they are not, bands about a new person are '
                      'wrong (--person says who is who)', stacklevel=2)
    return people


def _rule(how):
    if how is None:
        return lambda path: group_of(path.stem)
    if how == 'folder':
        return lambda path: path.absolute().parent.name
    if '{person}' in how:
        return _pattern(how)
    table, colon, column = how.rpartition(':')
    if not colon:
        raise UsageError(f"--person takes 'folder', a pattern with {{person}} in it, or TABLE.csv:COLUMN, not {how!r}")
    return _table(table, column)


def _pattern(how):
    if how.count('{person}') != 1:
        raise UsageError(f'--person {how}: {{person}} must stand in it once')
    marks = {'*': '.*', '?': '.'}
    before, after = (''.join(marks.get(letter, re.escape(letter)) for letter in part) for part in how.split('{person}'))
    pattern = re.compile(f'{before}(.+?){after}$')

    def person(path):
        found = pattern.match(path.stem) or pattern.match(path.name)
        if not found:
            raise UsageError(f'--person {how}: {path.name} does not match')
        return found.group(1)
    return person


def _table(table, column):
    known = {}
    for line, row in read_table(table, (column,)):
        files = next((row[name] for name in _FILE_COLUMNS if row.get(name)), None)
        if files is None:
            raise UsageError(f'{table}, line {line}: no file in a column {", ".join(_FILE_COLUMNS)}')
        if not row[column]:
            raise UsageError(f'{table}, line {line}: the column {column} is empty')
        known[Path(files).stem] = known[files] = row[column]

    def person(path):
        for key in (str(path), path.name, path.stem):
            if key in known:
                return known[key]
        raise UsageError(f'{table} does not name {path.name}')
    return person
