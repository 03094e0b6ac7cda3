"""Session recordings: writing, reading and recovery."""
