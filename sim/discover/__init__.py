"""Discovery: locating, naming and modelling the physics that a simulation lacks."""
