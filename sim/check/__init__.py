"""Plausibility checks of data: wrong units, axes and angles, which inference would mistake for physics."""
