#!/bin/bash
# Where ROS 2 Humble is installed: install what the suite needs and the machine lacks; with apt for apt's Humble. What a
# Humble from elsewhere (RoboStack, built from source) lacks is named.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ "$HUMBLE" != /opt/ros/humble ]; then
    source_ros
    missing="$(python3 - <<'PYTHON'
import importlib.util
wanted = ('Cython colcon_core control_msgs diagnostic_msgs dynamixel_sdk launch_ros launch_testing lifecycle_msgs matplotlib '
          'numpy rclpy rosbags ros2launch ros2lifecycle scipy sensor_msgs sklearn std_srvs tqdm trajectory_msgs yaml')
print(*(name for name in wanted.split() if importlib.util.find_spec(name) is None))
PYTHON
)"
    [ -z "$missing" ] || die "The ROS 2 Humble at $HUMBLE lacks these Python modules: $missing
Install what holds them there (environments/ lists the packages of RoboStack) and run this again."
    exit 0
fi

apt_install build-essential cmake python3-dev python3-pip python3-colcon-common-extensions python3-pytest \
    python3-numpy python3-scipy python3-matplotlib python3-tqdm python3-hypothesis \
    ros-humble-rclpy ros-humble-launch-ros ros-humble-launch-testing-ros ros-humble-domain-coordinator ros-humble-ros2launch \
    ros-humble-ros2lifecycle ros-humble-ros2run ros-humble-ros2topic ros-humble-ros2param ros-humble-ros2service \
    ros-humble-ros2action ros-humble-ros2interface ros-humble-ros2node ros-humble-ros2pkg ros-humble-ament-cmake \
    ros-humble-rosidl-default-generators ros-humble-std-msgs ros-humble-std-srvs ros-humble-sensor-msgs \
    ros-humble-trajectory-msgs ros-humble-control-msgs ros-humble-diagnostic-msgs ros-humble-urdfdom-py \
    ros-humble-rmw-fastrtps-cpp ros-humble-rmw-cyclonedds-cpp

# Ubuntu 22.04 has no packages of these, or too old ones: for this user, exact versions, checked by SHA-256
env -u PYTHONPATH python3 -m pip install --user --quiet --no-deps --require-hashes -r "$ROOT/requirements/humble_apt.txt"
