"""Set points that score according to a belief: the hood angle and motor speed for each distance."""
