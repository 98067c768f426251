"""Messages as the middleware delivers them (CDR): stamp and joint names, and the points of joint trajectories."""
from libc.string cimport memcmp, memcpy

from style_core.budgets import JOINTS, NAME_BYTES, REMEMBERED_BYTES

__all__ = ['ENCAPSULATION', 'POINT_FIELDS', 'StampedNamesReader', 'copy_points']

cdef enum:
    #: bytes that say how the rest is encoded; alignment counts from behind them, and the seconds of the stamp follow
    BODY = 4
    #: where the frame id begins: behind encapsulation, seconds and nanoseconds
    AFTER_STAMP = 12
    #: how many lists of names are remembered; more than there are publishers
    REMEMBERED = 16
ENCAPSULATION = BODY
#: lists of numbers in a point, in their order; the time from start (seconds, nanoseconds) follows them
POINT_FIELDS = 'positions', 'velocities', 'accelerations', 'effort'


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
        seconds = <int>_number(&data[BODY], little)
        stamp = seconds * 1_000_000_000 + _number(&data[BODY + 4], little)
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
            if end - AFTER_STAMP <= REMEMBERED_BYTES // REMEMBERED:
                self.known = [known, *self.known][:REMEMBERED]
        return '<' if little else '>', stamp, known[2], end

    def number(self, const unsigned char[::1] data not None, str order, Py_ssize_t at):
        """The unsigned number at the next place for one, and where it ends."""
        at = self._room(data, at)
        return _number(&data[at], order == '<'), at + 4

    cdef Py_ssize_t _room(self, const unsigned char[::1] data, Py_ssize_t at) except -1:
        """The next place for a number, if there is one before the end."""
        at += -at & 3
        if at < 0 or at + 4 > data.shape[0]:
            raise self.damaged('it ends too early')
        return at

    cdef _names(self, const unsigned char[::1] data, bint little):
        """Joint names, and where they end."""
        cdef Py_ssize_t at = self._room(data, AFTER_STAMP), length, count
        length = _number(&data[at], little)
        at = self._room(data, at + 4 + length)
        count = _number(&data[at], little)
        at += 4
        if count > data.shape[0] // 5:  # a text takes five bytes at least
            raise self.damaged('names are cut off')
        if count > JOINTS:
            raise self.damaged(f'it has {count} names, {JOINTS} at most are read')
        names = []
        for _ in range(count):
            at = self._room(data, at)
            length = _number(&data[at], little)
            at += 4
            if not length or at + length > data.shape[0]:
                raise self.damaged('names are cut off')
            if length - 1 > NAME_BYTES:
                raise self.damaged(f'a name of {length - 1} bytes, {NAME_BYTES} at most are read')
            names.append(bytes(data[at:at + length - 1]).decode('utf-8', 'replace'))
            at += length
        return tuple(names), at


cdef inline unsigned int _number(const unsigned char* p, bint little) noexcept nogil:
    """The number in four bytes."""
    if little:
        return p[0] | p[1] << 8 | p[2] << 16 | <unsigned int>p[3] << 24
    return p[3] | p[2] << 8 | p[1] << 16 | <unsigned int>p[0] << 24


cdef inline void _numbers(const unsigned char* p, Py_ssize_t count, bint swap, double* out) noexcept nogil:
    cdef Py_ssize_t i, k
    cdef unsigned char* o = <unsigned char*>out
    if not swap:
        memcpy(out, p, 8 * count)
        return
    for i in range(count):
        for k in range(8):
            o[8 * i + k] = p[8 * i + 7 - k]


def copy_points(const unsigned char[::1] data, Py_ssize_t at, bint little, bint swap, double[::1] times,
                double[:, ::1] positions, double[:, ::1] velocities, double[:, ::1] accelerations, long[::1] lengths):
    """Copy the points that begin at ``at``; lists of a point that are not wanted are None.

    Parameters
    ----------
    data : bytes
        The whole message.
    at : int
    little, swap : bool
        Whether the message is little-endian, and whether that is not this machine's order.
    times : ndarray, shape (K,)
        Written, s from the start; for no points only ``lengths`` are written.
    positions, velocities, accelerations : ndarray, shape (K, J), or None
        Written.
    lengths : ndarray of int, shape (4,)
        Of the first point's lists: written where ``times`` is empty, expected of every point otherwise.

    Returns
    -------
    fault : int
        -2 none, -1 the message ends too early, 0 to 3 a list that has another length.
    """
    cdef Py_ssize_t size = data.shape[0], count = times.shape[0], k, field
    cdef long length
    cdef double* out
    cdef bint look = count == 0
    for k in range(1 if look else count):
        for field in range(4):
            at += -at & 3
            if at + 4 > size:
                return -1
            length = _number(&data[at], little)
            at += 4
            if look:
                lengths[field] = length
            elif length != lengths[field]:
                return field
            if length == 0:
                continue
            at += (BODY - at) & 7
            if at + 8 * length > size:
                return -1
            out = NULL
            if not look:
                if field == 0:
                    out = &positions[k, 0]
                elif field == 1 and velocities is not None:
                    out = &velocities[k, 0]
                elif field == 2 and accelerations is not None:
                    out = &accelerations[k, 0]
            if out != NULL:
                _numbers(&data[at], length, swap, out)
            at += 8 * length
        at += -at & 3
        if at + 8 > size:
            return -1
        if not look:
            times[k] = <int>_number(&data[at], little) + 1e-9 * _number(&data[at + 4], little)
        at += 8
    return -2
