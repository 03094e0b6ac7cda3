"""Wires: protocols, frames, devices and clocks, real or emulated. Nothing here knows of a launcher."""
