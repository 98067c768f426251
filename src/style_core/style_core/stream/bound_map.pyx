"""Angles from the robot to a model and back, joint by joint; what the predictor node does with every message."""
import numpy as np

from libc.math cimport NAN, isfinite, isnan

__all__ = ['BoundMap', 'all_finite']


cdef class BoundMap:
    """A joint map fitted to one model; robot joints in the model's order: ``robot = gain * model + offset``.

    Parameters
    ----------
    robot_joints : tuple of str, length R
    channels : ndarray of int, shape (R,)
        Model channel of each robot joint.
    gain, offset, lower, upper : ndarray, shape (R,)
        Limits in robot angles, infinite where there are none.
    """

    cdef readonly tuple robot_joints
    cdef readonly object channels
    cdef Py_ssize_t _count, _needed
    cdef const Py_ssize_t[::1] _channels
    cdef const double[::1] _gain, _offset, _spread, _zeros
    cdef const double[:, ::1] _limits, _boundless

    def __init__(self, robot_joints, channels, gain, offset, lower, upper):
        self.robot_joints = robot_joints
        self.channels = np.array(channels, dtype=np.intp)
        self._count = len(robot_joints)
        self._channels = self.channels
        self._needed = max(self.channels, default=-1) + 1
        self._gain = np.array(gain, dtype=float)
        self._offset = np.array(offset, dtype=float)
        if not len(self.channels) == len(gain) == len(offset) == len(lower) == len(upper) == self._count:
            raise ValueError('a map needs as many channels, gains, offsets and limits as joints')
        self._limits = np.array([lower, upper], dtype=float)
        # standard deviations have neither sign nor offset nor limits
        self._spread, self._zeros = np.abs(self._gain), np.zeros(self._count)
        self._boundless = np.repeat([[-np.inf], [np.inf]], self._count, axis=1)

    def observe(self, const double[::1] positions, const char[::1] allowed, double[::1] pose):
        """Write what the robot measured as a pose of the model.

        Parameters
        ----------
        positions : ndarray, shape (R,)
            NaN where nothing was measured.
        allowed : ndarray of int8, shape (R,)
            Which may be used.
        pose : ndarray, shape (D,)
            Written: model angles, NaN where there are none.

        Returns
        -------
        observed : ndarray of bool, shape (R,)
            Which robot joints were used.
        """
        cdef Py_ssize_t r, c, channels = pose.shape[0]
        if positions.shape[0] != self._count or allowed.shape[0] != self._count:
            raise ValueError('positions and allowed need one value a robot joint')
        if channels < self._needed:
            raise IndexError(f'the map wants more than {channels} channels')
        result = np.empty(self._count, dtype=bool)
        cdef char[::1] observed = result.view(np.int8)
        for c in range(channels):
            pose[c] = NAN
        for r in range(self._count):
            observed[r] = allowed[r] and not isnan(positions[r])
            if observed[r]:
                c = self._channels[r]
                pose[c] = (positions[r] - self._offset[r]) / self._gain[r]
        return result

    def to_robot(self, mean):
        """Robot angles within the limits, shape (..., R), of model angles, shape (..., D)."""
        return self._mapped(mean, self._gain, self._offset, self._limits)

    def spread_to_robot(self, std):
        """Standard deviations of the robot angles, shape (..., R), from the model's, shape (..., D)."""
        return self._mapped(std, self._spread, self._zeros, self._boundless)

    cdef _mapped(self, values, const double[::1] gain, const double[::1] offset, const double[:, ::1] limits):
        """``gain * value + offset`` of each robot joint, within limits."""
        cdef const double[:, :] model = self._rows(values)
        result, rows = self._room(values)
        cdef double[:, ::1] robot = rows
        cdef Py_ssize_t n, r
        cdef double value
        for n in range(model.shape[0]):
            for r in range(self._count):
                value = model[n, self._channels[r]] * gain[r] + offset[r]
                if value < limits[0, r]:
                    value = limits[0, r]
                elif value > limits[1, r]:
                    value = limits[1, r]
                robot[n, r] = value
        return result

    def velocity_to_robot(self, velocity, positions):
        """Robot joint velocities, shape (..., R); zero where ``positions`` rest at a limit and would pass it."""
        cdef const double[:, :] model = self._rows(velocity)
        cdef const double[:, :] angles = np.reshape(positions, (-1, self._count))
        if angles.shape[0] != model.shape[0]:
            raise ValueError('as many positions as velocities are needed')
        result, rows = self._room(velocity)
        cdef double[:, ::1] robot = rows
        cdef Py_ssize_t n, r
        cdef double speed
        for n in range(model.shape[0]):
            for r in range(self._count):
                speed = model[n, self._channels[r]] * self._gain[r]
                if ((angles[n, r] <= self._limits[0, r] and speed < 0)
                        or (angles[n, r] >= self._limits[1, r] and speed > 0)):
                    speed = 0.0
                robot[n, r] = speed
        return result

    cdef _rows(self, values):
        """The same numbers as rows of model channels."""
        values = np.asarray(values, dtype=float)
        rows = values if values.ndim == 2 else values.reshape(-1, values.shape[values.ndim - 1])
        if rows.shape[1] < self._needed:
            raise IndexError(f'the map wants more than {rows.shape[1]} channels')
        return rows

    cdef _room(self, values):
        """An array for robot angles, and the same as rows."""
        shape = (*np.shape(values)[:np.ndim(values) - 1], self._count)
        result = np.empty(shape)
        return result, result if len(shape) == 2 else result.reshape(-1, self._count)


def all_finite(*arrays):
    """Whether no number in any of the arrays is infinite or NaN."""
    cdef const double[::1] flat
    cdef Py_ssize_t i
    for array in arrays:
        flat = array.reshape(-1)
        for i in range(flat.shape[0]):
            if not isfinite(flat[i]):
                return False
    return True
