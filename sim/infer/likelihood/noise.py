"""Constants of the noise model: prior knowledge of instruments, operators and launches.

All are standard deviations unless stated otherwise. The values of [noise] in rig.toml are not here.
"""

LAPSE = 0.005                         # share of outcomes that mean nothing: a slip of the operator's finger
SLIP_M = 4.0                          # a height that is a slip lies anywhere within this range
SLIP_PER_M = 0.1                      # likewise its density, where each shot is tested as it comes: it may be farther
# Of the gate's training, where the share of lapses is fitted: median and standard deviation of its log; what a lapse
# is called (miss low, two low, three, two high, miss high); a height that is one lies within this range.
GATE_LAPSE = (0.01, 0.7)
GATE_LAPSE_CELLS = (1 / 6, 1 / 6, 2 / 6, 1 / 6, 1 / 6)
GATE_SLIP_M = 5.0
HEIGHT_M = 0.02                       # of a height measured at the plane
TIMED_M = 0.001                       # of a height at which the ball was timed: a tape's
FLOOR_M = 0.005                       # of the height: what the model leaves out even of a perfect shot

# What instruments that give the exit_* columns are believed to do: a good high-speed camera or radar.
EXIT_SPEED_M_S = 0.05
EXIT_DEG = 0.3
EXIT_SPIN_REV_S = 0.2

# Of a shot, beside what scatters by a fitted amount: spin (a share), the moment of release against a track's first
# sample, where the ball leaves; and of a flight whose launch is unknown.
SPIN_SHARE = 0.05
LEAD_S = 0.3
PLACE_M = 0.01
FREE_PLACE_M = 0.3
FREE_SPEED_M_S = 3.0

# What scatters by amounts that are fitted: launches, and measured distances as a multiple of what the rig states.
# Median and factor of the prior, whose logarithm is normal.
SCATTER_PRIOR = {"scatter.speed": (0.015, 3.0), "scatter.elevation_rad": (0.007, 3.0),
                 "scatter.azimuth_rad": (0.007, 3.0), "scatter.distance": (1.0, 2.0),
                 "scatter.drag_share": (0.01, 3.0), "scatter.spin_ratio": (0.01, 3.0),
                 "scatter.track": (1.0, 3.0)}
SCATTERS = tuple(SCATTER_PRIOR)
# Flights of one ball differ by no more in drag and spin; a misfit that asks for more is something else.
SCATTER_MOST = {"scatter.drag_share": 0.1, "scatter.spin_ratio": 0.1, "scatter.track": 100.0}

# How much balls (or sessions, robots) differ from one another in exit speed: a share. What else goes with a ball
# declares it (Parameter.by_ball). In elevation a later session's balls differ, too.
BALL_SPEED = 0.03
OTHER_RAD = 0.01
OTHER_BALLS = 10                      # balls of a later session that are not told apart
BALLS_PART = 0.5                      # of the variance of launches from shot to shot: as if that were the balls'

WEAKER = 1.5                          # widths of catalogue priors: a belief can hardly be argued away by its own prior
CALIBRATED = 0.04                     # of a tracker's usual error: a scale within 0.2 %, a tilt within 0.1 degrees
UNMEASURED_M = 1e6                    # of a tracker's axis whose samples are all alike
STILL_M = 1e-6                        # that alike: a float's rounding of one number
