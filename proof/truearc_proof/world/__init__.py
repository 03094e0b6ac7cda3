"""Seasons of the MuJoCo world, a launcher on the bench, and distractors for its camera."""
