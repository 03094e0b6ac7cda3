"""Detection and localisation of a mismatch."""
