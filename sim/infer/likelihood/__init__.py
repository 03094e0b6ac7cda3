"""The likelihood of shots: observations, launch inputs, heights, outcomes and tracks."""
