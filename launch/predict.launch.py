"""Start the predictor, configured and active.

ros2 launch launch/predict.launch.py model:=/path/to/model.npz
ros2 launch launch/predict.launch.py model:=walk_run.npz params:=my_robot.yaml joint_map:=my_robot_joints.yaml
"""
import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

sys.path.insert(0, str(Path(__file__).parent))
from nodes import CONFIG, local_only, predictor

ARGUMENTS = {
    'model': ('', 'model file (needed): absolute, or the name of one in config/models'),
    'joint_map': ('', 'YAML file from model joints to robot joints; empty where they are the same'),
    'params': (str(CONFIG / 'predictor.yaml'), 'parameter file of the predictor'),
    'method': ('full', 'full, or paper: the published method alone'),
    'joint_states': ('joint_states', 'topic of the joint states'),
    'namespace': ('', 'namespace of the node'),
    'autostart': ('true', 'configure and activate the node'),
}


def generate_launch_description():
    """The predictor and what brings it up."""
    return LaunchDescription([
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ] + local_only('false') + predictor(**{name: LaunchConfiguration(name) for name in ARGUMENTS}))
