"""What is about to make a servo shut down: told while it still works."""
import math

import numpy as np

__all__ = ['ServoHealth']

NEAR_C = 10.0           # below the Temperature Limit
NEAR_V = 0.5            # inside the voltage limits
NEAR_LOAD = 0.9         # of the Current Limit, or of full load
LOAD_S = 1.0            # over which the load is averaged


class ServoHealth:
    """Compares readings with the limits that the servos themselves shut down at.

    Parameters
    ----------
    servos : list of DynamixelServo
        With ``limits``, values of their limit registers, once they have been set up.
    period : float
        Between readings, s.
    """

    def __init__(self, servos, period):
        self._servos = servos
        self._share = -math.expm1(-period / LOAD_S)
        self._load = np.zeros(len(servos))
        self._most = np.ones(len(servos))

    def take_limits(self):
        """Read the limits anew from the servos."""
        self._load[:] = 0.0
        # A, or 1 where the model reports a load
        self._most = np.array([servo.limits.get('Current Limit', 0) * (servo.table.current_unit or 0.0) or 1.0
                               for servo in self._servos])

    def feel(self, effort):
        """Take one reading of all efforts, shape (D,)."""
        self._load += self._share * (np.abs(effort) / self._most - self._load)

    def warnings(self, measurement):
        """One line for each reading near its limit."""
        found = []
        for servo, temperature, voltage, load in zip(self._servos, measurement.temperature, measurement.voltage,
                                                     self._load):
            limits = servo.limits
            hottest = limits.get('Temperature Limit', math.inf)
            high, low = 0.1 * limits.get('Max Voltage Limit', math.inf), 0.1 * limits.get('Min Voltage Limit', 0)
            if temperature >= hottest - NEAR_C:
                found.append(f'{servo} is at {temperature:.0f} deg C and shuts down at {hottest}')
            if voltage <= low + NEAR_V:
                found.append(f'{servo} has {voltage:.1f} V and shuts down below {low:.1f}')
            if voltage >= high - NEAR_V:
                found.append(f'{servo} has {voltage:.1f} V and shuts down above {high:.1f}')
            if load >= NEAR_LOAD:
                found.append(f'{servo} has been pushing with {100 * load:.0f} % of what it may, and shuts down by '
                             'overload')
        return found
