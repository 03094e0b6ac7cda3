"""Sealed rounds: commit, solve, open, grade and check."""
