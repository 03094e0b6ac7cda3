"""Set points that score, by a belief: what hood angle and motor speed a distance needs."""
