"""How much memory something will take, worked out before it is asked for."""
import os
import resource

from style_core.errors import UsageError

__all__ = ['demand', 'free_bytes']

#: of the memory that is free
_SHARE = 0.8


def free_bytes():
    """Memory that this process may still have, bytes: what the system says is available, within its own limit."""
    try:
        with open('/proc/meminfo', encoding='ascii') as lines:
            free = next(1024 * int(line.split()[1]) for line in lines if line.startswith('MemAvailable'))
    except (OSError, StopIteration, ValueError):
        free = os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') // 2
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return free if limit == resource.RLIM_INFINITY else min(free, limit)


def demand(numbers, what, remedy):
    """Refuse what would not fit into memory.

    Parameters
    ----------
    numbers : float
        How many floats of 8 bytes it takes.
    what : str
        That takes them, for the message: ``'the motion at 1e+09 Hz, 6e+09 frames,'``.
    remedy : str
        What to do instead.

    Raises
    ------
    UsageError
        With both figures.
    """
    free = free_bytes()
    if not 8 * numbers <= _SHARE * free:
        raise UsageError(f'{what} would take {8 * numbers / 2**30:.3g} GiB of memory, of which {free / 2**30:.2g} GiB '
                         f'are free: {remedy}')
