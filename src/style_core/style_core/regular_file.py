"""Files that may be read: regular ones, of bounded size. A FIFO or a device would keep its reader waiting for ever."""
import os
import stat

__all__ = ['open_regular', 'read_regular']


def open_regular(path, most):
    """Open a regular file of at most ``most`` bytes for reading bytes.

    Raises
    ------
    OSError
        Where there is none, or it may not be read.
    ValueError
        Where it is no regular file, or is larger.
    """
    # without waiting for the other end of a FIFO, or taking a terminal
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        found = os.fstat(descriptor)
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(f'{path} is a folder')
        if not stat.S_ISREG(found.st_mode):
            raise ValueError('it is no regular file')
        if found.st_size > most:
            raise ValueError(f'it has {found.st_size} bytes, {most} at most are read')
        return os.fdopen(descriptor, 'rb')
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path, most):
    """The bytes of a regular file; errors as `open_regular`, also where it grows meanwhile."""
    with open_regular(path, most) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError(f'more than {most} bytes')
    return data
