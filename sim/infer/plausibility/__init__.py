"""Plausibility of a dataset before inference."""
