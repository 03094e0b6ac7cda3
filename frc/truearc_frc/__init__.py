"""truearc for FIRST Robotics Competition robots: NetworkTables, WPILOG, and advice beside a robot's own program."""
