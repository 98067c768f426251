#!/bin/bash
# Where ROS 2 Humble is installed (/opt/ros/humble): install what the suite needs and the machine lacks.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

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
