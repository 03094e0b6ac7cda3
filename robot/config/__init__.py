"""The launcher's configuration: schema, rig specification, shot plan and CAN policy."""
