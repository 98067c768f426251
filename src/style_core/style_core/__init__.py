"""Phase, style and motion: models, on-line prediction and synthesis. Imports no ROS."""

__version__ = '0.1.0'
