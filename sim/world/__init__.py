"""The emulated robot: its MuJoCo world, composition, device server and pacing."""
