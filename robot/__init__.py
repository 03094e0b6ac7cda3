"""The robot's side: the control tick, its rigs, its gate and its recording."""
