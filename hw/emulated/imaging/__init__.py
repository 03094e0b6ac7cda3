"""The emulated camera: lens, shutter, image degradation and picture server."""
