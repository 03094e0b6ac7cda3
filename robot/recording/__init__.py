"""Session recordings: write, read, recover."""
