"""From messages to predictors: joint maps, clocks, partial messages, faults. Imports no ROS."""
