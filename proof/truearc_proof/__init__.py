"""Proving discovery: concealed worlds, made by code that the solver does not share."""
