"""The way to the motors: servo bridge, back ends, and a simulated Dynamixel bus."""
