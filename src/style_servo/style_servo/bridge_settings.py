"""How the bridge behaves, and what a trajectory is to it."""
from dataclasses import dataclass

import numpy as np

__all__ = ['BridgeSettings', 'Points']


@dataclass(frozen=True)
class BridgeSettings:
    """How the bridge behaves.

    Attributes
    ----------
    rate : float
        Commands a second.
    input_timeout : float
        A trajectory that ends moving is one window of a stream: without the next one for this long the input is
        stale, s; 0 waits until the window has run out. A trajectory that ends at rest is complete and plays to its
        end.
    blend : float
        A new trajectory takes over from the playing one within this time, s.
    ramp_speed : float
        Fraction of the joint limits used when ramping in from a held posture.
    ramp_time : float
        Shortest ramp, s, unless the joints stand where the trajectory begins.
    coast : float
        A trajectory that ends moving comes to rest in this time, s.
    max_lead : float
        A trajectory may start at most this far in the future, s.
    hold_timeout : float
        Hold this long on stale input before the hold policy, s.
    hold_policy : str
        'hold' for ever, 'relax' (torque off) or 'fault'.
    latch_hold : bool
        Stale input asks for a reset before trajectories are taken again.
    estop_action, fault_action : str
        'brake' (stop within the limits and hold with torque) or 'torque_off'.
    following_time : float
        A following error may last this long, s.
    saturation_time : float
        A trajectory may ask for more than the limits allow; the commands follow as fast as they may. This long a joint
        may stay behind by more than its ``discontinuity``, s.
    hold_error : float
        A stopped joint's command stays this near to where the joint is, rad, or its following error, if that is less:
        this bounds what it presses with.
    partial_joints : bool
        Take trajectories for some of the joints; the others hold.
    """

    rate: float = 200.0
    input_timeout: float = 0.3
    blend: float = 0.06
    ramp_speed: float = 0.3
    ramp_time: float = 0.3
    coast: float = 0.1
    max_lead: float = 2.0
    hold_timeout: float = 5.0
    hold_policy: str = 'hold'
    latch_hold: bool = False
    estop_action: str = 'brake'
    fault_action: str = 'brake'
    following_time: float = 0.25
    saturation_time: float = 1.0
    hold_error: float = 0.1
    partial_joints: bool = False


@dataclass(frozen=True, eq=False)
class Points:
    """The points of one trajectory as arrays.

    Attributes
    ----------
    joint_names : sequence of str
    times : ndarray, shape (K,)
        From the start, s.
    positions : ndarray, shape (K, J)
    velocities, accelerations : ndarray, shape (K, J), or None
    """

    joint_names: tuple
    times: np.ndarray
    positions: np.ndarray
    velocities: object = None
    accelerations: object = None
