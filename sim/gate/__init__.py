"""The gate that takes the physics in: forecast, learned residual, calibration, and how far it may be believed."""
