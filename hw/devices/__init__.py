"""The device families. Each is a single file, or a folder if the family has a DBC file."""
