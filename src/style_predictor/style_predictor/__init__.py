"""ROS 2 nodes: the on-line motion predictor and the motion player. They convert, keep time, publish and report."""
