"""The concealed truth: a small 3-D launcher in NumPy that shares no code with truearc.sim.physics."""
