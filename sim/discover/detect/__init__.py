"""Detection and localization of a mismatch."""
