"""Messages of fixed layout, serialised once; afterwards only their numbers change.

A trajectory of 25 points by 56 joints takes rclpy 0.6 to 0.8 ms to build and convert; writing its numbers into the
serialised form takes a fortieth of that (``benchmarks/speed/bench_node.py``).
"""
import re
import struct

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from style_core.stream.stamp_policy import NANOSECONDS
from style_core.wire.cdr import ENCAPSULATION

__all__ = ['MessageTemplate', 'stamps_of']

_NUMBERS = {'double': 'f8', 'float': 'f4', 'int8': 'i1', 'uint8': 'u1', 'octet': 'u1', 'boolean': 'u1', 'int16': 'i2',
            'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8'}


class MessageTemplate:
    """The serialised form of a message, with the places of its numbers.

    Parameters
    ----------
    message : ROS message
        With every text as it stays and every list as long as it stays.
    """

    def __init__(self, message):
        self._buffer = np.frombuffer(serialize_message(message), np.uint8).copy()
        places = {}
        end = _walk(message, '', 0, places) + ENCAPSULATION
        if end > len(self._buffer):
            raise ValueError(f'{type(message).__name__} is not serialised by the rules of CDR here')
        # the middleware may leave room behind the message, which readers of bags do not like
        whole = _aligned(end, 4)
        room = np.zeros(whole + 8, np.uint8)
        begin = -(room.ctypes.data + ENCAPSULATION) % 8  # numbers of eight bytes lie where numpy is fast
        room[begin:begin + end] = self._buffer[:end]
        self._buffer = room[begin:begin + whole]
        self._places = {path: self._view(found) for path, found in places.items()}
        before = self._buffer.copy()
        if not self._holds(message):
            raise ValueError(f'{type(message).__name__} is not serialised by the rules of CDR here')
        self._buffer[:] = before
        self._stamped = 'header.stamp.sec' in places

    def _holds(self, message):
        """Whether a number written to every place comes back from the middleware."""
        ones = {path: np.ones(view.shape if index is None else index.shape)
                for path, (view, index) in self._places.items()}
        read = deserialize_message(self.write(ones), type(message))
        return all(np.all(np.equal(value, 1)) for value in _numbers(read))

    def _view(self, found):
        """A typed view of a field, block by block, and None; or one of the buffer and which elements belong to it."""
        dtype = np.dtype(found[0][0])
        starts = np.concatenate([offset + dtype.itemsize * np.arange(count) for _, offset, count in found])
        first = ENCAPSULATION % dtype.itemsize
        whole = (len(self._buffer) - first) // dtype.itemsize * dtype.itemsize
        index = (starts + ENCAPSULATION - first) // dtype.itemsize
        steps, count = np.diff([offset for _, offset, _ in found]) // dtype.itemsize, found[0][2]
        view = self._buffer[first:first + whole].view(dtype)
        if all(one[2] == count for one in found) and (steps == steps[:1]).all():
            # evenly spaced blocks, as the positions of points are
            shape, stride = (len(found), count), int(steps[0]) if len(steps) else count
            return np.lib.stride_tricks.as_strided(
                view[index[0]:] if len(index) else view[:0], shape, (stride * dtype.itemsize, dtype.itemsize)), None
        return view, index

    def write(self, values, stamp=None):
        """Store numbers and return the serialised message.

        Parameters
        ----------
        values : mapping of str to array_like
            By path (``'header.stamp.sec'``, ``'points.positions'``: through lists, element by element); as many numbers
            as the field has, in its order.
        stamp : int, optional
            Ns, for a message that begins with a header.
        """
        if stamp is not None:
            if not self._stamped:
                raise KeyError('header.stamp.sec')
            struct.pack_into('=iI', self._buffer, ENCAPSULATION, *divmod(stamp, NANOSECONDS))
        for path, numbers in values.items():
            view, index = self._places[path]
            if index is not None:
                view[index] = np.ravel(numbers)
            elif getattr(numbers, 'shape', None) == view.shape:
                view[:] = numbers
            else:
                view[:] = np.reshape(numbers, view.shape)
        return self._buffer.tobytes()

    def read(self, data, *paths):
        """Copies of the numbers at paths of a serialised message that differs from this one in numbers alone."""
        self._buffer[:] = np.frombuffer(data, np.uint8, len(self._buffer))
        return [(view if index is None else view[index]).copy() for view, index in map(self._places.get, paths)]


def stamps_of(messages):
    """Stamps, ns, of serialised messages that begin with a header; ndarray of int64, shape (N,)."""
    stamps = b''.join(data[ENCAPSULATION:ENCAPSULATION + 8] for data in messages)
    return np.frombuffer(stamps, np.uint32).reshape(-1, 2).astype(np.int64) @ [NANOSECONDS, 1]


def _walk(message, prefix, offset, places):
    """Note the type, offset and count of every number of a message by the rules of CDR; returns the end."""
    for name, kind in message.get_fields_and_field_types().items():
        path, value = prefix + name, getattr(message, name)
        inner = re.fullmatch(r'sequence<([^,>]+)(?:, \d+)?>', kind)
        fixed = re.fullmatch(r'(.+)\[\d+\]', kind)
        if inner:
            offset = _aligned(offset, 4) + 4
        element = (inner or fixed)[1] if inner or fixed else kind
        items = value if inner or fixed else [value]
        if element in _NUMBERS:
            size = np.dtype(_NUMBERS[element]).itemsize
            if len(items):
                offset = _aligned(offset, size)
            places.setdefault(path, []).append((_NUMBERS[element], offset, len(items)))
            offset += size * len(items)
        elif element.startswith('string'):
            for text in items:
                offset = _aligned(offset, 4) + 4 + len(text.encode()) + 1
        else:
            for item in items:
                offset = _walk(item, path + '.', offset, places)
    return offset


def _numbers(message):
    """The values of all numeric fields of a message, also of those in it."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        element = re.sub(r'^sequence<|[<>\[].*$', '', kind)
        if element in _NUMBERS:
            yield np.asarray(value, dtype=float)
        elif not element.startswith('string'):
            for item in value if isinstance(value, list) else [value]:
                yield from _numbers(item)


def _aligned(offset, size):
    return -(-offset // size) * size
