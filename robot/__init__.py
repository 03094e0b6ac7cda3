"""The code that runs on the robot: the control tick, its rigs, its gate and its recording."""
