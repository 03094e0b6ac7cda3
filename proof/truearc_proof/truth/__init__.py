"""The concealed truth: a small 3-D launcher in numpy that shares no line with truearc.sim.physics."""
