"""Any message as the middleware delivers it (CDR), read with every length checked before anything is made of it."""
from types import SimpleNamespace

import numpy as np

from style_core.budgets import MESSAGE_BYTES
from style_core.errors import MotionError
from style_core.wire.cdr import ENCAPSULATION

__all__ = ['Field', 'MessageReader']

cdef enum:
    BODY = 4

_SCALARS = {code: np.dtype(code) for code in ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'i8', 'u8', 'f4', 'f8', 'b1')}


class Field:
    """One field of a message.

    Parameters
    ----------
    name : str
    kind : str or tuple of Field
        A number's code for numpy (``'f8'``, ``'b1'``), ``'text'``, or the fields of a message.
    length : int
        0 a single value, -1 a list of any length, otherwise an array of so many.
    most : int
        Elements of a list, at most; 0 for any number.
    most_text : int
        Bytes of a text, at most; 0 for any number.
    """

    def __init__(self, name, kind, length=0, most=0, most_text=0):
        self.name, self.kind, self.length, self.most, self.most_text = name, kind, length, most, most_text


class MessageReader:
    """Reads messages of one type.

    A list is made only where the message holds as many bytes as its elements take, so a damaged length costs nothing.

    Parameters
    ----------
    fields : sequence of Field
    what : str
        What the message is called in errors.
    wanted : collection of str, optional
        Fields to return; the others are checked and passed over. All where left out.
    most_bytes : int
        Longer messages are refused unread.
    """

    def __init__(self, fields, what, wanted=None, most_bytes=MESSAGE_BYTES):
        self._what, self._most = what, most_bytes
        self._fields = [(field, _plan(field), wanted is None or field.name in wanted) for field in fields]

    def read(self, data):
        """Read a message.

        Parameters
        ----------
        data : bytes

        Returns
        -------
        SimpleNamespace
            Numbers and texts as Python's, lists and arrays of numbers as ndarray, lists of texts and messages as list,
            messages like this one.

        Raises
        ------
        MotionError
            If the bytes are no such message, or too many.
        """
        if len(data) > self._most:
            raise MotionError(f'{self._what} of {len(data)} bytes is refused unread')
        if len(data) < ENCAPSULATION or data[0] != 0 or data[1] > 1:
            raise MotionError(f'a damaged {self._what}: it is no CDR')
        cdef _Bytes source = _Bytes(data, data[1])
        result = SimpleNamespace()
        try:
            for field, plan, wanted in self._fields:
                value = _value(source, plan, wanted)
                if wanted:
                    setattr(result, field.name, value)
        except _Damage as damage:
            raise MotionError(f'a damaged {self._what}: {field.name} {damage}') from None
        return result


class _Damage(Exception):
    pass


def _plan(field):
    """What reading needs of a field: dtypes in both byte orders, or the plan of what it holds."""
    if field.kind == 'text':
        return 't', None, 4, field.length, field.most, field.most_text
    if isinstance(field.kind, str):
        dtype = _SCALARS[field.kind]
        return ('b' if field.kind == 'b1' else 'n'), (dtype.newbyteorder('>'), dtype.newbyteorder('<')), \
            dtype.itemsize, field.length, field.most, 0
    inner = tuple((part.name, _plan(part)) for part in field.kind)
    return 'm', inner, max(1, sum(_least(plan) for _, plan in inner)), field.length, field.most, 0


def _least(plan):
    """Fewest bytes that a field takes."""
    return plan[2] * plan[3] if plan[3] > 0 else plan[2] if plan[3] == 0 else 4


cdef class _Bytes:
    """Bytes and the place up to which they have been read."""

    cdef object data
    cdef const unsigned char[::1] view
    cdef Py_ssize_t at, size
    cdef bint little

    def __init__(self, data, little):
        self.data, self.view, self.at, self.size, self.little = data, data, BODY, len(data), little

    cdef int room(self, Py_ssize_t step, Py_ssize_t count, Py_ssize_t size) except -1:
        """Go to the next multiple of ``step`` (a power of two) from where ``count`` elements of ``size`` follow."""
        self.at += (BODY - self.at) & (step - 1)
        if self.at > self.size or count > (self.size - self.at) // size:
            raise _Damage('is cut off')
        return 0

    cdef unsigned int number(self) except? 0xFFFFFFFF:
        """The next unsigned number of four bytes."""
        self.room(4, 1, 4)
        cdef const unsigned char* p = &self.view[self.at]
        self.at += 4
        if self.little:
            return p[0] | p[1] << 8 | p[2] << 16 | <unsigned int>p[3] << 24
        return p[3] | p[2] << 8 | p[1] << 16 | <unsigned int>p[0] << 24

    cdef text(self, Py_ssize_t most, bint wanted):
        cdef Py_ssize_t length = self.number(), begin = self.at
        if length > self.size - self.at:
            raise _Damage('is cut off')
        self.at += length
        if length == 0:
            return ''
        if self.view[self.at - 1] != 0:
            raise _Damage('is a text without an end')
        if most and length - 1 > most:
            raise _Damage(f'is a text of {length - 1} bytes')
        if not wanted:
            return None
        try:
            return bytes(self.view[begin:self.at - 1]).decode()
        except UnicodeDecodeError:
            raise _Damage('is no text') from None


cdef _value(_Bytes source, tuple plan, bint wanted):
    cdef str kind = plan[0]
    cdef Py_ssize_t size = plan[2], count = plan[3], most = plan[4], i
    cdef bint single = count == 0
    if count == -1:
        count = source.number()
        if most and count > most:
            raise _Damage(f'has {count} elements')
    elif single:
        count = 1
    if kind == 't' or kind == 'm':
        source.room(1, count, size)
        if kind == 't':
            found = [source.text(plan[5], wanted) for _ in range(count)]
        else:
            found = [_message(source, plan[1], wanted) for _ in range(count)]
        return found[0] if single else found
    if count == 0:
        return np.empty(0, plan[1][1])
    source.room(size, count, size)
    i, source.at = source.at, source.at + count * size
    if kind == 'b':
        for place in range(i, source.at):
            if source.view[place] > 1:
                raise _Damage('is neither true nor false')
    if not wanted:
        return None
    numbers = np.frombuffer(source.data, plan[1][source.little], count, i)
    return numbers[0].item() if single else numbers


cdef _message(_Bytes source, tuple inner, bint wanted):
    result = SimpleNamespace()
    for name, plan in inner:
        value = _value(source, plan, wanted)
        if wanted:
            setattr(result, name, value)
    return result if wanted else None
