"""Terms of the flight stage: air and forces."""
