"""Driving flywheels and hood so that a fit can learn what moves them."""
