"""Set points that score according to a belief: hood angle and motor speed for each distance."""
