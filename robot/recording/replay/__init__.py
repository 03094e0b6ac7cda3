"""Deterministic replay of recordings and comparison with what was recorded."""
