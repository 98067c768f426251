"""A robot moves with a person, in another style: player, predictor, synthesizer in follow mode, servo bridge.

ros2 launch launch/mirror.launch.py file:=walk.amc style:='2*person - mean'
ros2 launch launch/mirror.launch.py file:=my_bag/ robot:=exosuit6.yaml servos:=real port:=/dev/ttyUSB0
ros2 launch launch/mirror.launch.py file:='' person:=/suit/joint_states       (no player: a live person)
"""
import sys
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

sys.path.insert(0, str(Path(__file__).parent))
from nodes import CONFIG, OF_OTHER_MODES, SERVOS, SYNTHESIZER, enclave, local_only, predictor, servos, synthesizer

ARGUMENTS = {
    **{name: entry for name, entry in SYNTHESIZER.items() if name not in ('mode', 'estimate', *OF_OTHER_MODES)},
    'model': ('locomotion.npz', 'phase-style model file: in the working folder or in config/models'),
    'file': ('', 'motion file or bag of the person; empty where joint states come from elsewhere'),
    'skeleton': ('', 'skeleton file where the motion file needs one'),
    'loop': ('repeat', 'no, repeat or seamless'),
    'player_speed': ('1.0', 'how fast the person is played; 1 as recorded'),
    'drop': ('[]', "patterns of the person's joints whose sensors go dark"),
    'drop_from': ('0.0', 's after the start, when they go dark'),
    'drop_until': ('0.0', 's after the start, when they come back; 0 for never'),
    'person': ('person/joint_states', "topic of the person's joint states"),
    'predictor_params': (str(CONFIG / 'predictor.yaml'), 'parameter file of the predictor'),
    'joint_map': ('', "YAML file from model joints to the person's sensors; empty where they are the same"),
    'style': ('', "style expression, also of the person's own style, e.g. '2*person - mean'; empty for the mean of the "
                  'model'),
    'robot': ('humanoid20.yaml', 'robot file: in the working folder or in config/robots'),
    **SERVOS,
    'servos': ('sim', 'none, sim (simulated Dynamixel chain) or real'),
}


def _player(context):
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('file', 'skeleton', 'loop', 'person', 'drop', 'drop_from', 'drop_until', 'player_speed')}
    drop = yaml.safe_load(given['drop'])
    if not given['file']:
        return []
    return [Node(package='style_predictor', executable='motion_player', name='motion_player', output='screen',
                 ros_arguments=enclave('motion_player'),
                 parameters=[{'file': given['file'], 'skeleton': given['skeleton'], 'loop': given['loop'],
                              'drop_from': float(given['drop_from']), 'drop_until': float(given['drop_until']),
                              'speed': float(given['player_speed']),
                              'await_subscribers': 1, **({'drop': drop} if drop else {})}],
                 remappings=[('joint_states', given['person'])])]


def generate_launch_description():
    """All four."""
    return LaunchDescription([
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ] + local_only('true')
        + predictor(LaunchConfiguration('model'), LaunchConfiguration('joint_map'),
                    LaunchConfiguration('predictor_params'), LaunchConfiguration('person'))
        + synthesizer(mode='follow', estimate='predictor/estimate')
        + [servos(LaunchConfiguration('joint_states')), OpaqueFunction(function=_player)])
