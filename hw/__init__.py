"""Hardware interfaces, which do not depend on any particular launcher: protocols, frames, devices and clocks.

They are real or emulated.
"""
