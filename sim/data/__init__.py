"""Datasets of shots on disk, which are read strictly and written without loss."""
