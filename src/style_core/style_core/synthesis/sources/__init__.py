"""Sources of motion, named for what they play."""
