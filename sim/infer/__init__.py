"""Inference: observations, likelihood, MAP fit, intervals, posterior, forecast and belief."""
