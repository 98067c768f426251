"""Phase, style and motion: models, on-line prediction and synthesis. Imports no ROS."""
from style_core.built import check

check()

__version__ = '0.1.0'
