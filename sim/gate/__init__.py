"""Physics-informed gate: forecast, learned residual, calibration and domain of validity."""
