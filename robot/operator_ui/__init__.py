"""The operator's page: FIRE, HOLD or STALE at a glance, the reasons in a driver's words, what the robot believes."""
