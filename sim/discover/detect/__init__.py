"""Detection and localization of a mismatch between a simulation and the data."""
