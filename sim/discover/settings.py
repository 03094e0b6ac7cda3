"""Defaults and limits of discovery, in a module that imports nothing: the command line shows them in --help."""

FALSE_ALARM = 0.05
LEAST_FALSE_ALARM = 0.002             # a p of at least 1 in 1000 can decide about it
LEVELS = ("L0", "L1", "L2")           # outcomes | with telemetry | with tracks
LEVEL = "L0"
SEASON_SHOTS = 300                    # of a planned season
PLANNED_SHOTS, CONFIGURATIONS = 100, 5    # of a design
