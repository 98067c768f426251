"""Play a motion file or a bag through the predictor, as if it happened now.

ros2 launch launch/replay.launch.py file:=walk.amc model:=/path/to/model.npz
ros2 launch launch/replay.launch.py file:=my_bag/ model:=/path/to/model.npz loop:=seamless drop:="[l*]" drop_from:=5.0
"""
import sys
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

sys.path.insert(0, str(Path(__file__).parent))
from nodes import CONFIG, enclave, local_only, predictor

PREDICTOR = {
    'model': ('', 'model file (needed): in the working folder or in config/models'),
    'joint_map': ('', 'YAML file from model joints to robot joints; empty where they are the same'),
    'params': (str(CONFIG / 'predictor.yaml'), 'parameter file of the predictor'),
    'method': ('full', 'full, or paper: the published method alone'),
}
PLAYER = {
    'file': ('', 'motion file (AMC, BVH, CSV, NPZ) or bag to play (needed)'),
    'skeleton': ('', 'skeleton file where the format needs one; empty to look beside the motion'),
    'topic': ('', 'topic of a bag that holds several'),
    'rate': ('0.0', 'resample to this rate, Hz; 0 keeps the stamps of the recording'),
    'speed': ('1.0', 'how fast to play; 1 as recorded'),
    'loop': ('no', 'no: once; repeat: again and again; seamless: cut at the best matching poses'),
    'stamps': ('clock', 'stamps of the clock, zero stamps, or those of the file (clock, zero, file)'),
    'joints': ('[]', "patterns of joints to play, e.g. ['*leg*', '!*toe*']; all where empty"),
    'drop': ('[]', "patterns of joints whose sensors go dark, e.g. ['left_*']"),
    'drop_from': ('0.0', 'when they go dark, s after the start'),
    'drop_until': ('0.0', 'when they come back, s after the start; 0 for never'),
    'drop_as_zero': ('false', 'they read 0 in place of nothing, as encoders without a signal do'),
    'glitch': ('0.0', 'probability that one joint of a sample is far off, 0 to 0.99'),
    'noise_std': ('0.0', 'standard deviation of white noise on every joint, rad'),
    'jitter': ('0.0', 'share of the sample interval by which samples come late at random, 0 to 0.99'),
    'lose': ('0.0', 'probability that a sample is lost, 0 to 0.99'),
    'seed': ('0', 'of noise, jitter and losses'),
}
LISTENERS = DeclareLaunchArgument('listeners', default_value='1',
                                  description='begin to play once so many listen to the joint states')


def player(context):
    """The player, with every argument read as YAML as on a command line."""
    given = {name: LaunchConfiguration(name).perform(context) for name in PLAYER}
    values = {name: text if name in ('file', 'skeleton', 'topic') else yaml.safe_load(text)
              for name, text in given.items()}
    # no stays a word: YAML would make it false
    values['loop'] = given['loop']
    return [Node(package='style_predictor', executable='motion_player', name='motion_player', output='screen',
                 ros_arguments=enclave('motion_player'),
                 parameters=[{name: value for name, value in values.items() if value != []},
                             {'await_subscribers': int(LaunchConfiguration('listeners').perform(context))}])]


def generate_launch_description():
    """Player and predictor."""
    return LaunchDescription([LISTENERS] + [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in {**PREDICTOR, **PLAYER}.items()
    ] + local_only('true') + predictor(**{name: LaunchConfiguration(name) for name in PREDICTOR})
        + [OpaqueFunction(function=player)])
