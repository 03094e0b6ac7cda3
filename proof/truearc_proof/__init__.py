"""Proof of discovery on concealed worlds, made by code that the solver does not share."""
