"""``source install/setup.bash`` is all a fresh shell needs, and both ways to a launch file mean the same."""
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LAUNCH_FILES = sorted(path.name for path in ROOT.glob('launch/*.launch.py'))


def fresh_shell(command):
    """Output of a command in a shell that knows nothing but the workspace."""
    done = subprocess.run(
        ['env', '-i', f'HOME={Path.home()}', 'PATH=/usr/bin:/bin', 'ROS_LOCALHOST_ONLY=1', 'bash', '-c',
         f'source install/setup.bash && {command}'], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_commands_are_on_the_path():
    assert fresh_shell('motion-style --version').startswith('motion-style ')
    listed = fresh_shell('ros2 pkg executables style_predictor').split()
    assert {'predictor', 'motion_player'} <= set(listed)


def test_interfaces_are_found():
    shown = fresh_shell('ros2 interface show style_msgs/action/Synthesize')
    assert 'float64 progress' in shown
    assert '\tstring name' in shown  # nested types are spelled out


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_package_and_path_show_the_same_launch_arguments(name):
    by_package = fresh_shell(f'ros2 launch style_bringup {name} --show-args')
    by_path = fresh_shell(f'ros2 launch launch/{name} --show-args')
    assert "':\n" in by_package
    installed = subprocess.run(['bash', '-c', 'source install/setup.bash && ros2 pkg prefix --share style_bringup'],
                               cwd=ROOT, capture_output=True, text=True).stdout.strip()
    assert by_package.replace(installed, str(ROOT)) == by_path


def test_mathematics_imports_no_ros():
    program = '\n'.join([
        'import importlib, pkgutil, sys, style_core',
        'for module in pkgutil.walk_packages(style_core.__path__, "style_core."):',
        '    importlib.import_module(module.name)',
        'ros = {"rclpy", "sensor_msgs", "style_msgs", "ament_index_python", "launch", "rosidl_runtime_py"}',
        'print(sorted(ros & set(sys.modules)))'])
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert done.stdout.strip() == '[]', done.stdout + done.stderr
