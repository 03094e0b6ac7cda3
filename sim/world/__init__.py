"""The emulated robot: MuJoCo world, composition, device server and pacing."""
