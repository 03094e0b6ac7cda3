"""The companion to the robot's code: data, physics, inference, discovery, gate training and the emulated world."""
