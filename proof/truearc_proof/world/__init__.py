"""Seasons of the MuJoCo world."""
