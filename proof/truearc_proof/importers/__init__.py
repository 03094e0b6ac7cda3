"""Importers of particular public data sets."""
