"""What messages that begin with a stamp and joint names have in common as the middleware delivers them (CDR)."""
import struct

from style_core.live.stamp_policy import NANOSECONDS

__all__ = ['ENCAPSULATION', 'StampedNamesReader']

#: bytes that say how the rest is encoded; alignment counts from behind them
ENCAPSULATION = 4
#: where the frame id begins: behind encapsulation, seconds and nanoseconds
_AFTER_STAMP = 12
#: how many lists of names are remembered; more than there are publishers
_REMEMBERED = 16


class StampedNamesReader:
    """Reads byte order, stamp and joint names; a reader of one kind of message goes on from there.

    A publisher sends the same names every time, so what stands between stamp and values is compared with what was
    read before, and read anew only where it differs.
    """

    def __init__(self):
        self._known = []

    def damaged(self, what):
        """The error to raise for damaged bytes; ``what`` is wrong with them."""
        raise NotImplementedError

    def begin(self, data):
        """Byte order for `struct`, stamp in ns, names (the same object for the same names) and where they end."""
        if len(data) < _AFTER_STAMP or data[0] != 0 or data[1] not in (0, 1):
            raise self.damaged('it is no CDR')
        order = '<' if data[1] else '>'
        seconds, nanoseconds = struct.unpack_from(order + 'iI', data, ENCAPSULATION)
        for place, known in enumerate(self._known):
            if known[1] == order and data.startswith(known[0], _AFTER_STAMP):
                if place:
                    self._known.insert(0, self._known.pop(place))
                break
        else:
            names, end = self._names(data, order)
            known = bytes(data[_AFTER_STAMP:end]), order, names
            self._known = [known, *self._known][:_REMEMBERED]
        head, _, names = known
        return order, seconds * NANOSECONDS + nanoseconds, names, _AFTER_STAMP + len(head)

    def number(self, data, order, at):
        """The unsigned number at the next place for one, and where it ends."""
        at += -at % 4
        if at + 4 > len(data):
            raise self.damaged('it ends too early')
        return struct.unpack_from(order + 'I', data, at)[0], at + 4

    def _names(self, data, order):
        """Joint names, and where they end."""
        length, at = self.number(data, order, _AFTER_STAMP)
        count, at = self.number(data, order, at + length)
        if count > len(data) // 5:  # a text takes five bytes at least
            raise self.damaged('names are cut off')
        names = []
        for _ in range(count):
            length, at = self.number(data, order, at)
            if not length or at + length > len(data):
                raise self.damaged('names are cut off')
            names.append(data[at:at + length - 1].decode('utf-8', 'replace'))
            at += length
        return tuple(names), at
