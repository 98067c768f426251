"""What messages that begin with a stamp and joint names have in common as the middleware delivers them (CDR)."""
from libc.string cimport memcmp

__all__ = ['ENCAPSULATION', 'StampedNamesReader']

#: bytes that say how the rest is encoded; alignment counts from behind them
ENCAPSULATION = 4
cdef enum:
    SECONDS = 4
    #: where the frame id begins: behind encapsulation, seconds and nanoseconds
    AFTER_STAMP = 12
    #: how many lists of names are remembered; more than there are publishers
    REMEMBERED = 16


cdef class StampedNamesReader:
    """Reads byte order, stamp and joint names; a reader of one kind of message goes on from there.

    A publisher sends the same names every time, so what stands between stamp and values is compared with what was
    read before, and read anew only where it differs.
    """

    cdef readonly list known

    def __init__(self):
        self.known = []

    def damaged(self, what):
        """The error to raise for damaged bytes; ``what`` is wrong with them."""
        raise NotImplementedError

    def begin(self, const unsigned char[::1] data not None):
        """Byte order for `struct`, stamp in ns, names (the same object for the same names) and where they end."""
        cdef Py_ssize_t length = data.shape[0], place, end
        cdef const unsigned char[::1] head
        cdef bint little
        cdef long long seconds
        if length < AFTER_STAMP or data[0] != 0 or data[1] > 1:
            raise self.damaged('it is no CDR')
        little = data[1]
        seconds = <int>_number(data, little, SECONDS)
        stamp = seconds * 1_000_000_000 + _number(data, little, SECONDS + 4)
        for place in range(len(self.known)):
            known = self.known[place]
            head = known[0]
            end = AFTER_STAMP + head.shape[0]
            if end <= length and known[1] == little and memcmp(&head[0], &data[AFTER_STAMP], head.shape[0]) == 0:
                if place:
                    self.known.insert(0, self.known.pop(place))
                break
        else:
            names, end = self._names(data, little)
            known = bytes(data[AFTER_STAMP:end]), little, names
            self.known = [known, *self.known][:REMEMBERED]
        return '<' if little else '>', stamp, known[2], end

    def number(self, const unsigned char[::1] data not None, str order, Py_ssize_t at):
        """The unsigned number at the next place for one, and where it ends."""
        at = self._room(data, at)
        return _number(data, order == '<', at), at + 4

    cdef Py_ssize_t _room(self, const unsigned char[::1] data, Py_ssize_t at) except -1:
        """The next place for a number, if there is one before the end."""
        at += -at & 3
        if at < 0 or at + 4 > data.shape[0]:
            raise self.damaged('it ends too early')
        return at

    cdef _names(self, const unsigned char[::1] data, bint little):
        """Joint names, and where they end."""
        cdef Py_ssize_t at = self._room(data, AFTER_STAMP), length, count
        length = _number(data, little, at)
        at = self._room(data, at + 4 + length)
        count = _number(data, little, at)
        at += 4
        if count > data.shape[0] // 5:  # a text takes five bytes at least
            raise self.damaged('names are cut off')
        names = []
        for _ in range(count):
            at = self._room(data, at)
            length = _number(data, little, at)
            at += 4
            if not length or at + length > data.shape[0]:
                raise self.damaged('names are cut off')
            names.append(bytes(data[at:at + length - 1]).decode('utf-8', 'replace'))
            at += length
        return tuple(names), at


cdef unsigned int _number(const unsigned char[::1] data, bint little, Py_ssize_t at) noexcept:
    """The number in four bytes."""
    if little:
        return data[at] | data[at + 1] << 8 | data[at + 2] << 16 | <unsigned int>data[at + 3] << 24
    return data[at + 3] | data[at + 2] << 8 | data[at + 1] << 16 | <unsigned int>data[at] << 24
