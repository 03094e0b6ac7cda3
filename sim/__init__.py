"""The companion: data, physics, inference, discovery, gate training and the emulated world."""
