"""Importers for particular public data sets."""
