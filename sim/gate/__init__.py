"""The physics-informed gate: its forecast, learned residual, calibration and domain of validity."""
