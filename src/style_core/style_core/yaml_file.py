"""YAML files of bounded size, depth and content: a small file cannot grow to something large."""
import yaml

from style_core.budgets import YAML_BYTES, YAML_DEPTH, YAML_NODES
from style_core.errors import ModelError
from style_core.regular_file import read_regular

__all__ = ['read_yaml']


def read_yaml(path, what):
    """Content of a YAML file, of plain types.

    Parameters
    ----------
    path : path-like
    what : str
        What the file is, for messages.

    Raises
    ------
    ModelError
        If it cannot be read, is not YAML, or is larger, deeper or, with all that its aliases repeat, fuller than
        `style_core.budgets` allows.
    """
    try:
        text = read_regular(path, YAML_BYTES).decode('utf-8')
        _check(yaml.parse(text, yaml.SafeLoader))
        return yaml.safe_load(text)
    except (OSError, ValueError, OverflowError, yaml.YAMLError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else ' '.join(str(error).split())
        raise ModelError(f'{what} {path} cannot be read: {reason}') from None


def _check(events):
    """Count what a file holds, an alias as what it stands for."""
    sizes, open_ones, total = {}, [], 0
    for event in events:
        size = 0
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f'alias {event.anchor} stands for nothing that is complete')
            size = sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            size = 1
            sizes[event.anchor] = size
        elif isinstance(event, yaml.CollectionStartEvent):
            open_ones.append((event.anchor, total))
            size = 1
            if len(open_ones) > YAML_DEPTH:
                raise ValueError(f'it is nested deeper than {YAML_DEPTH}')
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_ones.pop()
            sizes[anchor] = total - before
        total += size
        if total > YAML_NODES:
            raise ValueError(f'it has more than {YAML_NODES} entries, with those that aliases repeat')
