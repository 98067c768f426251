"""Angles from the robot to a model and back, joint by joint; what the predictor node does with every message."""
import numpy as np

from libc.math cimport NAN, fabs, isfinite, isnan

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
    cdef const double[::1] _gain, _offset, _lower, _upper

    def __init__(self, robot_joints, channels, gain, offset, lower, upper):
        self.robot_joints = robot_joints
        self.channels = np.array(channels, dtype=np.intp)
        self._count = len(robot_joints)
        self._channels = self.channels
        self._needed = max(self.channels, default=-1) + 1
        self._gain = np.array(gain, dtype=float)
        self._offset = np.array(offset, dtype=float)
        self._lower = np.array(lower, dtype=float)
        self._upper = np.array(upper, dtype=float)
        if not len(self.channels) == len(gain) == len(offset) == len(lower) == len(upper) == self._count:
            raise ValueError('a map needs as many channels, gains, offsets and limits as joints')

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
        cdef const double[:, :] model = self._rows(mean)
        result, rows = self._room(mean)
        cdef double[:, ::1] robot = rows
        cdef Py_ssize_t n, r
        cdef double angle
        for n in range(model.shape[0]):
            for r in range(self._count):
                angle = model[n, self._channels[r]] * self._gain[r] + self._offset[r]
                if angle < self._lower[r]:
                    angle = self._lower[r]
                elif angle > self._upper[r]:
                    angle = self._upper[r]
                robot[n, r] = angle
        return result

    def spread_to_robot(self, std):
        """Standard deviations of the robot angles, shape (..., R), from the model's, shape (..., D)."""
        cdef const double[:, :] model = self._rows(std)
        result, rows = self._room(std)
        cdef double[:, ::1] robot = rows
        cdef Py_ssize_t n, r
        for n in range(model.shape[0]):
            for r in range(self._count):
                robot[n, r] = model[n, self._channels[r]] * fabs(self._gain[r])
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
                if (angles[n, r] <= self._lower[r] and speed < 0) or (angles[n, r] >= self._upper[r] and speed > 0):
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
        shape = np.shape(values)[:-1] + (self._count,)
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
