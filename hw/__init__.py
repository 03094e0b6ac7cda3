"""Hardware interfaces: protocols, frames, devices and clocks, real or emulated. They do not depend on a launcher."""
