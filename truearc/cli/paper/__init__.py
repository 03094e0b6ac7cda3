"""Commands for the paper's method."""
