"""What can move the joints: one entry a back end."""

__all__ = ['BACKENDS']


def _dynamixel(node, chain, values, period):
    from style_servo.dynamixel_backend import BusSettings, DynamixelBackend
    return DynamixelBackend(chain, BusSettings(
        port=values['port'], baud=values['baud'], fast_read=values['fast_read'], reply_timeout=values['reply_timeout'],
        watchdog=values['watchdog'], error_run=values['error_run'],
        profile_velocity_scale=values['profile_velocity_scale'], reboot=values['reboot_servos']), period)


def _ros2_control(node, chain, values, period):
    from style_servo.ros2_control_backend import Ros2ControlBackend
    return Ros2ControlBackend(
        node, chain, period, values['controller'], values['goal_rate'] if values['interface'] == 'action' else None,
        values['state_timeout'], values['error_run'], values['transport_time'], values['start_wait'])


#: Value of the parameter ``backend`` -> what makes it from the node, the chain, the parameters and the period in s.
#: What a back end needs is imported when it is chosen.
BACKENDS = {'dynamixel': _dynamixel, 'ros2_control': _ros2_control}
