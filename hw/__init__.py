"""Hardware interfaces: protocols, frames, devices and clocks, real or emulated. Nothing here depends on a launcher."""
