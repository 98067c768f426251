"""Commands of ``ros2`` that the PyPI tree of Humble lacks: launch, lifecycle, action, interface.

Installed into the prefix that scripts/ros_prefix builds, and nowhere else: an installed Humble has its own.
"""
