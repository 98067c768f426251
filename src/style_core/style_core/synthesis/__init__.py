"""Motion for robots, made step by step: sources of motion, changes of style, windows of trajectory, retargeting."""
