"""Maps of logs and tables of the FIRST Robotics Competition (`truearc import --map`), one shots.toml each."""
