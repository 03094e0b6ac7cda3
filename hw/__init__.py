"""The wires: bytes, device units, clocks. This room has never heard of a launcher."""
