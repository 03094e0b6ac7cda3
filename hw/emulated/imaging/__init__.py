"""The emulated camera: lens, picture and picture server."""
