"""Device families, one file each, or one folder if the family has a DBC file."""
