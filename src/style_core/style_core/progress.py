"""How far something is: a bar on a terminal, elsewhere (a log, a pipe) a line every ten seconds."""
import contextlib
import sys
from time import monotonic

from tqdm import tqdm

__all__ = ['progress']

#: seconds between lines; what takes less says nothing
EVERY_S = 10.0


def progress(items=None, desc='', unit='it', total=None, shown=True):
    """Wrap what is iterated over, or, without items, make something with ``update()``, to be used in ``with``.

    Parameters
    ----------
    items : iterable, optional
    desc : str
        What is done.
    unit : str
        Of what is counted.
    total : int, optional
        How many there will be; the number of items where they can be counted.
    shown : bool
        Say anything at all?
    """
    if not shown or sys.stderr is None or sys.stderr.isatty():
        return tqdm(items, desc=desc, unit=unit, total=total, leave=False, disable=not shown or sys.stderr is None)
    return _Lines(items, desc, unit, total)


class _Lines:
    """What `progress` needs of tqdm, in lines."""

    def __init__(self, items, desc, unit, total):
        self._items, self._desc, self._unit = items, desc, unit
        self._total = len(items) if total is None and hasattr(items, '__len__') else total
        self._count, self._postfix = 0, ''
        self._begin = self._told = monotonic()

    def __iter__(self):
        for item in self._items:
            yield item
            self.update()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def set_postfix_str(self, text):
        """What to say behind the next line."""
        self._postfix = text

    def update(self, count=1):
        """So many more are done."""
        self._count += count
        now = monotonic()
        if now - self._told >= EVERY_S:
            self._told = now
            line = tqdm.format_meter(self._count, self._total, now - self._begin, ncols=0, prefix=self._desc,
                                     unit=self._unit, postfix=self._postfix)
            with contextlib.suppress(OSError, ValueError):
                print(line, file=sys.stderr, flush=True)
