"""Recordings as WPILOG, MCAP, CSV and tables."""
