"""Read joint states as the middleware delivers them, without building a message object."""
import numpy as np

from style_core.budgets import MESSAGE_BYTES
from style_core.errors import MotionError
from style_core.wire.cdr import ENCAPSULATION, StampedNamesReader

__all__ = ['JointStateReader']

_NUMBERS = {order: np.dtype(order + 'f8') for order in '<>'}


class JointStateReader(StampedNamesReader):
    """Serialised ``sensor_msgs/JointState`` (CDR of either byte order) to stamp, names and positions.

    One message costs about a microsecond; rclpy takes some hundred to make an object of it. For every node that
    listens to joint states (``create_subscription(..., raw=True)``).
    """

    def damaged(self, what):
        """The error to raise."""
        return MotionError(f'a damaged joint state: {what}')

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
        if len(data) > MESSAGE_BYTES:
            raise MotionError(f'a joint state of {len(data)} bytes is refused unread')
        order, stamp, names, at = self.begin(data)
        count, at = self.number(data, order, at)
        if count:
            at += (ENCAPSULATION - at) % 8
        if at + 8 * count > len(data):
            raise self.damaged('positions are cut off')
        return stamp, names, np.frombuffer(data, _NUMBERS[order], count, at if count else 0)
