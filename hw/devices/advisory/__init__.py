"""Motors that another controller drives: truearc reads and advises."""
