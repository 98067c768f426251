"""Parameters of the bridge node."""
from dataclasses import fields

from style_node.parameter_table import Parameter, ParameterTable
from style_servo.backends import BACKENDS
from style_servo.bridge import BridgeSettings

__all__ = ['BRIDGE', 'bridge_settings']

_DEFAULT = {field.name: field.default for field in fields(BridgeSettings)}


def _of_bridge(name, text, unit='', lower=None, upper=None, choices=()):
    return Parameter(name, _DEFAULT[name], text, unit, lower, upper, choices, live=False)


BRIDGE = ParameterTable((
    Parameter('chain', '', 'Chain file: joints, their limits and their servos; looked for in the working folder, '
              'then in config/servo', live=False),
    Parameter('backend', 'dynamixel', 'What moves the joints', choices=tuple(BACKENDS), live=False),
    _of_bridge('rate', 'Commands a second', 'Hz', 10.0, 1000.0),
    # input
    _of_bridge('input_timeout', 'A stream (trajectories that end moving) without a new trajectory for longer is stale; '
               '0 waits for the end of the last one', 's', 0.0, 60.0),
    _of_bridge('blend', 'Shortest time in which a new trajectory takes over from the playing one', 's', 0.005, 5.0),
    _of_bridge('ramp_speed', 'Fraction of the joint limits used when ramping in from a held posture', '', 0.01, 1.0),
    _of_bridge('ramp_time', 'Shortest ramp, unless the joints stand where the trajectory begins', 's', 0.01, 30.0),
    _of_bridge('coast', 'A trajectory that ends moving comes to rest in this time', 's', 0.01, 2.0),
    _of_bridge('max_lead', 'How far in the future a trajectory may start', 's', 0.0, 60.0),
    _of_bridge('partial_joints', 'Take trajectories for some of the joints; the others hold'),
    Parameter('max_message_bytes', 1000000, 'Larger messages are refused unread', 'bytes', 1000, 100000000, live=False),
    Parameter('messages_per_cycle', 4, 'More messages than this between two commands are dropped and counted', '', 1,
              1000, live=False),
    # stopping
    _of_bridge('hold_timeout', 'After holding this long on stale input the hold policy acts', 's', 0.0, 3600.0),
    _of_bridge('hold_policy', 'What then happens: keep holding, torque off, or a fault',
               choices=('hold', 'relax', 'fault')),
    _of_bridge('latch_hold', 'Holding on stale input asks for a reset before trajectories are taken again'),
    _of_bridge('estop_action', 'Emergency stop: brake within the limits and hold, or torque off at once',
               choices=('brake', 'torque_off')),
    _of_bridge('fault_action', 'Fault: brake within the limits and hold, or torque off at once',
               choices=('brake', 'torque_off')),
    _of_bridge('following_time', 'How long a following error may last', 's', 0.0, 10.0),
    _of_bridge('saturation_time', 'How long a joint may lag behind a trajectory that asks for more than its limits, by '
               'more than its discontinuity', 's', 0.0, 60.0),
    _of_bridge('hold_error', "How far a stopped joint's command may stay from where the joint is (at most its "
               'following error): bounds what it presses with', 'rad', 0.001, 3.0),
    Parameter('estop_topics', ('estop',), 'Topics of the emergency stop, one a button', fixed=True),
    Parameter('estop_required', False, 'A button of which nothing was heard counts as pressed', fixed=True),
    Parameter('estop_heartbeat', 0.0, 'A button that is silent for longer counts as pressed; 0: silence means nothing',
              's', 0.0, 60.0, fixed=True),
    # the Dynamixel bus
    Parameter('port', '/dev/ttyUSB0', 'Serial device of the Dynamixel adapter', live=False),
    Parameter('baud', 1000000, 'Bits a second on the bus', '', 9600, 4000000, live=False),
    Parameter('fast_read', True, 'Read all servos with one Fast Sync Read (X series from firmware 45)', live=False),
    Parameter('reply_timeout', 0.004, 'Wait for replies beyond the time of their bits', 's', 0.0005, 0.5, live=False),
    Parameter('watchdog', 0.1, 'The servos stop when they hear nothing for this long (Bus Watchdog, steps of 20 ms)',
              's', 0.02, 2.54, live=False),
    Parameter('error_run', 10, 'So many cycles in a row without a complete answer are a fault', '', 1, 10000,
              live=False),
    Parameter('profile_velocity_scale', 1.1, "The servos' own speed limit in units of the joint's", '', 1.0, 10.0,
              live=False),
    Parameter('reboot_servos', False, 'Reboot servos that stand in a hardware error when configuring or resetting',
              live=False),
    # ros2_control
    Parameter('controller', '/joint_trajectory_controller', 'Name of the joint_trajectory_controller', live=False),
    Parameter('interface', 'topic', 'How to command it', choices=('topic', 'action'), live=False),
    Parameter('goal_rate', 20.0, 'Goals a second where the interface is the action', 'Hz', 1.0, 200.0, live=False),
    Parameter('state_timeout', 0.2, 'Joint states, and reports of the controller, older than this are as good as none',
              's', 0.01, 10.0, live=False),
    Parameter('transport_time', 0.005, 'In this time a command is with the controller; commands are made so much and '
              'one and a half periods before their time', 's', 0.0, 0.5, live=False),
    Parameter('start_wait', 3.0, 'When activated, wait this long for the first joint states and for the controller',
              's', 0.0, 60.0, live=False),
    # the process
    Parameter('realtime_priority', 0, 'Run under the real-time scheduler (SCHED_FIFO) at this priority; 0: no', '', 0,
              99, live=False),
    Parameter('stop_with_parent', False, 'Brake, switch torque off and end when the program that started this one has '
              'ended', fixed=True),
    # the flight record
    Parameter('record', '', 'Name of the record of every cycle (time, state, target, command, measured position) '
              'below record_folder; empty for none', live=False),
    Parameter('record_folder', '', 'Where records may be written; empty for servo_bridge in $ROS_HOME (~/.ros)',
              fixed=True),
    Parameter('record_size', 64.0, 'A file of the record that has grown to this is followed by a next one', 'MB', 0.01,
              10000.0, live=False),
    Parameter('record_files', 20, 'So many files of a record are kept, the newest and the end of the run before', '', 4,
              10000, live=False),
))


def bridge_settings(values):
    """Bridge settings of a complete set of values."""
    return BridgeSettings(**{name: values[name] for name in _DEFAULT})
