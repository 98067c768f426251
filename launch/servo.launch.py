"""Start the servo bridge, configured and active: on real servos, or with sim:=true on a simulated Dynamixel chain.

ros2 launch launch/servo.launch.py sim:=true
ros2 launch launch/servo.launch.py chain:=my_robot.yaml port:=/dev/ttyUSB0 baud:=1000000
ros2 launch launch/servo.launch.py backend:=ros2_control chain:=exosuit6_ros2_control.yaml interface:=action
"""
import os
import sys
import tempfile
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessIO
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

sys.path.insert(0, str(Path(__file__).parent))
from nodes import CONFIG, enclave, lifecycle, local_only

ARGUMENTS = {
    'sim': ('false', 'true: start a simulated Dynamixel chain and drive that instead of real servos'),
    'chain': ('humanoid20.yaml', 'chain file: in the working folder or in config/servo'),
    'params': (str(CONFIG / 'servo' / 'bridge.yaml'), 'parameter file of the bridge (with sim:=true and no other '
               'one given, simulated.yaml comes on top)'),
    'backend': ('dynamixel', 'dynamixel or ros2_control'),
    'controller': ('', 'name of the joint_trajectory_controller; empty for the one in the parameter file'),
    'interface': ('', 'how to command it: topic or action; empty for the one in the parameter file'),
    'port': ('/dev/ttyUSB0', 'serial device of the Dynamixel adapter (not used with sim:=true)'),
    'baud': ('1000000', 'bits a second on the Dynamixel bus'),
    'joint_trajectory': ('joint_trajectory', 'topic of the trajectories'),
    'joint_states': ('joint_states', 'topic of the measured joint states'),
    'estop': ('estop', 'topic of the emergency stop (std_msgs/Bool)'),
    'record': ('', 'file to write every cycle to (a run and a part are added to its name); empty for none'),
    'sim_link': ('', 'where the simulated port appears; empty for a temporary folder'),
    'sim_options': ('', 'further options of the simulator, as one word list (see dynamixel_sim --help)'),
    'namespace': ('', 'namespace of the node'),
    'autostart': ('true', 'configure and activate the bridge: torque comes on'),
}


def _start(context):
    argument = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    port, actions = argument['port'], []
    if argument['sim'].lower() == 'true':
        port = argument['sim_link'] or os.path.join(tempfile.mkdtemp(prefix='dynamixel_'), 'port')
        actions.append(_simulator(argument, port))
    given = {name: ParameterValue(argument[name], value_type=str) for name in ('controller', 'interface')
             if argument[name]}
    # the simulated servos share this computer; a parameter file of the user's has the last word
    patient = bool(actions) and argument['params'] == ARGUMENTS['params'][0]
    patience = [str(CONFIG / 'servo' / 'simulated.yaml')] if patient else []
    bridge = lifecycle(LifecycleNode(
        package='style_servo', executable='bridge', name='servo_bridge', namespace=argument['namespace'],
        output='screen', ros_arguments=enclave('servo_bridge'),
        parameters=[argument['params'], *patience, {
            'chain': ParameterValue(argument['chain'], value_type=str), 'backend': argument['backend'], 'port': port,
            'baud': int(argument['baud']), 'stop_with_parent': True, **given, **_record(argument['record'])}],
        remappings=[(name, argument[name]) for name in ('joint_trajectory', 'joint_states', 'estop')]),
        argument['autostart'])
    if not actions:
        return bridge
    waiting = list(bridge)

    def on_output(event):
        """The simulator says one line when its port is there; the bridge may open it then."""
        now, waiting[:] = list(waiting), []
        return now
    return [RegisterEventHandler(OnProcessIO(target_action=actions[0], on_stdout=on_output)), *actions]


def _record(path):
    """Who starts the bridge says where its record goes; nobody else may write elsewhere."""
    folder, name = os.path.split(os.path.abspath(path)) if '/' in path else ('', path)
    return {'record': ParameterValue(name, value_type=str), 'record_folder': ParameterValue(folder, value_type=str)}


def _simulator(argument, port):
    from style_servo.chain import load_chain
    chain = load_chain(CONFIG / 'servo' / argument['chain'])
    servos = ','.join(f'{joint.id}:{joint.model}' for joint in chain.joints)
    return ExecuteProcess(
        cmd=[sys.executable, '-m', 'style_servo.dynamixel_sim', '--link', port, '--servos', servos, '--baud',
             argument['baud'], '--stop-with-parent', *argument['sim_options'].split()],
        name='dynamixel_sim', output='screen')


def generate_launch_description():
    """The bridge, what brings it up, and the simulated chain where wanted."""
    return LaunchDescription([
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ] + local_only('false') + [OpaqueFunction(function=_start)])
