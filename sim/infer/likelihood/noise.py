"""The constants of the noise model: what is known beforehand about instruments, operators and launches.

They are standard deviations unless stated otherwise. The values of [noise] in rig.toml are not here.
"""

# Chosen: one or two of a season of 300, so that no single outcome decides
LAPSE = 0.005                         # share of outcomes that mean nothing: a slip of the operator's finger
# Chosen: from the floor to well above a target. Only the logarithm counts: a slip costs six nats however far it is
# off (git show c108a735)
SLIP_M = 4.0                          # a height that is a slip lies anywhere within this range
# Of the gate's training, where the share of lapses is fitted: median and standard deviation of its log; what a lapse
# is called (miss low, two low, three, two high, miss high); a height that is one lies within this range.
GATE_LAPSE = (0.01, 0.7)              # chosen: one in a hundred, within a factor of two
GATE_LAPSE_CELLS = (1 / 6, 1 / 6, 2 / 6, 1 / 6, 1 / 6)  # derived: miss, two and three alike, evenly low and high
GATE_SLIP_M = 5.0                     # chosen: twice the height of a target to either side
SLIP_PER_M = 0.5 / GATE_SLIP_M        # likewise its density, where each shot is tested as it comes; derived
HEIGHT_M = 0.02                       # of a height measured at the plane; chosen: read off a film, to a tenth of a ball
TIMED_M = 0.001                       # of a height at which the ball was timed: a tape's; chosen: its reading
# Chosen: far below the 0.11 m by which launchers scatter (git show cc0e336a:benchmarks/launcher_world.py)
FLOOR_M = 0.005                       # of the height: what the model leaves out even of a perfect shot

# What instruments that give the exit_* columns are believed to do: a good high-speed camera or radar.
EXIT_SPEED_M_S = 0.05                 # chosen: 0.5 % at 10 m/s, as of 1 cm in 2 m
EXIT_DEG = 0.3                        # chosen: as of 1 cm in 2 m
EXIT_SPIN_REV_S = 0.2                 # chosen: as of 7 degrees in a tenth of a second

# Of a shot, beside what scatters by a fitted amount: spin (a share), the moment of release against a track's first
# sample, where the ball leaves; and of a flight whose launch is unknown.
SPIN_SHARE = 0.05                     # chosen: three times as uncertain as the speed, for a ball that slips turns less
LEAD_S = 0.3                          # chosen: as good as unknown, a third of a flight
PLACE_M = 0.01                        # chosen: wheels hold a ball to a centimetre
FREE_PLACE_M = 0.3                    # chosen: as good as unknown, beside samples that are good to centimetres
FREE_SPEED_M_S = 3.0                  # chosen: as good as unknown, beside the 0.1 m/s that a track tells

# What scatters by amounts that are fitted: launches, and measured distances as a multiple of what the rig states.
# Median and factor of the prior, whose logarithm is normal.
# Chosen: 1.5 % of speed, 0.4 degrees and 1 % of drag and spin, within a factor of three; MuJoCo's launcher has 2 % of
# drag (docs/explanation/emulated-world.md)
SCATTER_PRIOR = {"scatter.speed": (0.015, 3.0), "scatter.elevation_rad": (0.007, 3.0),
                 "scatter.azimuth_rad": (0.007, 3.0), "scatter.distance": (1.0, 2.0),
                 "scatter.drag_share": (0.01, 3.0), "scatter.spin_ratio": (0.01, 3.0),
                 "scatter.track": (1.0, 3.0)}
SCATTERS = tuple(SCATTER_PRIOR)
# Flights of one ball differ by no more in drag and spin; a misfit that asks for more is something else.
# Measured: single flights of the table-tennis launcher differ in drag by 3 to 5 % (git show f84cbc14); balls by 8 %
# (by_ball of the terms)
SCATTER_MOST = {"scatter.drag_share": 0.1, "scatter.spin_ratio": 0.1, "scatter.track": 100.0}

# How much balls (or sessions, robots) differ from one another in exit speed: a share. What else goes with a ball
# declares it (Parameter.by_ball). In elevation a later session's balls differ, too.
BALL_SPEED = 0.03                     # chosen: 2 to 5 % for masses that differ by 10 % (VEX balls)
OTHER_RAD = 0.01                      # chosen: as launches scatter, 0.4 to 0.6 degrees
# Measured at L0 on unchanged MuJoCo robots: 7 of 48 alarms without other balls, 4 of 42 with ten that differ by
# BALLS_PART (git show 694b6007)
OTHER_BALLS = 10                      # balls of a later session that are not told apart
# Measured with OTHER_BALLS
BALLS_PART = 0.5                      # of the variance of launches from shot to shot: as if that were the balls'

# Chosen: between once and twice
WEAKER = 1.5                          # widths of catalogue priors: a belief can hardly be argued away by its own prior
# Chosen: as of a board of 1 m read to 2 mm
CALIBRATED = 0.04                     # of a tracker's usual error: a scale within 0.2 %, a tilt within 0.1 degrees
UNMEASURED_M = 1e6                    # of a tracker's axis whose samples are all alike; no information beside any other
STILL_M = 1e-6                        # that alike: a float's rounding of one number
