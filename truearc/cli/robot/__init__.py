"""Commands for the robot."""
