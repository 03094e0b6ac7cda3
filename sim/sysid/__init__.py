"""Identification of a flywheel or a hood's screw from its speeds: friction, inertia, delay, and the resulting gains."""
