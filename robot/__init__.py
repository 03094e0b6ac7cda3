"""The robot: one tick, its rigs, its gate and its recording."""
