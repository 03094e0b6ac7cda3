"""Commands for the gate."""
