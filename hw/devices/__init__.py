"""Device families: a file each, or a folder where the family has a DBC file."""
