# ROS 2 Humble, built from PyPI. Source this file, or the install/setup.bash of a workspace built on it.
_ros_prefix='@PREFIX@'
_ros_prepend() {  # _ros_prepend VARIABLE FOLDER: once, however often this file is sourced
    eval "_ros_value=\${$1-}"
    case ":$_ros_value:" in
        *":$2:"*) ;;
        *) eval "export $1=\"\$2\${_ros_value:+:\$_ros_value}\"" ;;
    esac
}
_ros_prepend AMENT_PREFIX_PATH "$_ros_prefix"
_ros_prepend CMAKE_PREFIX_PATH "$_ros_prefix"
_ros_prepend PYTHONPATH "$_ros_prefix/rclpy"
_ros_prepend LD_LIBRARY_PATH "$_ros_prefix/lib"
_ros_prepend PATH "$_ros_prefix/bin"
_ros_prepend PATH "$_ros_prefix/venv/bin"
export ROS_DISTRO=humble ROS_VERSION=2 ROS_PYTHON_VERSION=3
unset -f _ros_prepend
unset _ros_prefix _ros_value
