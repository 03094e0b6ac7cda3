"""Device families: one folder each, with pure frames, a motor driver and an emulator."""
