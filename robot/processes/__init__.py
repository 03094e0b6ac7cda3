"""The robot's velocity, read in a process of its own."""
