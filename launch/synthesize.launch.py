"""Start the synthesizer, configured and active; with servos:=sim or servos:=real also the servo bridge behind it.

ros2 launch launch/synthesize.launch.py model:=locomotion.npz robot:=humanoid20.yaml servos:=sim
ros2 launch launch/synthesize.launch.py model:=locomotion_styles.npz mode:=random_walk seed:=3
ros2 launch launch/synthesize.launch.py model:='' mode:=file file:=walk.amc robot:=exosuit6.yaml servos:=sim
"""
import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

sys.path.insert(0, str(Path(__file__).parent))
from nodes import SERVOS, SYNTHESIZER, local_only, servos, synthesizer

ARGUMENTS = {**SYNTHESIZER, **SERVOS}


def generate_launch_description():
    """The synthesizer, and the servos where wanted."""
    return LaunchDescription([
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ] + local_only('false') + synthesizer() + [servos(LaunchConfiguration('joint_states'))])
