"""Concealed worlds: sampling plan, data and perturbations."""
