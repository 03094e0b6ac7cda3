"""Motors that somebody else's controller drives: truearc reads and advises."""
