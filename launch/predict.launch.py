"""Start the predictor, configured and active.

ros2 launch launch/predict.launch.py model:=/path/to/model.npz
ros2 launch launch/predict.launch.py model:=walk_run.npz params:=my_robot.yaml joint_map:=my_robot_joints.yaml
"""
import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

sys.path.insert(0, str(Path(__file__).parent))
from nodes import CONFIG, local_only, predictor

ARGUMENTS = {
    'model': ('', 'model file (needed): in the working folder or in config/models'),
    'joint_map': ('', 'YAML file from model joints to robot joints; empty where they are the same'),
    'params': (str(CONFIG / 'predictor.yaml'), 'parameter file of the predictor'),
    'method': ('full', 'full, or paper: the published method alone'),
    'behaviour': ('', 'of the model file, for method:=paper; its first where empty'),
    'forgetting': ('0.8', 'lambda of the published method, for method:=paper'),
    'joint_states': ('joint_states', 'topic of the joint states'),
    'namespace': ('', 'namespace of the node'),
    'autostart': ('true', 'configure and activate the node'),
}

#: of parameters whose text might be read as something else
KINDS = {'behaviour': str, 'forgetting': float}


def generate_launch_description():
    """The predictor and what brings it up."""
    return LaunchDescription([
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ] + local_only('false') + predictor(**{
        name: ParameterValue(LaunchConfiguration(name), value_type=KINDS[name]) if name in KINDS
        else LaunchConfiguration(name) for name in ARGUMENTS}))
