"""Real wires, cameras, clocks and processes."""
