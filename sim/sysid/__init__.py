"""What moves a flywheel or a hood's screw, fitted to speeds: friction, inertia, delay, and the gains that follow."""
