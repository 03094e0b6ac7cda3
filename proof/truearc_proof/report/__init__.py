"""Figures, tables and pages of proof rounds."""
