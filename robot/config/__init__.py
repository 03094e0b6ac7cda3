"""The launcher's configuration: schema, limits, rig specification, shot maps and units."""
