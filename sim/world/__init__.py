"""Emulated robot: MuJoCo world, composition, device server and pacing."""
