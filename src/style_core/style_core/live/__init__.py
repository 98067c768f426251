"""What stands between messages and mathematics: joint maps, clocks, partial messages, faults. Imports no ROS."""
