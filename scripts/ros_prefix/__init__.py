"""Builds a ROS 2 Humble prefix from PyPI for machines without an apt repository of Humble."""
