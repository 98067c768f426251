"""Messages of fixed layout, serialised once; afterwards only their numbers change.

A trajectory of 25 points by 56 joints takes rclpy 0.6 to 0.8 ms to build and convert; writing its numbers into the
serialised form takes a fortieth of that (``benchmarks/speed/bench_node.py``).
"""
import numpy as np
from rclpy.serialization import serialize_message

__all__ = ['MessageTemplate', 'set_stamp']


def set_stamp(message, values):
    """Setter for the stamp of a message with a header; values are seconds and nanoseconds."""
    message.header.stamp.sec, message.header.stamp.nanosec = int(values[0]), int(values[1])


class MessageTemplate:
    """The serialised form of a message, with the places of the numbers that change.

    The places are found by serialising the message twice, with zeros and with a marker in every byte of a field; so
    nothing is assumed about the encoding but that it has no compression.

    Parameters
    ----------
    message : ROS message
        With everything set that stays the same.
    fields : mapping of str to (setter, dtype, count)
        ``setter(message, values)`` stores ``values``, a numpy array of ``count`` numbers of ``dtype``.

    Raises
    ------
    ValueError
        If a setter does not reach exactly ``count`` numbers.
    """

    def __init__(self, message, fields):
        for setter, dtype, count in fields.values():
            setter(message, np.zeros(count, dtype))
        plain = np.frombuffer(serialize_message(message), np.uint8)
        self._buffer = plain.copy()
        self._places = {}
        for name, (setter, dtype, count) in fields.items():
            dtype = np.dtype(dtype)
            marker = np.full(count * dtype.itemsize, 1, np.uint8).view(dtype)
            setter(message, marker)
            places = np.flatnonzero(np.frombuffer(serialize_message(message), np.uint8)[:len(plain)] != plain)
            setter(message, np.zeros(count, dtype))
            starts = places[::dtype.itemsize]
            if len(places) != count * dtype.itemsize or len(set(starts % dtype.itemsize)) > 1:
                raise ValueError(f'field {name} does not have {count} numbers of type {dtype}')
            first = int(starts[0]) % dtype.itemsize if count else 0
            whole = (len(plain) - first) // dtype.itemsize * dtype.itemsize
            view = self._buffer[first:first + whole].view(dtype)
            index = (starts - first) // dtype.itemsize
            run = count > 0 and index[-1] - index[0] == count - 1
            self._places[name] = view, slice(int(index[0]), int(index[-1]) + 1) if run else index

    def write(self, **values):
        """Store arrays (any shape, ``count`` numbers in the message's order) and return the serialised message."""
        for name, value in values.items():
            view, places = self._places[name]
            view[places] = np.ravel(value)
        return self._buffer.tobytes()
