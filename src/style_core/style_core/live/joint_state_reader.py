"""Read joint states as the middleware delivers them, without building a message object."""
import struct

import numpy as np

from style_core.errors import MotionError
from style_core.live.stamp_policy import NANOSECONDS

__all__ = ['JointStateReader']

#: bytes that say how the rest is encoded; alignment counts from behind them
_ENCAPSULATION = 4
#: where the frame id begins: behind encapsulation, seconds and nanoseconds
_AFTER_STAMP = 12
#: how many lists of names are remembered; more than there are publishers
_REMEMBERED = 16
_DAMAGED = 'a damaged joint state: '


class JointStateReader:
    """Serialised ``sensor_msgs/JointState`` (CDR of either byte order) to stamp, names and positions.

    A publisher sends the same names every time, so what stands between stamp and positions is compared with what was
    read before, and read anew only where it differs. One message costs about a microsecond; rclpy takes some hundred
    to make an object of it. For every node that listens to joint states (``create_subscription(..., raw=True)``).
    """

    def __init__(self):
        self._known = []

    def read(self, data):
        """Read a message.

        Parameters
        ----------
        data : bytes

        Returns
        -------
        stamp : int
            Ns.
        names : tuple of str
            The same object for the same names.
        positions : ndarray, shape (P,)
            As sent: not always as many as names. A view of ``data``.

        Raises
        ------
        MotionError
            If the bytes are no joint state.
        """
        if len(data) < _AFTER_STAMP or data[0] != 0 or data[1] not in (0, 1):
            raise MotionError(_DAMAGED + 'it is no CDR')
        order = '<' if data[1] else '>'
        seconds, nanoseconds = struct.unpack_from(order + 'iI', data, _ENCAPSULATION)
        for known in self._known:
            head, names, its_order = known
            if its_order == order and data.startswith(head, _AFTER_STAMP):
                break
        else:
            names, end = _names(data, order)
            known = data[_AFTER_STAMP:end], names, order
        if known is not self._known[0] if self._known else True:
            self._known = [known, *(one for one in self._known if one is not known)][:_REMEMBERED]
        count, at = _number(data, order, _AFTER_STAMP + len(known[0]))
        if count:
            at += (_ENCAPSULATION - at) % 8
        if at + 8 * count > len(data):
            raise MotionError(_DAMAGED + 'positions are cut off')
        positions = np.frombuffer(data, order + 'f8', count, at if count else 0)
        return seconds * NANOSECONDS + nanoseconds, names, positions


def _number(data, order, at):
    """The unsigned number at the next place for one, and where it ends."""
    at += -at % 4
    if at + 4 > len(data):
        raise MotionError(_DAMAGED + 'it ends too early')
    return struct.unpack_from(order + 'I', data, at)[0], at + 4


def _names(data, order):
    """Joint names, and where they end."""
    length, at = _number(data, order, _AFTER_STAMP)
    count, at = _number(data, order, at + length)
    if count > len(data) // 5:  # a text takes five bytes at least
        raise MotionError(_DAMAGED + 'names are cut off')
    names = []
    for _ in range(count):
        length, at = _number(data, order, at)
        if not length or at + length > len(data):
            raise MotionError(_DAMAGED + 'names are cut off')
        names.append(data[at:at + length - 1].decode('utf-8', 'replace'))
        at += length
    return tuple(names), at
