"""Emulated devices and wires, for tests and the emulated robot."""
