"""Mechanical and electrical parts of the MuJoCo world."""
