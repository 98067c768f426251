"""The suite's nodes as launch actions, shared by the launch files of this folder."""
import os
from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.conditions import IfCondition
from launch.events import matches_action
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

__all__ = ['CONFIG', 'OF_OTHER_MODES', 'SERVOS', 'SYNTHESIZER', 'enclave', 'lifecycle', 'local_only', 'predictor',
           'servos', 'synthesizer']

# beside this folder, in the source tree as well as where both are installed
CONFIG = Path(__file__).resolve().parents[1] / 'config'


def enclave(name):
    """Arguments that name a node's enclave (docs/security.md); without security they mean nothing."""
    return ['--enclave', f'/style/{name}']


def local_only(default):
    """The launch argument ``local``: nodes hear and are heard on this computer only. A variable of the shell wins."""
    def start(context):
        wanted = LaunchConfiguration('local').perform(context).lower() in ('true', '1')
        if not wanted or 'ROS_LOCALHOST_ONLY' in os.environ:
            return []
        return [SetEnvironmentVariable('ROS_LOCALHOST_ONLY', '1'),
                LogInfo(msg='On this computer only: other shells need export ROS_LOCALHOST_ONLY=1 (or local:=false)')]
    return [DeclareLaunchArgument('local', default_value=default,
                                  description='true: on this computer only, unless ROS_LOCALHOST_ONLY is set'),
            OpaqueFunction(function=start)]


def lifecycle(node, autostart):
    """A lifecycle node with what configures and activates it where ``autostart`` is true."""
    def change(transition):
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))
    return [
        RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
            entities=[change(Transition.TRANSITION_ACTIVATE)]), condition=IfCondition(autostart)),
        node,
        EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node),
                                    transition_id=Transition.TRANSITION_CONFIGURE), condition=IfCondition(autostart)),
    ]


def predictor(model, joint_map, params, joint_states='joint_states', namespace='', autostart='true', **more):
    """The predictor node; ``more`` are further parameters."""
    return lifecycle(LifecycleNode(
        package='style_predictor', executable='predictor', name='predictor', namespace=namespace, output='screen',
        ros_arguments=enclave('predictor'),
        parameters=[params, {'model': ParameterValue(model, value_type=str),
                             'joint_map': ParameterValue(joint_map, value_type=str), **more}],
        remappings=[('joint_states', joint_states)]), autostart)


#: arguments of the synthesizer: default, description
SYNTHESIZER = {
    'model': ('locomotion.npz', 'model file: in the working folder or in config/models; empty to play a motion '
                                'file only'),
    'robot': ('', 'robot file: in the working folder or in config/robots; empty for the joints of the model'),
    'mode': ('cycle', 'cycle, follow, sequence, random_walk, effort or file'),
    'behaviour': ('', 'of a phase-style model; its first where empty'),
    'style': ('', "style expression, e.g. '1.5*walk - 0.5*run'; empty for the mean of the model"),
    'speed': ('1.0', '1 as learned'),
    'seed': ('0', 'of a random walk'),
    'file': ('', 'motion file to play or to restyle'),
    'skeleton': ('', 'skeleton file where the motion file needs one'),
    'loop': ('true', 'play the motion file for ever'),
    'estimate': ('predictor/estimate', 'topic of the estimates to follow'),
    'joint_trajectory': ('joint_trajectory', 'topic of the trajectories'),
    'joint_states': ('joint_states', 'topic of the joint states that the servos report'),
    'synthesizer_params': (str(CONFIG / 'synthesizer.yaml'), 'parameter file of the synthesizer'),
    'autostart': ('true', 'configure and activate the nodes'),
}

#: of these, what following has no use for
OF_OTHER_MODES = ('behaviour', 'speed', 'seed', 'file', 'skeleton', 'loop')

#: launch arguments of `servos`
SERVOS = {
    'servos': ('none', 'none, sim (simulated Dynamixel chain) or real'),
    'chain': ('', 'chain file of the servos; empty for the one named as the robot'),
    'port': ('/dev/ttyUSB0', 'serial device of the Dynamixel adapter, with servos:=real'),
    'bridge_params': (str(CONFIG / 'servo' / 'bridge.yaml'), 'parameter file of the servo bridge'),
    'record': ('', 'file to write every cycle of the bridge to; empty for none'),
    'sim_link': ('', 'where the simulated port appears; empty for a temporary folder'),
    'sim_options': ('', 'further options of the simulated chain (see dynamixel_sim --help)'),
}


def synthesizer(**fixed):
    """The synthesizer node, its parameters from launch arguments; ``fixed`` ones are none."""
    values = {name: fixed.get(name, LaunchConfiguration(name)) for name in SYNTHESIZER
              if name in fixed or name not in OF_OTHER_MODES}
    parameters = {name: ParameterValue(values[name], value_type=str) for name in ('model', 'robot', 'mode', 'style')}
    if not fixed:
        kinds = {'speed': float, 'seed': int, 'loop': bool}
        parameters.update({name: ParameterValue(LaunchConfiguration(name), value_type=kinds.get(name, str))
                           for name in OF_OTHER_MODES})
    return lifecycle(LifecycleNode(
        package='style_synth', executable='synthesizer', name='synthesizer', namespace='', output='screen',
        ros_arguments=enclave('synthesizer'),
        parameters=[values['synthesizer_params'], parameters],
        remappings=[('estimate', values['estimate']), ('joint_trajectory', values['joint_trajectory'])]),
        values['autostart'])


def servos(joint_states):
    """The servo bridge where the argument ``servos`` is ``sim`` or ``real``."""
    def start(context):
        wanted = LaunchConfiguration('servos').perform(context)
        if wanted not in ('none', 'sim', 'real'):
            raise RuntimeError(f'servos must be none, sim or real, not {wanted}')
        if wanted == 'none':
            return []
        robot = LaunchConfiguration('robot').perform(context)
        chain = LaunchConfiguration('chain').perform(context) or Path(robot).name
        if not chain:
            raise RuntimeError('servos need a robot or a chain: give robot:=humanoid20.yaml, for example')
        return [IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(Path(__file__).parent / 'servo.launch.py')),
            launch_arguments={'sim': 'true' if wanted == 'sim' else 'false', 'chain': chain,
                              'port': LaunchConfiguration('port').perform(context),
                              'params': LaunchConfiguration('bridge_params').perform(context),
                              'record': LaunchConfiguration('record').perform(context),
                              'sim_link': LaunchConfiguration('sim_link').perform(context),
                              'sim_options': LaunchConfiguration('sim_options').perform(context),
                              'joint_trajectory': LaunchConfiguration('joint_trajectory').perform(context),
                              'joint_states': joint_states.perform(context)}.items())]
    return OpaqueFunction(function=start)
