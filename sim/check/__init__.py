"""Plausibility of data: wrong units, axes and angles, which inference would turn into physics."""
