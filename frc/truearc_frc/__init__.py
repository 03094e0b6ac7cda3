"""truearc for robots of the FIRST Robotics Competition: NetworkTables, WPILOG, advice beside a robot's own program."""
