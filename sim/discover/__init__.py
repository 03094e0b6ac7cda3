"""Discovery: locate, name and model the physics that a simulation leaves out."""
