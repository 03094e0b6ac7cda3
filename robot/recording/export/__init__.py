"""Recordings as MCAP, CSV and tables, and as plain rows for the formats of other distributions."""
