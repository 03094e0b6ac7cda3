"""Maps for the logs and tables of FIRST Robotics Competition teams (`truearc import --map`), one shots.toml each."""
